"""What is believed of a dual-triangle arm that rests under a hidden load, from the first looks at its tip.

The control inputs tell the posture in which the arm was before it was loaded, exactly. A load F / s, relative to the
stiffness factor s, leads from there to another posture, q(F / s), by continuation; its tip is seen with noise. So

    p(F | tip) ~ exp(-|tip(q(F / s)) - tip|^2 / (2 sigma^2)) p(F),

p(F) being what the environment documents: any direction, a size that is uniform within `load_range`. The mean and the
covariance of this are found by importance sampling in rounds [Cappe2004]: `_SAMPLES` loads are drawn from the prior,
then from a normal distribution about what was found with a larger sigma, which falls to that of the noise. Nothing
tells the stiffness yet. The posterior need not be normal; the filter goes on as if it were.

[Cappe2004] Cappé, Guillin, Marin, Robert, "Population Monte Carlo", Journal of Computational and Graphical Statistics
13(4), 2004.
"""

from typing import Any

import numpy as np

from tensegrity_agents.controllers.believed_plant import BelievedPlant
from tensegrity_agents.controllers.kalman import FLOOR, ArmFilter, Belief
from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.dual_triangle import DualTriangle, DualTriangleDesign
from tensegrity_envs.mechanics.equilibrium import continuation
from tensegrity_envs.observation import DecodedObservation

_SAMPLES = 200
_FIRST_SIGMA, _FALLS = 8e-3, 0.32  # [m], and by what it falls from one round to the next
_WIDER = 1.5  # deviations of a proposal than what was found
_LEAST = 1e-4  # of the largest load: deviation that is reckoned with at least
_TINY = 1e-9  # [N]
_STILL = 1e-3  # [rad/s] deviation of the rates of an arm at rest


def _loaded(
    design: DualTriangleDesign, segments: int, posture: Components, inputs: Components, load: Components
) -> tuple[Components, Component]:
    arm = DualTriangle(design, segments)

    def put_on(q: Components, t: Component) -> Any:
        return arm.statics(q, arm.free_lengths(inputs), tuple(t * force for force in load))

    return continuation(put_on, posture)


def loaded_postures(arm: DualTriangle, inputs: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Where arms rest that were loaded gradually, (n, 3) [rad]; NaN where they lose stability or pass a joint limit.

    Args:
        arm: nominal.
        inputs: shape (n, 3) [m].
        load: shape (n, 2) [N].
    """
    columns = tuple(np.ascontiguousarray(inputs.T))
    bare = arm.equilibrium(arm.free_lengths(columns), tuple(np.zeros_like(inputs.T))).configuration
    q, fraction = evaluate(_loaded, arm.design, arm.segments, bare, columns, tuple(np.ascontiguousarray(load.T)))
    found = np.stack(q, axis=1)
    fine = (fraction >= 1) & (np.abs(found).max(axis=1) <= float(arm.design.joint_limit))
    return np.where(fine[:, None], found, np.nan)


class LoadedFilter(ArmFilter):
    """A Kalman filter of the load, too, that begins with what the first tip tells. See the module.

    Args:
        plant: what is believed; a dual-triangle arm whose load is hidden.
        load_range: of the size of the load [N].
        rate_drift: see `ArmFilter`.
        load_drift: error of a step in the load, as a share of the largest.
    """

    def __init__(
        self, plant: BelievedPlant, load_range: tuple[float, float], rate_drift: float, load_drift: float = 0.0
    ) -> None:
        super().__init__(plant, load_range[1], rate_drift)
        self.drift[-2:, -2:] += (load_drift * load_range[1]) ** 2 * np.eye(2)
        factors = plant.factors(plant.ranges.T).get("stiffness", np.ones(1))
        self.relative_range = load_range[0] / float(factors.max()), load_range[1] / float(factors.min())

    def first(self, observed: DecodedObservation, looks: int = 1) -> Belief:
        """Of arms at rest, whose tip is seen, or is the mean of so many looks."""
        n, joints, p = len(observed), self.joints, len(self.plant.names)
        size = 2 * joints + p + 2
        mean, covariance = np.zeros((n, size)), np.zeros((n, size, size))
        for i in range(n):
            load, weight, q = self._sampled(observed.inputs[i], observed.tip[i], looks)
            rows = np.zeros((len(load), size))
            rows[:, :joints] = q
            rows[:, 2 * joints : 2 * joints + p] = self._prior(len(load))
            factor = self.plant.factors(rows[:, 2 * joints : 2 * joints + p]).get("stiffness", np.ones(len(load)))
            rows[:, -2:] = load * factor[:, None]
            mean[i] = weight @ rows
            covariance[i] = np.einsum("k,ki,kj->ij", weight, rows - mean[i], rows - mean[i])
        least = [FLOOR] * joints + [_STILL] * joints + [0.0] * p + [_LEAST * self.largest_load] * 2
        covariance += np.diag(np.array(least) ** 2)
        return Belief(mean, covariance, observed.inputs, np.zeros_like(observed.inputs))

    def _prior(self, count: int) -> np.ndarray:
        """Parameters from their ranges, (count, p)."""
        low, high = self.plant.ranges.T
        return np.asarray(np.random.default_rng(1).uniform(low, high, (count, len(low))))

    def _sampled(self, inputs: np.ndarray, tip: np.ndarray, looks: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Loads (k, 2) [N] relative to the stiffness, their weights (k,), and postures (k, 3) [rad]."""
        arm, rng, (low, high) = self.plant.core.nominal, np.random.default_rng(0), self.relative_range
        bare = np.repeat(inputs[None], _SAMPLES, axis=0)
        radius, angle = np.maximum(rng.uniform(low, high, _SAMPLES), _TINY), rng.uniform(-np.pi, np.pi, _SAMPLES)
        load, proposed = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), 1 / radius
        sigma, noise = _FIRST_SIGMA, max(FLOOR, float(np.sqrt(self.tip_noise[0, 0] / looks)))
        found: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        while True:
            q = loaded_postures(arm, bare, load)
            off = np.hypot(*(np.stack(arm.tip(tuple(q.T)), axis=1) - tip).T)
            size = np.hypot(*load.T)
            prior = np.where((size >= low) & (size <= high), 1 / np.maximum(size, _TINY), 0.0)
            with np.errstate(divide="ignore"):
                rank = np.log(prior / proposed) - off**2 / (2 * sigma**2)
            rank = np.where(np.isfinite(rank), rank, -np.inf)
            if not np.isfinite(rank).any():  # none fits; a larger sigma had some, or nothing is known
                return found if found is not None else (load, np.full(_SAMPLES, 1 / _SAMPLES), np.nan_to_num(q))
            weight = np.exp(rank - rank.max())
            weight /= weight.sum()
            kept = weight > 0
            found = load[kept], weight[kept], q[kept]
            if sigma <= noise:
                return found
            mean = weight @ load
            spread = np.einsum("k,ki,kj->ij", weight, load - mean, load - mean)
            spread = _WIDER**2 * spread + (_LEAST * high) ** 2 * np.eye(2)
            normal = rng.normal(size=(_SAMPLES, 2))
            load = mean + normal @ np.linalg.cholesky(spread).T
            proposed = np.exp(-(normal**2).sum(axis=1) / 2)
            sigma = max(noise, _FALLS * sigma)
