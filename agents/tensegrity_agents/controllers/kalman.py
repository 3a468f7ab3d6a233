"""An extended Kalman filter of an arm in motion and of the parameters in which it differs from the nominal one.

Its state is x = (q, dq/dt, p), p being the parameters of `believed_plant` that an environment randomizes, which stay
as they are. With F the derivative of a step of the believed simulation, by differences, it does

    x <- f(x, u),  P <- F P F^T + Q,
    S = H P H^T + R,  K = P H^T S^-1,  x <- x + K (z - h(x)),  P <- (1 - K H) P (1 - K H)^T + K R K^T

for what is measured, z = (q, tip, dq/dt): joint angles with the documented angle noise, the tip with the documented tip
noise, rates (which have none) with `RATE_FLOOR`, by which a step of the simulation may be wrong. P begins with the
variance of the documented ranges of p, and p is kept within them. What the actuators have reached follows from the
inputs, which are measured without noise, and from the bandwidth that is believed.
"""

from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.believed_plant import GRID, BelievedPlant
from tensegrity_envs.observation import DecodedObservation

_ANGLE_STEP, _RATE_STEP = 1e-4, 1e-3  # of differences [rad], [rad/s]
_SHARE = 10 * GRID  # of differences in parameters, of their deviation
FLOOR = 1e-4  # [rad] or [m]: errors of angles and tips that are reckoned with at least
RATE_FLOOR = 0.03  # [rad/s]
_DRIFT = 1e-4  # [rad]: error of a step in the angles


class Belief(NamedTuple):
    """What is believed of n arms.

    Attributes:
        mean: (q, dq/dt, p), shape (n, 2 joints + parameters).
        covariance: of these, shape (n, size, size).
        reached: inputs that the actuators have reached, shape (n, inputs).
        lag: derivative of that by the estimate of the bandwidth, shape (n, inputs).
    """

    mean: np.ndarray
    covariance: np.ndarray
    reached: np.ndarray
    lag: np.ndarray


