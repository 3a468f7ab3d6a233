"""The planar mechanisms' playgrounds: which component code goes into the page, and what is shown."""

import math
from typing import Any

import numpy as np

from tensegrity_agents.playground.page import Plane, Playground, Slider, members_of, numbers_of, varying
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics import (
    JI2014,
    MURALIDHARAN2022,
    NX,
    THREE_X,
    ZHAO2021_CAPTION,
    DualTriangle,
    DualTriangleDesign,
    NXDesign,
    PlanarFourBar,
    PlanarFourBarDesign,
    TwoX,
    TwoXDesign,
)
from tensegrity_envs.mechanics.planar_four_bar.equilibria import pointing
from tensegrity_envs.mechanics.planar_four_bar.inverse import Crossbar, Pivots, crossbar, imbalance, pivot

VARIES = np.ones(1)
PAIR = (VARIES, VARIES)
TRIPLE = (VARIES, VARIES, VARIES)
OUT, REACHED = ("not reached", "#ffffff"), ("reached, but not held", "#eceff2")
HELD = ("#dbe9f6", "#a6cbe3", "#6aaed6", "#3787c0")
COUNTS = (OUT, REACHED, *((f"{n} held{' or more' if n == 4 else ''}", c) for n, c in enumerate(HELD, 1)))

# ------------------------------------------------------------------------------------------------------------- 2-X


def _off_curve(design: TwoXDesign, target: Components, psi: Component) -> Component:
    return TwoX(design).through_anomaly(target[0], target[1], psi)[1]


def _candidate(design: TwoXDesign, target: Components, psi: Component) -> dict[str, Any]:
    q, _, u = TwoX(design).through_anomaly(target[0], target[1], psi)
    return {"q": q, "u": u}


def _two_x_place(design: TwoXDesign, q: Components) -> dict[str, Any]:
    arm = TwoX(design)
    return {"tip": arm.tip(q), "jacobian": arm.jacobian(q)}


def _two_x_posture(design: TwoXDesign, q: Components, load: Components) -> dict[str, Any]:
    arm = TwoX(design)
    tensions, stability, wrench = arm.posture(q, load)
    return {"tensions": tensions, "stability": stability, "wrench": wrench, "determinant": arm.jacobian_determinant(q)}


_TWO_X = varying(MURALIDHARAN2022, "payload", "a", "b", "l", "k1", "k2")
TWO_X = Playground(
    title="2-X tensegrity manipulator",
    about="Two X-joints in series, four cables. For the tip's position all configurations are shown, and whether "
    "tensions within their limits hold them in stable equilibrium [Muralidharan2022].",
    script="two_x.js",
    functions={
        "offCurve": (_off_curve, {"design": _TWO_X, "target": PAIR, "psi": VARIES}),
        "candidate": (_candidate, {"design": _TWO_X, "target": PAIR, "psi": VARIES}),
        "place": (_two_x_place, {"design": _TWO_X, "q": PAIR}),
        "posture": (_two_x_posture, {"design": _TWO_X, "q": PAIR, "load": PAIR}),
        "nodes": (lambda design, q: TwoX(design).nodes(q), {"design": _TWO_X, "q": PAIR}),
    },
    design=numbers_of(MURALIDHARAN2022),
    constants={},
    main=Plane(("x [m]", "y [m]"), (-0.7, -0.7, 0.7, 0.7), "", project=(0, 1)),
    second=Plane(
        ("α₁ [rad]", "α₂ [rad]"), (-math.pi, -math.pi, math.pi, math.pi),
        "Joint space: green where the configuration is held in stable equilibrium. Click or drag here, too.",
    ),
    start=(0.25, 0.3),
    sliders=(
        Slider("payload [kg]", "design", ("payload",), 0.0, 1.0, 0.0),
        Slider("load at the tip, f<sub>x</sub> [N]", "load", (0,), -10.0, 10.0, 0.0),
        Slider("load at the tip, f<sub>y</sub> [N]", "load", (1,), -10.0, 10.0, 0.0),
        Slider("offset a [m]", "design", ("a",), 0.0, 0.2, 0.2),
        Slider("base bar b [m]", "design", ("b",), 0.02, 0.08, 0.05),
        Slider("spring stiffness k₁ [N/m]", "design", ("k1",), 100.0, 1200.0, 600.0),
        Slider("spring stiffness k₂ [N/m]", "design", ("k2",), 100.0, 1200.0, 300.0),
    ),
    quantities=(
        "α₁ [rad]", "α₂ [rad]", "det J [m²]", "stability margin [-]", "wrench margin [-]",
        "tension left 1 [N]", "tension right 1 [N]", "tension left 2 [N]", "tension right 2 [N]",
    ),
    classes=COUNTS,
    members=members_of(TwoX(), ("bar", "cable")),
)  # fmt: skip

