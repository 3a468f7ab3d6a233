"""How stiff the tip of a cable-driven arm is, and which tensions make it as stiff as asked. Derived here.

At constant tensions a force f at the tip of an arm in stable equilibrium moves it by C f, C = J K^-1 J^T, with the
Jacobian J and the Hessian K of the potential energy, which contains the geometric stiffness of tensions and load.
Tensions that hold a posture in equilibrium change K on its diagonal only. From the softest to the stiffest ones the
diagonal grows, so that C shrinks in every direction: what the arm can have lies between the two.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from tensegrity_envs.compiler.namespace import Component, Components, detached, is_symbol, namespace_of
from tensegrity_envs.mechanics.checks import check_finite
from tensegrity_envs.mechanics.equilibrium import solve_symmetric

_NO_LOAD = (0.0, 0.0)
_HALVINGS = 80


class StiffnessRange(NamedTuple):
    """What feasible tensions can make of the stiffness at a posture.

    Attributes:
        least: [N/m]; 0, which is not reached, where the softest tensions are not stable.
        greatest: [N/m]; both are 0 where no feasible tensions hold the posture in stable equilibrium.
    """

    least: Component
    greatest: Component


class TipStiffness:
    """The stiffness of the tip, for mechanisms with `jacobian`, `stiffness_matrix`, and stiffest and softest tensions.

    Stiffness is force by displacement: along a given direction, or, without one, in the direction in which the tip
    gives way most.
    """

    jacobian: Callable[..., tuple[Components, Components]]
    stiffness_matrix: Callable[..., tuple[Components, ...]]
    posture: Callable[..., tuple[Components, Component, Component]]
    stiffest_tensions: Callable[..., Components]
    softest_tensions: Callable[..., Components]
    stability_margin: Callable[..., Component]

    def tip_compliance(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, Components]:
        """d tip / d force at constant tensions [m/N]: ((xx, xy), (xy, yy)). Of an unstable posture meaningless."""
        x_row, y_row = self.jacobian(q)
        stiffness = self.stiffness_matrix(q, tensions, load)
        by_x, *_ = solve_symmetric(stiffness, tuple(entry + 0.0 * stiffness[0][0] for entry in x_row))
        by_y, *_ = solve_symmetric(stiffness, tuple(entry + 0.0 * stiffness[0][0] for entry in y_row))
        xx, xy, yy = _dot(x_row, by_x), _dot(x_row, by_y), _dot(y_row, by_y)
        return (xx, xy), (xy, yy)

    def cartesian_stiffness(
        self, q: Sequence[Component], tensions: Sequence[Component], load: Sequence[Component] = _NO_LOAD
    ) -> tuple[Components, Components]:
        """d force / d tip at constant tensions [N/m], the inverse of `tip_compliance`.

        Raises:
            ValueError: the arm has one joint only: its tip moves along a curve.
        """
        if len(q) < 2:
            raise ValueError("cartesian_stiffness: the tip of one joint moves along a curve; see stiffness(...)")
        (xx, xy), (_, yy) = self.tip_compliance(q, tensions, load)
        det = xx * yy - xy * xy
        return (yy / det, -xy / det), (-xy / det, xx / det)

    def stiffness(
        self,
        q: Sequence[Component],
        tensions: Sequence[Component],
        load: Sequence[Component] = _NO_LOAD,
        direction: Sequence[Component] | None = None,
    ) -> Component:
        """Force by displacement at constant tensions [N/m]; 0 where the posture is not stable.

        Args:
            q: configuration [rad].
            tensions: [N].
            load: (fx, fy) [N].
            direction: (x, y) of any length but zero, of the force and of the displacement that counts; the direction in
                which the tip gives way most by default.

        Raises:
            ValueError: the direction is not finite, or zero.
        """
        direction = None if direction is None else scaled_direction(direction)
        (xx, xy), (_, yy) = self.tip_compliance(q, tensions, load)
        xp = namespace_of(xx, xy, yy)
        if direction is None:
            compliance = (xx + yy) / 2 + xp.hypot((xx - yy) / 2, xy)
        else:
            x, y = direction
            compliance = (x * x * xx + 2 * x * y * xy + y * y * yy) / (x * x + y * y)
        stable = (self.stability_margin(q, tensions, load) > 0) & (compliance > 0)
        return xp.where(stable, 1.0 / xp.where(stable, compliance, 1.0), 0.0)

    def _softest_and_stiffest(
        self, q: Sequence[Component], load: Sequence[Component], direction: Sequence[Component] | None
    ) -> tuple[Components, Components]:
        """The feasible tensions of least and of greatest stiffness."""
        return self.softest_tensions(q, load), self.stiffest_tensions(q, load)

    def stiffness_range(
        self,
        q: Sequence[Component],
        load: Sequence[Component] = _NO_LOAD,
        direction: Sequence[Component] | None = None,
    ) -> StiffnessRange:
        """The least and the greatest `stiffness` [N/m] that tensions within their bounds give in equilibrium at q.

        Both are NaN where q or the load is.

        Raises:
            ValueError: the direction is not finite, or zero.
        """
        direction = None if direction is None else scaled_direction(direction)
        soft, stiff = self._softest_and_stiffest(q, load, direction)
        _, stability, wrench = self.posture(q, load)
        xp = namespace_of(stability, wrench)
        feasible = (wrench >= 0) & (stability > 0)
        least = self.stiffness(q, soft, load, direction)
        greatest = self.stiffness(q, stiff, load, direction)
        both = stability + wrench
        none = xp.where(xp.isfinite(both), 0.0, both)
        return StiffnessRange(xp.where(feasible, least, none), xp.where(feasible, greatest, none))

    def tensions_for(
        self,
        q: Sequence[Component],
        stiffness: Component,
        load: Sequence[Component] = _NO_LOAD,
        direction: Sequence[Component] | None = None,
    ) -> Components:
        """Tensions [N] that hold q in stable equilibrium with a given `stiffness` [N/m].

        Of all that do, those on the straight way from the softest to the stiffest ones. On floats and arrays.

        Raises:
            ValueError: a number is not finite, the direction is zero, no feasible tensions hold q in stable
                equilibrium, or the stiffness is outside its range, which the message names.
        """
        check_finite("q", q, len(q))
        check_finite("stiffness", (stiffness,), 1)
        check_finite("load", load, 2)
        direction = None if direction is None else scaled_direction(direction)
        least, greatest = (np.asarray(end) for end in self.stiffness_range(q, load, direction))
        wanted = np.asarray(stiffness, float)
        if np.any(greatest <= 0):
            raise ValueError(f"q = {q!r}: no feasible tensions hold it in stable equilibrium")
        slop = 1e-9 * greatest
        if np.any(wanted <= 0) or np.any(wanted < least - slop) or np.any(wanted > greatest + slop):
            between = f"{_shown(least)} and {_shown(greatest)} N/m"
            raise ValueError(f"stiffness = {stiffness!r} N/m: must be between {between} at q = {q!r}")
        soft, stiff = self._softest_and_stiffest(q, load, direction)

        def at(s: Component) -> Components:
            return tuple(a + s * (b - a) for a, b in zip(soft, stiff, strict=True))

        shape = np.broadcast_shapes(wanted.shape, least.shape, greatest.shape)
        low, high = np.zeros(shape), np.ones(shape)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            value = self.stiffness(q, at(middle if shape else float(middle)), load, direction)
            below = np.asarray(value) < wanted
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return at(high if shape else float(high))


def scaled_direction(direction: Sequence[Component]) -> tuple[Component, Component]:
    """The direction with its greatest number from 1 to 2: its square neither overflows nor vanishes.

    A power of two scales it, so that no digit of the stiffness changes. Tensors keep their size. Traceable.

    Args:
        direction: (x, y), numbers or arrays.

    Raises:
        ValueError: it is not two finite numbers, or both are zero.
    """
    if not isinstance(direction, str) and np.ndim(direction) and is_symbol(*direction):
        return direction[0], direction[1]
    try:
        x, y = (np.asarray(detached(value), float) for value in (() if isinstance(direction, str) else direction))
    except (TypeError, ValueError, OverflowError):
        x = y = np.asarray(np.nan)
    greatest = np.maximum(abs(x), abs(y))
    if not (np.isfinite(greatest).all() and (greatest > 0).all()):
        raise ValueError(
            f"direction = {direction!r}: must be two finite numbers (x, y) that are not both zero, such as (0.0, 1.0), "
            "or None for the direction in which the tip gives way most"
        )
    if not all(isinstance(value, int | float | np.generic | np.ndarray) for value in direction):
        return direction[0], direction[1]
    exponent = 1 - np.frexp(greatest)[1]
    along = np.ldexp(x, exponent), np.ldexp(y, exponent)
    return along if greatest.ndim else (float(along[0]), float(along[1]))


def _dot(first: Components, second: Components) -> Component:
    total = first[0] * second[0]
    for a, b in zip(first[1:], second[1:], strict=True):
        total = total + a * b
    return total


def _shown(values: np.ndarray) -> str:
    return f"{values:.6g}" if values.ndim == 0 else f"{values!r}"
