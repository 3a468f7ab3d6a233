"""The boundary conditions of [Muralidharan2022, Eq. 15] as univariate polynomials, as the paper solves them.

The product does not use them. They are built from the energy with its square roots as separate symbols: multiplied by
its conjugate (the root of the scanned joint with the other sign) a condition is a trigonometric polynomial, known from
samples, and so a polynomial in t = tan(alpha / 4). The two printed in full, Eqs. 21 and 26, are also here as printed,
with the corrections of docs/two_x.md.
"""

import math
from functools import cache
from types import SimpleNamespace

import numpy as np

# degree in t = tan(alpha / 4) of the conditions f1 ... f8, scanned in alpha_1 and in alpha_2 (f3 and f4 are quadratic
# in tan(alpha_1 / 2))
DEGREES = ((12, 12, 4, 4, 28, 28, 28, 28), (8, 8, 12, 12, 28, 28, 28, 28))
CONDITIONS = range(8)
_SAMPLES = 64


def coefficients(design, masses):
    """[Muralidharan2022, Eq. 7] from the design and its twelve bar masses."""
    m = dict(enumerate(masses, 1))
    g, b, a, mp = design.gravity, design.b, design.a, design.payload
    return SimpleNamespace(
        c1x=2 * b * b * design.k1 - a * g * (2 * m[10] + 4 * m[11] + m[3] + 2 * m[4] + m[5] + m[7] + 4 * m[8] + 2 * mp),
        c1x_=g * (m[1] + m[10] + 2 * m[11] + m[3] + 2 * m[4] + m[5] + m[7] + 2 * m[8] + mp),
        c2x=2 * b * b * design.k2,
        c3x=g * (m[10] + 2 * m[11] + m[8] + mp),
        c3x_=2 * a * g * (m[11] + mp),
    )


def conditions(design, k, joints, constants):
    """f1 ... f8 where both square roots r_i are given apart from the angles.

    Args:
        design: of the arm.
        k: 0 ... 7. 0-3: moments against the bounds of the cables, G_i - Gamma_i,min and Gamma_i,max - G_i. 4-7: det K
            with (right, right), (right, left), (left, right), (left, left) at the largest tension, over denominators.
        joints: for each joint (c, s, r): cos and sin of alpha / 2, and +-sqrt(l^2 - b^2 c^2).
        constants: from `coefficients`.

    Returns:
        The condition, multiplied so that no denominator but a power of r is left.
    """
    b, n = design.b, constants
    (c1, s1, r1), (c2, s2, r2) = joints
    sin1, cos1, sin2, cos2 = 2 * s1 * c1, c1 * c1 - s1 * s1, 2 * s2 * c2, c2 * c2 - s2 * s2
    s12, c12 = sin1 * c2 + cos1 * s2, cos1 * c2 - sin1 * s2
    end_s, end_c = sin1 * cos2 + cos1 * sin2, cos1 * cos2 - sin1 * sin2
    parts = []
    for c, s, r in joints:
        dr = b * b * s * c / (2 * r)
        ddr = (b * b * (c * c - s * s) / 4 - dr * dr) / r
        parts.append((dr, ddr))
    (dr1, ddr1), (dr2, ddr2) = parts
    # Twice the energy's derivatives are G; here the derivatives themselves.
    g = (
        (n.c1x * sin1 - n.c3x_ * end_s) / 2 - n.c3x * r2 * s12 + n.c1x_ * (dr1 * c1 - r1 * s1 / 2),
        (n.c2x * sin2 - n.c3x_ * end_s) / 2 + n.c3x * (dr2 * c12 - r2 * s12 / 2),
    )
    if k < 4:
        i = k // 2
        (c, _, _), dr = joints[i], parts[i][0]
        left, right = dr - b * c / 2, dr + b * c / 2  # d length / d alpha: F_l left + F_r right = -g
        high, low = design.max_tension, design.min_tension
        return g[i] + (high * left + low * right if k % 2 else low * left + high * right)
    h12 = -n.c3x_ * end_c / 2 + n.c3x * (-dr2 * s12 - r2 * c12 / 2)
    h = (
        (n.c1x * cos1 - n.c3x_ * end_c) / 2 - n.c3x * r2 * c12 + n.c1x_ * (ddr1 * c1 - dr1 * s1 - r1 * c1 / 4),
        (n.c2x * cos2 - n.c3x_ * end_c) / 2 + n.c3x * (ddr2 * c12 - dr2 * s12 - r2 * c12 / 4),
    )
    # The larger tension is known, the other follows from equilibrium; K_ii times c, its only other denominator (the
    # conjugates of b s - r multiply to b^2 - l^2).
    stiff = []
    for i, top_is_left in enumerate((k - 4 >= 2, (k - 4) % 2 == 1)):
        (c, s, r), (dr, ddr) = joints[i], parts[i]
        lever_l, lever_r = b * (b * s - r) / (2 * r), b * (b * s + r) / (2 * r)  # the above over c
        bend_l, bend_r = ddr + b * s / 4, ddr - b * s / 4
        top = design.max_tension
        if top_is_left:
            stiff.append(c * (h[i] + top * bend_l) + (-g[i] - top * c * lever_l) / lever_r * bend_r)
        else:
            stiff.append(c * (h[i] + top * bend_r) + (-g[i] - top * c * lever_r) / lever_l * bend_l)
    return stiff[0] * stiff[1] - c1 * c2 * h12 * h12