# ------------------------------------------------------------------------------------------------------------- 3-X


def _beyond_first(design: NXDesign, target: Components, q1: Component) -> Components:
    """The target as it is seen from the second joint: from the middle of its base, along its base."""
    arm = NX(design)
    xp = arm.namespace(q1)
    nodes = arm.nodes((q1, 0.0 * q1, 0.0 * q1))
    dx, dy = (end - (left + right) / 2 for end, left, right in zip(target, nodes["A2"], nodes["B2"], strict=True))
    sine, cosine = xp.sin(q1), xp.cos(q1)
    return cosine * dx + sine * dy, cosine * dy - sine * dx


def _three_x_posture(design: NXDesign, q: Components, load: Components) -> dict[str, Any]:
    arm = NX(design)
    tensions, stability, wrench = arm.posture(q, load)
    return {
        "tensions": tensions,
        "stability": stability,
        "wrench": wrench,
        "determinant": arm.jacobian_determinant(q),
        "tip": arm.tip(q),
    }


_THREE_X = varying(THREE_X, "payload", "a", "b", "l")
N_X = Playground(
    title="Arm of three X-joints",
    about="Three angles for two coordinates of the tip: the first one is free, and all others that fit it are shown, "
    "with the stiffest tensions of the six cables.",
    script="n_x.js",
    functions={
        "beyondFirst": (_beyond_first, {"design": _THREE_X, "target": PAIR, "q1": VARIES}),
        **{name: TWO_X.functions[name] for name in ("offCurve", "candidate", "place")},  # of the last two joints
        "posture": (_three_x_posture, {"design": _THREE_X, "q": TRIPLE, "load": PAIR}),
        "nodes": (lambda design, q: NX(design).nodes(q), {"design": _THREE_X, "q": TRIPLE}),
    },
    design={name: float(getattr(THREE_X, name)) for name in ("payload", "a", "b", "l", "joint_limit")},
    constants={"limit": 2.6},
    main=Plane(("x [m]", "y [m]"), (-1.0, -1.0, 1.0, 1.0), "", project=(0, 1)),
    second=Plane(
        ("first angle α₁ [rad]", "stability margin [-]"), (-2.6, -0.5, 2.6, 1.5),
        "Stability margin of all solutions over the free angle; dashed where the tensions would leave their limits. "
        "Click or drag to choose α₁.",
        equal=False,
    ),
    start=(0.45, 0.5),
    sliders=(
        Slider("first angle α₁ [rad]", "extra", ("q1",), -2.6, 2.6, -0.5),
        Slider("payload [kg]", "design", ("payload",), 0.0, 1.0, 0.0),
        Slider("load at the tip, f<sub>x</sub> [N]", "load", (0,), -10.0, 10.0, 0.0),
        Slider("load at the tip, f<sub>y</sub> [N]", "load", (1,), -10.0, 10.0, 0.0),
        Slider("offset a [m]", "design", ("a",), 0.0, 0.2, 0.2),
        Slider("base bar b [m]", "design", ("b",), 0.02, 0.08, 0.05),
    ),
    quantities=(
        "α₁ [rad]", "α₂ [rad]", "α₃ [rad]", "√det JJᵀ [m²]", "stability margin [-]", "wrench margin [-]",
        *(f"tension {name} [N]" for name in NX(THREE_X).input_names),
    ),
    classes=(OUT, REACHED, ("held by some configuration", HELD[1])),
    members=members_of(NX(THREE_X), ("bar", "cable")),
)  # fmt: skip