def corrected(
    mean: np.ndarray, covariance: np.ndarray, off: np.ndarray, h: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n, m) and covariance (n, m, m) after a measurement that is off by `off` (n, k), with the derivatives h
    (n, k, m) and the covariance `noise` (k, k) of its errors. In Joseph's form, which stays symmetric and positive.
    """
    across = covariance @ h.transpose(0, 2, 1)
    gain = across @ np.linalg.inv(h @ across + noise)
    rest = np.eye(mean.shape[1]) - gain @ h
    left = rest @ covariance @ rest.transpose(0, 2, 1) + gain @ noise @ gain.transpose(0, 2, 1)
    return mean + (gain @ off[..., None])[..., 0], left


class ArmFilter:
    """See the module.

    Args:
        plant: what is believed.

    Attributes:
        is_needed: whether there is noise or anything uncertain; otherwise the measured state is the belief.
    """

    def __init__(self, plant: BelievedPlant) -> None:
        self.plant, self.joints = plant, plant.joints
        drawn, joints = plant.core.randomization, plant.joints
        self.is_needed = drawn.is_noisy or bool(plant.names)
        deviations = [drawn.angle_noise] * joints + [drawn.tip_noise] * 2
        self.noise = np.diag(np.concatenate([np.maximum(deviations, FLOOR), np.full(joints, RATE_FLOOR)]) ** 2)
        self.drift = np.diag([_DRIFT**2] * joints + [RATE_FLOOR**2] * joints + [0.0] * len(plant.names))

    def first(self, observed: DecodedObservation) -> Belief:
        """Of arms at rest where they are seen, with the nominal parameters."""
        n, joints, p = len(observed), self.joints, len(self.plant.names)
        mean = np.concatenate([observed.joint_angles, np.zeros((n, joints + p))], axis=1)
        mean[:, 2 * joints :] = self.plant.ranges.mean(axis=1)
        spread = [self.noise[0, 0]] * joints + [FLOOR**2] * joints
        covariance = np.tile(np.diag(np.concatenate([spread, self.plant.variance])), (n, 1, 1))
        belief = Belief(mean, covariance, observed.inputs, np.zeros_like(observed.inputs))
        return self.measured(belief, observed)

    def estimates(self, belief: Belief) -> np.ndarray:
        """Of the parameters, (n, p)."""
        return belief.mean[:, 2 * self.joints :]

    def moved(self, belief: Belief, inputs: np.ndarray) -> Belief:
        """What is believed a step later, in which these inputs (n, inputs) were commanded."""
        plant, joints = self.plant, self.joints
        estimates = self.estimates(belief)
        share = plant.follows(estimates)[:, None]
        reached = belief.reached + share * (inputs - belief.reached)
        if not self.is_needed:
            return belief._replace(reached=reached)
        n, size = belief.mean.shape
        steps = np.array([_ANGLE_STEP] * joints + [_RATE_STEP] * joints + list(_SHARE * np.sqrt(plant.variance)))
        lags = np.zeros((size + 1, 1, 1))
        if "bandwidth" in plant.names:
            lags[1 + 2 * joints + plant.names.index("bandwidth")] = steps[2 * joints + plant.names.index("bandwidth")]
        points = belief.mean + np.concatenate([np.zeros((1, size)), np.diag(steps)])[:, None]
        began = (belief.reached + lags * belief.lag).reshape(-1, inputs.shape[1])
        flat = points.reshape(-1, size)
        models = self._models(points)
        states = plant.states(flat[:, :joints], flat[:, joints : 2 * joints], plant.actuation(began))
        ends = plant.read(plant.moved(states, np.tile(plant.actuation(inputs), (size + 1, 1)), models))
        ends = ends.reshape(size + 1, n, 2 * joints)
        slopes = np.tile(np.eye(size), (n, 1, 1))
        slopes[:, : 2 * joints] = ((ends[1:] - ends[0]) / steps[:, None, None]).transpose(1, 2, 0)
        mean = np.concatenate([ends[0], estimates], axis=1)
        covariance = slopes @ belief.covariance @ slopes.transpose(0, 2, 1) + self.drift
        lag = belief.lag
        if "bandwidth" in plant.names:
            h = 1e-4
            other = estimates.copy()
            other[:, plant.names.index("bandwidth")] += h
            slope = (plant.follows(other)[:, None] - share) / h
            lag = (1 - share) * lag + slope * (inputs - belief.reached)
        return Belief(mean, covariance, reached, lag)

    def _models(self, points: np.ndarray) -> list[object] | None:
        """MuJoCo's models at the points (1 + size, n, size) of the differences."""
        plant, joints = self.plant, self.joints
        own = plant.models(points[0, :, 2 * joints :])
        if own is None:
            return None
        models = own * (1 + 2 * joints)
        for k in range(len(plant.names)):
            models += plant.models(points[1 + 2 * joints + k, :, 2 * joints :]) or []
        return models

    def measured(self, belief: Belief, observed: DecodedObservation) -> Belief:
        """What is believed after a measurement."""
        joints = self.joints
        if not self.is_needed:
            return belief._replace(mean=np.concatenate([observed.joint_angles, observed.joint_rates], axis=1))
        arm, (n, size) = self.plant.core.nominal, belief.mean.shape
        q = tuple(belief.mean[:, :joints].T)
        tip = np.stack(arm.tip(q), axis=1)
        h = np.zeros((n, 2 * joints + 2, size))
        h[:, :joints, :joints] = np.eye(joints)
        h[:, joints : joints + 2, :joints] = np.stack([np.stack(row, axis=1) for row in arm.jacobian(q)], axis=1)
        h[:, joints + 2 :, joints : 2 * joints] = np.eye(joints)
        seen = np.concatenate([observed.joint_angles, observed.tip, observed.joint_rates], axis=1)
        off = seen - np.concatenate([belief.mean[:, :joints], tip, belief.mean[:, joints : 2 * joints]], axis=1)
        mean, covariance = corrected(belief.mean, belief.covariance, off, h, self.noise)
        mean[:, 2 * joints :] = np.clip(mean[:, 2 * joints :], *self.plant.ranges.T)
        return belief._replace(mean=mean, covariance=covariance)