@cache
def _to_powers(order):
    """From Fourier coefficients of order -n ... n to powers of t = tan(omega / 2), highest first."""
    columns = []
    for m in range(-order, order + 1):
        columns.append(np.poly1d([1j, 1]) ** (order + m) * np.poly1d([-1j, 1]) ** (order - m))
    return np.array([np.pad(c.coeffs, (2 * order + 1 - len(c.coeffs), 0)) for c in columns]).T


def fourier(design, masses, k, scanned, fixed):
    """Fourier coefficients in alpha / 2 of condition k times its conjugate, where the other angle is `fixed`."""
    constants = coefficients(design, masses)
    omega = 2 * math.pi * np.arange(_SAMPLES) / _SAMPLES
    c, s = np.cos(omega), np.sin(omega)
    r = np.sqrt(design.l**2 - design.b**2 * c**2)
    cf, sf = math.cos(fixed / 2), math.sin(fixed / 2)
    other = (cf, sf, math.sqrt(design.l**2 - design.b**2 * cf**2))
    values = []
    for sign in (1, -1):
        mine = (c, s, sign * r)
        values.append(conditions(design, k, (mine, other) if scanned == 0 else (other, mine), constants))
    if k >= 4:
        product = values[0] * values[1] * (r / design.b) ** 4
    elif (k < 2) == (scanned == 0):
        product = values[0] * values[1] * (r / design.b) ** 2
    elif scanned == 1:
        product = values[0] * values[1]
    else:
        product = values[0]  # no root of alpha_1 in joint 2's moment
    return np.fft.fft(product) / _SAMPLES


def polynomial(design, masses, k, scanned, fixed):
    """Real coefficients of the polynomial in t = tan(alpha / 4) of condition k, highest power first."""
    order = DEGREES[scanned][k] // 2
    f = fourier(design, masses, k, scanned, fixed)
    return (_to_powers(order) @ np.concatenate([f[-order:], f[: order + 1]])).real


def printed_in_t1(design, masses, alpha2):
    """[Muralidharan2022, Eqs. 18 and 21] (with C'_1x for C'_12), highest power first."""
    n, b, lam2 = coefficients(design, masses), design.b, (design.l / design.b) ** 2
    c2, s2 = math.cos(alpha2 / 2), math.sin(alpha2 / 2)
    root = math.sqrt(lam2 - c2 * c2)
    a1 = -4 * b * c2 * n.c3x * root + 2 * n.c1x - 2 * c2 * c2 * n.c3x_ + 2 * n.c3x_ * s2 * s2
    a2 = -2 * s2 * (b * n.c3x * root + c2 * n.c3x_)
    a3 = b * (design.max_tension - design.min_tension)
    a4 = design.max_tension + design.min_tension
    bb, c = b * b, n.c1x_
    zeta = [
        bb * (lam2 - 1) * (-((a2 + a3) ** 2)),
        -4 * a1 * bb * (lam2 - 1) * (a2 + a3),
        -2 * bb
        * (
            2 * a1**2 * (lam2 - 1) + a2**2 * (7 - 5 * lam2) - 4 * a2 * a3 * (lam2 - 2) + a3**2 * lam2 + a3**2
            - 2 * a4**2 * bb + 4 * a4 * bb * c * lam2 - 8 * a4 * bb * c - 2 * bb * c**2 * lam2**2
            + 8 * bb * c**2 * lam2 - 8 * bb * c**2
        ),
        -4 * a1 * bb * (a2 * (9 - 5 * lam2) + a3 * (lam2 + 3)),
        -bb
        * (
            16 * a1**2 + 3 * a2**2 * (5 * lam2 - 21) - 2 * a2 * a3 * (11 * lam2 + 13) - a3**2 * lam2 + a3**2
            + 16 * a4 * bb * c * lam2 + 32 * a4 * bb * c - 16 * bb * c**2 * lam2**2 + 64 * bb * c**2
        ),
        8 * a1 * bb * (3 * a2 * lam2 + 11 * a2 + a3 * lam2 + a3),
        4 * bb
        * (
            2 * a1**2 * (lam2 + 3) - a2**2 * (13 * lam2 + 25) + a3**2 * lam2 + a3**2 - 2 * a4**2 * bb
            + 6 * bb * c**2 * lam2**2 + 8 * bb * c**2 * lam2 + 24 * bb * c**2
        ),
        8 * a1 * bb * (-3 * a2 * lam2 - 11 * a2 + a3 * lam2 + a3),
        bb
        * (
            -16 * a1**2 + a2**2 * (63 - 15 * lam2) - 2 * a2 * a3 * (11 * lam2 + 13) + a3**2 * lam2 - a3**2
            + 16 * a4 * bb * c * lam2 + 32 * a4 * bb * c + 16 * bb * c**2 * lam2**2 - 64 * bb * c**2
        ),
        -4 * a1 * bb * (a2 * (5 * lam2 - 9) + a3 * (lam2 + 3)),
        -2 * bb
        * (
            2 * a1**2 * (lam2 - 1) + a2**2 * (7 - 5 * lam2) + 4 * a2 * a3 * (lam2 - 2) + a3**2 * lam2 + a3**2
            - 2 * a4**2 * bb - 4 * a4 * bb * c * lam2 + 8 * a4 * bb * c - 2 * bb * c**2 * lam2**2
            + 8 * bb * c**2 * lam2 - 8 * bb * c**2
        ),
        4 * a1 * bb * (lam2 - 1) * (a2 - a3),
        bb * (lam2 - 1) * (-((a2 - a3) ** 2)),
    ]  # fmt: skip
    return np.array(zeta[::-1])