# --------------------------------------------------------------------------------------------------- dual-triangles


def _last_two(design: DualTriangleDesign, target: Components, q1: Component) -> dict[str, Any]:
    arm = DualTriangle(design)
    wrist = arm.wrist(target, (q1,))
    elbows = tuple((q1, arm.before_last(wrist, sign * wrist.angle), sign * wrist.angle) for sign in (1, -1))
    return {"stretch": wrist.stretch, "folding": wrist.folding, "elbows": elbows}


def _dual_triangle_posture(design: DualTriangleDesign, q: Components, load: Components) -> dict[str, Any]:
    arm = DualTriangle(design)
    control = arm.control(q, load)
    lengths = arm.free_lengths(control)
    return {
        "control": control,
        "stability": arm.stability_margin(q, lengths, load),
        "limit": arm.limit_margin(q),
        "length": arm.free_length_margin(lengths),
        "determinant": arm.jacobian_determinant(q),
        "tip": arm.tip(q),
    }


_TRIANGLES = varying(ZHAO2021_CAPTION, "k1", "k2", "free_length1", "free_length2")
_LIMIT = float(ZHAO2021_CAPTION.joint_limit)
DUAL_TRIANGLE = Playground(
    title="Serial arm of three dual-triangles",
    about="Three angles for two coordinates of the tip: the first one is free, and both elbows are shown. The control "
    "inputs Δ that make a configuration an equilibrium need not make it stable [Zhao2021].",
    script="dual_triangle.js",
    functions={
        "lastTwo": (_last_two, {"design": _TRIANGLES, "target": PAIR, "q1": VARIES}),
        "posture": (_dual_triangle_posture, {"design": _TRIANGLES, "q": TRIPLE, "load": PAIR}),
        "nodes": (lambda design, q: DualTriangle(design).nodes(q), {"design": _TRIANGLES, "q": TRIPLE}),
    },
    design=numbers_of(ZHAO2021_CAPTION),
    constants={"limit": _LIMIT},
    main=Plane(("x [m]", "y [m]"), (-0.2, -0.3, 0.35, 0.3), "", project=(0, 1)),
    second=Plane(
        ("first angle q₁ [rad]", "stability margin [-]"), (-1.6, -0.5, 1.6, 1.5),
        "Stability margin of both elbows over the free angle; dashed beyond a joint's limit or with a negative free "
        "length. Click or drag to choose q₁.",
        equal=False,
    ),
    start=(0.18, 0.12),
    sliders=(
        Slider("first angle q₁ [rad]", "extra", ("q1",), -_LIMIT, _LIMIT, -0.2),
        Slider("load at the tip, f<sub>x</sub> [N]", "load", (0,), -10.0, 10.0, 0.0),
        Slider("load at the tip, f<sub>y</sub> [N]", "load", (1,), -10.0, 10.0, 0.0),
        Slider("stiffness k [N/m]", "design", ("k1", "k2"), 100.0, 1000.0, 500.0),
        Slider("nominal free length L₀ [m]", "design", ("free_length1", "free_length2"), 0.0, 0.1, 0.05),
    ),
    quantities=(
        "q₁ [rad]", "q₂ [rad]", "q₃ [rad]", "√det JJᵀ [m²]", "stability margin [-]", "distance to joint limit [rad]",
        "Δ₁ [mm]", "Δ₂ [mm]", "Δ₃ [mm]", "shortest free length [mm]",
    ),
    classes=(OUT, REACHED, ("held by some configuration", HELD[1])),
    members=members_of(DualTriangle()),
)  # fmt: skip

