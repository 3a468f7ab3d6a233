"""Sine, cosine and arc tangent in plain arithmetic, of which `loops` makes machine code for several numbers at a time.

The C library's take one number at a time, and were half of an environment's step. They are component code, traced once.
"""

import math
from typing import Any

from tensegrity_envs.compiler.namespace import Component, Namespace

# pi / 2 in three parts. The first two have 33 bits: their products with whole numbers below 2**20 are exact.
HALF_PI_1 = float.fromhex("0x1.921fb544p+0")
HALF_PI_2 = float.fromhex("0x1.0b4611a6p-34")
HALF_PI_3 = float.fromhex("0x1.3198a2e037073p-69")
TWO_OVER_PI = 0.6366197723675814
ROUND = 1.5 * 2.0**52  # adding and subtracting it rounds to a whole number
# Taylor's series; what follows in them is below 2**-53 for |r| <= pi / 4.
S3, S5, S7, S9 = -1 / 6, 1 / 120, -1 / 5040, 1 / 362880
S11, S13, S15 = -1 / 39916800, 1 / 6227020800, -1 / 1307674368000
C4, C6, C8, C10 = 1 / 24, -1 / 720, 1 / 40320, -1 / 3628800
C12, C14, C16 = 1 / 479001600, -1 / 87178291200, 1 / 20922789888000


# Arc tangent on [-tan(pi / 8), tan(pi / 8)] is x + x z P(z) / Q(z), z = x^2: Cephes (S. L. Moshier), atan.c.
P = (
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)
Q = (
    1.0,
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
)
TAN_PI_8 = 0.41421356237309503
PI_4, PI_4_REST = math.pi / 4, 3.061616997868383e-17  # and what is missing to pi / 4
PI_2, PI_2_REST = math.pi / 2, 6.123233995736766e-17
PI, PI_REST = math.pi, 1.2246467991473532e-16


def sine_and_cosine(xp: Namespace, x: Component) -> tuple[Component, Component]:
    """Of an angle [rad], to within a unit in the last place below a million."""
    quarters = (x * TWO_OVER_PI + ROUND) - ROUND
    # The distance to the nearest quarter turn is r - rest, as exactly as two numbers can tell; of -0 it is -0.
    near, by = x - quarters * HALF_PI_1, quarters * HALF_PI_2
    rough = near - by
    small = quarters * HALF_PI_3 - ((near - rough) - by)
    r = rough - small
    rest = small - (rough - r)
    z = r * r
    s = r - (rest - r * z * (S3 + z * (S5 + z * (S7 + z * (S9 + z * (S11 + z * (S13 + z * S15)))))))
    tail = z * z * (C4 + z * (C6 + z * (C8 + z * (C10 + z * (C12 + z * (C14 + z * C16))))))
    most = 1 - 0.5 * z
    c = most + (((1 - most) - 0.5 * z) + (tail + r * rest))
    half = quarters * 0.5
    is_odd = (half + ROUND) - ROUND != half
    quarter = xp.where(is_odd, half - 0.5, half) * 0.5
    is_upper = (quarter + ROUND) - ROUND == quarter
    sine = xp.where(is_odd, c, s)
    cosine = xp.where(is_odd, s, c)
    return xp.where(is_upper, sine, -sine), xp.where(is_upper != is_odd, cosine, -cosine)


def arc_tangent(xp: Any, y: Component, x: Component) -> Component:
    """The angle of the point (x, y) [rad], to within two units in the last place; as C's `atan2`, zeros included."""
    tall = abs(y) > abs(x)
    long, short = xp.where(tall, abs(y), abs(x)), xp.where(tall, abs(x), abs(y))
    # The angle from the nearest axis is pi / 4 more than that of a point turned back by pi / 4, or its own.
    is_steep = short > TAN_PI_8 * long
    above, below = xp.where(is_steep, short - long, short), xp.where(is_steep, short + long, long)
    t = above / xp.where(below > 0, below, 1.0)
    z = t * t
    p = (((P[0] * z + P[1]) * z + P[2]) * z + P[3]) * z + P[4]
    q = ((((z + Q[1]) * z + Q[2]) * z + Q[3]) * z + Q[4]) * z + Q[5]
    small = t * (z * p / q) + xp.where(is_steep, PI_4_REST, 0.0)
    angle = xp.where(is_steep, PI_4, 0.0) + (t + small)
    angle = xp.where(tall, PI_2 - (angle - PI_2_REST), angle)
    is_left = xp.copysign(1.0, x) < 0
    angle = xp.where(is_left, PI - (angle - PI_REST), angle)
    return xp.copysign(angle, y)