def printed_in_t2(design, masses, alpha1):
    """[Muralidharan2022, Eqs. 23 and 26] (with C'_1x for c'_12), highest power first."""
    n, b, lam2 = coefficients(design, masses), design.b, (design.l / design.b) ** 2
    c1, s1 = math.cos(alpha1 / 2), math.sin(alpha1 / 2)
    root = math.sqrt(lam2 - c1 * c1)
    high, low = design.max_tension, design.min_tension
    a1, a2 = -4 * c1 * n.c3x * s1, 2 * n.c3x * (s1 * s1 - c1 * c1)
    a3 = (
        -b * n.c1x_ * s1 * (-3 * c1 * c1 + 2 * lam2 + s1 * s1 - 1) / (2 * root)
        + b * c1 * (high * s1 / root + low * (s1 / root - 1) + high)
        + 2 * c1 * n.c1x * s1
    )
    a4, a5 = -2 * c1 * n.c3x_ * s1, -n.c3x_ * (c1 * c1 - s1 * s1)
    bb = b * b
    mu = [
        bb * a1**2 * (lam2 - 1) - (a3 + a4) ** 2,
        4 * bb * a1 * a2 * (lam2 - 1) - 8 * a5 * (a3 + a4),
        4 * (bb * (a1**2 + a2**2 * (lam2 - 1)) - a3**2 + 2 * a3 * a4 + 3 * a4**2 - 4 * a5**2),
        4 * bb * a1 * a2 * (lam2 + 3) - 8 * a5 * (a3 - 7 * a4),
        bb * (8 * a2**2 * (lam2 + 1) - 2 * a1**2 * (lam2 + 3)) - 6 * a3**2 + 20 * a3 * a4 - 38 * a4**2 + 32 * a5**2,
        8 * a5 * (a3 - 7 * a4) - 4 * bb * a1 * a2 * (lam2 + 3),
        4 * (bb * (a1**2 + a2**2 * (lam2 - 1)) - a3**2 + 2 * a3 * a4 + 3 * a4**2 - 4 * a5**2),
        8 * a5 * (a3 + a4) - 4 * bb * a1 * a2 * (lam2 - 1),
        bb * a1**2 * (lam2 - 1) - (a3 + a4) ** 2,
    ]
    return np.array(mu[::-1])


def bar_masses(mechanism):
    return [member.mass for member in mechanism.members if member.kind == "bar"]


def scan(mechanism, lines, limit=0.99 * math.pi):
    """The polynomials of the paper's scan: (scanned angle, its fixed value, the eight polynomials)."""
    masses = bar_masses(mechanism)
    grid = np.linspace(-limit, limit, lines)
    return [
        (scanned, float(fixed), [polynomial(mechanism.design, masses, k, scanned, fixed) for k in CONDITIONS])
        for scanned in (0, 1)
        for fixed in grid
    ]


def candidates(polynomials):
    """Real angles among the roots, by `numpy.roots`."""
    roots = np.concatenate([np.roots(p) for p in polynomials])
    return 4 * np.arctan(roots.real[np.abs(roots.imag) < 1e-6 * (1 + np.abs(roots))])


def intervals(mechanism, scanned, fixed, angles, limit=0.99 * math.pi):
    """The paper's test: between neighbouring candidates one point decides. Neighbours that are inside are merged."""
    ends = np.unique(np.concatenate([[-limit, limit], angles[np.abs(angles) < limit]]))
    middle = (ends[1:] + ends[:-1]) / 2
    q = (middle, np.full(len(middle), fixed))
    _, stability, wrench = mechanism.posture(q if scanned == 0 else q[::-1])
    inside = (stability > 0) & (wrench >= 0) & (np.diff(ends) > 1e-9)
    found = []
    for k in np.flatnonzero(inside):
        if found and ends[k] - found[-1][1] < 1e-9:
            found[-1][1] = ends[k + 1]
        else:
            found.append([ends[k], ends[k + 1]])
    return found
