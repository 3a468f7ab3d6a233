"""Local optima among the configurations of a chain of X-joints with the tip at a target. Derived here.

Three joints move along curves, more on surfaces (`optima.search`). Programmes start at corners, with n - 2 joints at
limits (of "sum" also at rest), of "max" where n - 1 joints are equally far, and at random places of the faces of every
dimension (`optima.faces`, `faces`).
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tensegrity_envs.compiler.namespace import Component
from tensegrity_envs.mechanics.n_x.faces import completed, equal_corners
from tensegrity_envs.mechanics.n_x.margins import frame_at, margin_pieces, margins_of
from tensegrity_envs.mechanics.n_x.postures import starts
from tensegrity_envs.mechanics.n_x.routing import PER_JOINT
from tensegrity_envs.mechanics.optima.faces import corners, faces, held_angles
from tensegrity_envs.mechanics.optima.objectives import measure_of, of_target
from tensegrity_envs.mechanics.optima.pieces import Problem, displacements
from tensegrity_envs.mechanics.optima.search import local_optima

_PROJECTED = 200  # starts of three joints that are projected; of 60, one in 1,400 best was missed
_STARTS = 64  # of more joints
# Places of the faces of a target that are drawn before two joints are solved for.
_DRAWN = {"sum": 600, "max": 1000, "squares": 400, "margin": 200}
_FEW = 60  # of margins whose kinks are not told apart
_TRIES = 8  # starts of Newton's method for both joints of a corner


def problem_of(
    arm: Any,
    target: tuple[float, float],
    start: np.ndarray,
    objective: str,
    load: Sequence[Component],
    limit: float,
    measure: Callable[[np.ndarray], np.ndarray],
) -> Problem:
    """The programme of a target and a start (n,), see `optima`; `measure` as in `Problem`.

    With cables that span several joints the kinks of both margins are not told apart.
    """
    if objective != "margin":
        return Problem(arm, target, limit, measure, *displacements(objective, start))
    if arm.design.routing == PER_JOINT:
        pieces = margin_pieces(arm, load)
        return Problem(arm, target, limit, measure, pieces, None, frame=lambda q: frame_at(arm, q, load))
    margins = margins_of(arm, load)
    return Problem(arm, target, limit, measure, lambda q, frame: -np.stack(margins(q)), None, is_smooth=False)


def _places(arm: Any, target: tuple[float, float], start: np.ndarray, objective: str, limit: float) -> np.ndarray:
    """Corners and faces (n, any) where programmes start; few for margins whose kinks are not told apart."""
    values, centre = held_angles(objective, start, limit), start if objective == "max" else None

    def complete(tries: int) -> Callable[[np.ndarray, tuple[int, int]], np.ndarray]:
        return lambda q, pair: completed(arm, q, pair, target, limit, tries)

    if objective == "margin" and arm.design.routing != PER_JOINT:
        return faces(complete(1), values, limit, _FEW)
    places = [corners(complete(_TRIES), values, limit), faces(complete(1), values, limit, _DRAWN[objective], centre)]
    if centre is not None:
        places.append(equal_corners(arm, centre, target, limit))
    return np.hstack(places)


def optima(
    arm: Any, x: np.ndarray, y: np.ndarray, start: np.ndarray, objective: str, load: Sequence[Component]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All local optima that were found: index of the target (k,), configurations (n, k), values (k,), best first.

    Args:
        arm: of three joints or more, of one design.
        x, y: targets of shape (m,) [m].
        start: of the displacements, (n, m) [rad].
        objective: "sum", "max" or "squares", to be small; or "margin", to be large.
        load: (fx, fy) [N], of "margin".
    """
    limit = float(arm.design.joint_limit)
    if limit <= np.pi:
        limit = min(limit, np.pi - 1e-9)  # the flat poses are left out
    margins = margins_of(arm, load)
    measure = measure_of(arm, objective, start, load, margins)

    def problem(i: int) -> Problem:
        value = of_target(measure_of(arm, objective, start[:, [i]], load, margins))
        return problem_of(arm, (float(x[i]), float(y[i])), start[:, i], objective, load, limit, value)

    def places(i: int) -> np.ndarray:
        return _places(arm, (float(x[i]), float(y[i])), start[:, i], objective, limit)

    begun = starts(arm, x, y, limit, _PROJECTED if arm.degrees_of_freedom == 3 else _STARTS)
    return local_optima(arm, x, y, begun, objective, measure, limit, problem, places)