# ------------------------------------------------------------------------------------------------------ planar 4-bar


def _support(design: PlanarFourBarDesign, target: Components, sign: Component, load: Components) -> dict[str, Any]:
    arm = PlanarFourBar(design)
    place = pivot(arm, target[0], target[1], sign)
    return {**place._asdict(), "bar": crossbar(arm, target[0], target[1], place.c, place.gamma, load)}


def _state(
    design: PlanarFourBarDesign, support: dict[str, Any], alpha: Component, fold: Component, load: Components
) -> dict[str, Any]:
    arm = PlanarFourBar(design)
    gamma, bar = support["gamma"], support["bar"]
    lengths = support["rho1"], arm.lengths_of(alpha, 0.0 * alpha)[1]
    _, (dx, dy) = arm.supports(lengths)
    q = pointing(arm, lengths, gamma, fold), gamma
    (j11, j12), (j21, j22) = arm.jacobian(q, lengths, load)
    return {
        "lengths": lengths,
        "q": q,
        "stability": arm.stability_margin(q, lengths, load),
        "thrusts": arm.thrusts(q, lengths, load),
        "determinant": j11 * j22 - j12 * j21,
        "distance": arm._xp(bar.mx).hypot(bar.mx - dx, bar.my - dy),
        "tip": arm.tip(q, lengths),
        "nodes": arm.nodes(q, lengths),
    }


_BAR = Crossbar(*(VARIES,) * 5)
_PIVOT = Pivots(PAIR, VARIES, VARIES, VARIES)
_BARS = varying(JI2014, "stiffness")
PLANAR_FOUR_BAR = Playground(
    title="Planar 4-bar tensegrity",
    about="Two actuators, four bars, three springs. All equilibria with the tip at the target are shown, stable and "
    "unstable, with a force on the tip or without [Ji2014].",
    script="planar_four_bar.js",
    functions={
        "supportOf": (_support, {"design": _BARS, "target": PAIR, "sign": VARIES, "load": PAIR}),
        "balance": (
            lambda design, bar, alpha, fold: imbalance(PlanarFourBar(design), bar, alpha, fold),
            {"design": _BARS, "bar": _BAR, "alpha": VARIES, "fold": VARIES},
        ),
        "stateOf": (
            _state,
            {
                "design": _BARS, "support": {**_PIVOT._asdict(), "bar": _BAR},
                "alpha": VARIES, "fold": VARIES, "load": PAIR,
            },
        ),
        "flatness": (
            lambda design, lengths: PlanarFourBar(design).flatness(lengths)[1], {"design": _BARS, "lengths": PAIR},
        ),
    },
    design=numbers_of(JI2014),
    constants={},
    main=Plane(("x [m]", "y [m]"), (-15.0, -15.0, 25.0, 25.0), "", project=(0, 1)),
    second=Plane(
        ("actuator ρ₁ [m]", "actuator ρ₂ [m]"), (0.0, 0.0, 20.0, 20.0),
        "Lengths of the actuators: green where there are rectangles without a load, grey where the mechanism is flat.",
    ),
    start=(3.0, 12.0),
    sliders=(
        Slider("force on the tip, f<sub>x</sub> [N]", "load", (0,), -500.0, 500.0, 0.0),
        Slider("force on the tip, f<sub>y</sub> [N]", "load", (1,), -500.0, 500.0, 0.0),
        Slider("spring stiffness K [N/m]", "design", ("stiffness",), 20.0, 300.0, 100.0),
    ),
    quantities=(
        "ρ₁ [m]", "ρ₂ [m]", "θ [rad]", "γ [rad]", "det ∂(x, y)/∂(ρ₁, ρ₂) [-]", "stability margin [-]",  # noqa: RUF001
        "thrust 1 [N]", "thrust 2 [N]",
    ),
    classes=COUNTS,
    members=members_of(PlanarFourBar()),
)  # fmt: skip
