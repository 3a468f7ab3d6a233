"""The spatial prism's playground: which component code goes into the page, and what is shown."""

from typing import Any

import numpy as np

from tensegrity_agents.playground.page import Plane, Playground, Slider, members_of, numbers_of, varying
from tensegrity_envs.compiler.namespace import Components
from tensegrity_envs.mechanics import JAHROMY, SpatialPrism, SpatialPrismDesign

VARIES = np.ones(1)
TRIPLE = (VARIES, VARIES, VARIES)


def _turn(design: SpatialPrismDesign, position: Components, w: Components, force: Components) -> Components:
    return SpatialPrism(design).holding_step(position, w, force)[0]


def _state(design: SpatialPrismDesign, q: Components, force: Components) -> dict[str, Any]:
    prism = SpatialPrism(design)
    return {
        "q": q,
        "lengths": prism.strut_lengths(q),
        "determinant": prism.strut_determinant(q[:3]),
        "stability": prism.stability_margin(q, None, force),
        "wrench": prism.wrench_margin(q, None, force),
        "forces": prism.actuator_forces(q, force),
        "tensions": prism.cable_tensions(q, force),
        "nodes": prism.nodes(q),
    }


_DESIGN = varying(JAHROMY, "k")
_D = float(JAHROMY.D)
SPATIAL_PRISM = Playground(
    title="Spatial tensegrity prism",
    about="Three struts, three springs, three cables around the platform. Without a force the struts' lengths have one "
    "solution, with the platform level; a force tilts it [Jahromy]. Limits of the struts' lengths, and struts that "
    "touch, are not looked at.",
    script="spatial_prism.js",
    functions={
        "turn": (_turn, {"design": _DESIGN, "position": TRIPLE, "w": TRIPLE, "force": TRIPLE}),
        "state": (_state, {"design": _DESIGN, "q": (*TRIPLE, *TRIPLE), "force": TRIPLE}),
    },
    design=numbers_of(JAHROMY),
    constants={},
    main=Plane(("x [m]", "y [m]"), (-1.6 * _D, -1.6 * _D, 1.6 * _D, 1.6 * _D), "", project=(0, 1)),
    second=Plane(
        ("x [m]", "z [m]"), (-1.6 * _D, -0.2 * _D, 1.6 * _D, 2.6 * _D),
        "The same from the side; the workspace is the section at this height z. Drag here, too.",
        project=(0, 2),
    ),
    start=(0.2 * _D, 0.1 * _D),
    sliders=(
        Slider("height z [m]", "extra", ("z",), 0.02, 2.5 * _D, 1.0 * _D),
        Slider("force on the platform, f<sub>x</sub> [N]", "load", (0,), -150.0, 150.0, 0.0),
        Slider("force on the platform, f<sub>y</sub> [N]", "load", (1,), -150.0, 150.0, 0.0),
        Slider("force on the platform, f<sub>z</sub> [N]", "load", (2,), -150.0, 150.0, 0.0),
    ),
    quantities=(
        "strut 1 [m]", "strut 2 [m]", "strut 3 [m]", "det ∂l/∂r without force [-]", "stability margin [-]",
        "wrench margin [-]", "thrust 1 [N]", "thrust 2 [N]", "thrust 3 [N]",
        "cable 1 [N]", "cable 2 [N]", "cable 3 [N]",
        "rotation w₁ [rad]", "rotation w₂ [rad]", "rotation w₃ [rad]",
    ),
    classes=(("no equilibrium found", "#ffffff"), ("a strut or cable would be slack", "#eceff2"), ("held", "#a6cbe3")),
    members=members_of(SpatialPrism()),
)  # fmt: skip
