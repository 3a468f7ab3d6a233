"""An extended Kalman filter of an arm in motion and of the parameters in which it differs from the nominal one.

Its state is x = (q, dq/dt, p), p being the parameters of `believed_plant` that an environment randomizes, and the tip
force where it is hidden, which stay as they are. With F the derivative of a step of the believed simulation, by
differences, it does

    x <- f(x, u),  P <- F P F^T + Q,
    S = H P H^T + R,  K = P H^T S^-1,  x <- x + K (z - h(x)),  P <- (1 - K H) P (1 - K H)^T + K R K^T

for what is measured, z = (q, tip, dq/dt): joint angles with the documented angle noise, the tip with the documented tip
noise, rates (which have none) with `RATE_FLOOR`, by which a step of the simulation may be wrong. Where joints are not
observed, z = (tip, d tip/dt), the latter without noise, too. P begins with the variance of the documented ranges of p,
and p is kept within them. What the actuators have reached follows from the inputs, which are measured without noise,
and from the bandwidth that is believed.
"""

from typing import NamedTuple

import numpy as np

from tensegrity_agents.controllers.base import jacobian_at
from tensegrity_agents.controllers.believed_plant import BelievedPlant
from tensegrity_envs.observation import DecodedObservation

_ANGLE_STEP, _RATE_STEP = 1e-4, 1e-3  # of differences [rad], [rad/s]
_SHARE = 0.5  # of differences in parameters, of their deviation
_LOAD_STEP = 0.03  # of differences in the load, of the largest
FLOOR = 1e-4  # [rad] or [m]: errors of angles and tips that are reckoned with at least
RATE_FLOOR = 0.03  # [rad/s]
VELOCITY_FLOOR = 0.002  # [m/s]: likewise of the tip
_DRIFT = 1e-4  # [rad]: error of a step in the angles


class Belief(NamedTuple):
    """What is believed of n arms.

    Attributes:
        mean: (q, dq/dt, p), shape (n, 2 joints + parameters), the tip force [N] last where it is hidden.
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
        largest_load: of a hidden tip force [N]; 0 if there is none.
        rate_drift: error of a step in the rates [rad/s].

    Attributes:
        is_needed: whether there is noise or anything uncertain; otherwise the measured state is the belief.
    """

    def __init__(self, plant: BelievedPlant, largest_load: float = 0.0, rate_drift: float = RATE_FLOOR) -> None:
        self.plant, self.joints = plant, plant.joints
        drawn, joints = plant.core.randomization, plant.joints
        self.largest_load, self.axes = largest_load, 2 if largest_load else 0
        self.is_needed = drawn.is_noisy or bool(plant.names) or bool(largest_load)
        deviations = [drawn.angle_noise] * joints + [drawn.tip_noise] * 2
        self.noise = np.diag(np.concatenate([np.maximum(deviations, FLOOR), np.full(joints, RATE_FLOOR)]) ** 2)
        at_tip = [max(drawn.tip_noise, FLOOR)] * 2 + [VELOCITY_FLOOR] * 2
        self.tip_noise = np.diag(np.array(at_tip) ** 2)
        kept = [0.0] * (len(plant.names) + self.axes)
        self.drift = np.diag([_DRIFT**2] * joints + [rate_drift**2] * joints + kept)

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
        return belief.mean[:, 2 * self.joints :][:, : len(self.plant.names)]

    def load(self, belief: Belief) -> np.ndarray | None:
        """The tip force that is believed, (n, 2) [N]; None where none is hidden."""
        return belief.mean[:, -self.axes :] if self.axes else None

    def moved(self, belief: Belief, inputs: np.ndarray) -> Belief:
        """What is believed a step later, in which these inputs (n, inputs) were commanded."""
        plant, estimates = self.plant, self.estimates(belief)
        share = plant.follows(estimates)[:, None]
        reached = belief.reached + share * (inputs - belief.reached)
        if not self.is_needed:
            return belief._replace(reached=reached)
        slopes, end = self._slopes(belief, inputs)
        mean = np.concatenate([end, belief.mean[:, 2 * self.joints :]], axis=1)
        covariance = slopes @ belief.covariance @ slopes.transpose(0, 2, 1) + self.drift
        lag = belief.lag
        if "bandwidth" in plant.names:
            h = 1e-4
            other = estimates.copy()
            other[:, plant.names.index("bandwidth")] += h
            slope = (plant.follows(other)[:, None] - share) / h
            lag = (1 - share) * lag + slope * (inputs - belief.reached)
        return Belief(mean, covariance, reached, lag)

    def _slopes(self, belief: Belief, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F (n, size, size), and angles and rates (n, 2 joints) at the end of a step.

        Derivatives in the parameters are taken about multiples of the differences, whose models are used again.
        """
        plant, size, axes = self.plant, 2 * self.joints, self.axes
        n, p = len(inputs), len(plant.names)
        runs = 1 + size + 2 * p + axes
        estimates = self.estimates(belief)
        steps = np.array([_ANGLE_STEP] * self.joints + [_RATE_STEP] * self.joints)
        units = _SHARE * np.sqrt(plant.variance)
        near = np.round(estimates / units) * units
        starts = (
            belief.mean[:, :size]
            + np.concatenate([np.zeros((1, size)), np.diag(steps), np.zeros((2 * p + axes, size))])[:, None]
        )
        believed = np.repeat(estimates[None], runs, axis=0)
        believed[1 + size : runs - axes] = near
        reached = np.repeat(belief.reached[None], runs, axis=0)
        for k, name in enumerate(plant.names):
            for place, sign in ((1 + size + k, 1), (1 + size + p + k, -1)):
                believed[place, :, k] += sign * units[k]
                if name == "bandwidth":
                    reached[place] += sign * units[k] * belief.lag
        load, unit = self.load(belief), _LOAD_STEP * self.largest_load
        if load is not None:
            loads = np.repeat(load[None], runs, axis=0)
            loads[runs - axes :] += unit * np.eye(axes)[:, None]
            load = _rows(loads)
        flat = starts.reshape(-1, size)
        states = plant.states(flat[:, : self.joints], flat[:, self.joints :], plant.actuation(_rows(reached)))
        commands = np.tile(plant.actuation(inputs), (runs, 1))
        ends = plant.read(plant.moved(states, commands, plant.models(_rows(believed)), load)).reshape(-1, n, size)
        slopes = np.tile(np.eye(size + p + axes), (n, 1, 1))
        slopes[:, :size, :size] = ((ends[1 : 1 + size] - ends[0]) / steps[:, None, None]).transpose(1, 2, 0)
        between = ends[1 + size : 1 + size + p] - ends[1 + size + p : runs - axes]
        slopes[:, :size, size : size + p] = (between / (2 * units[:, None, None])).transpose(1, 2, 0)
        if load is not None:
            slopes[:, :size, size + p :] = ((ends[runs - axes :] - ends[0]) / unit).transpose(1, 2, 0)
        return slopes, ends[0]

    def measured(self, belief: Belief, observed: DecodedObservation) -> Belief:
        """What is believed after a measurement."""
        joints, p = self.joints, len(self.plant.names)
        if not self.is_needed:
            return belief._replace(mean=np.concatenate([observed.joint_angles, observed.joint_rates], axis=1))
        seen_of = self._joints_seen if "joint_angles" in observed else self._tip_seen
        off, h, noise = seen_of(belief.mean, observed)
        mean, covariance = corrected(belief.mean, belief.covariance, off, h, noise)
        known = slice(2 * joints, 2 * joints + p)
        mean[:, known] = np.clip(mean[:, known], *self.plant.ranges.T)
        if self.axes:
            load = mean[:, -self.axes :]
            load *= np.minimum(1.0, self.largest_load / np.maximum(np.hypot(*load.T), 1e-12))[:, None]
        return belief._replace(mean=mean, covariance=covariance)

    def _joints_seen(self, mean: np.ndarray, observed: DecodedObservation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How far angles, tip, rates are from what is expected (n, k), its derivatives (n, k, size), noise (k, k)."""
        arm, joints, (n, size) = self.plant.core.nominal, self.joints, mean.shape
        q = tuple(mean[:, :joints].T)
        tip = np.stack(arm.tip(q), axis=1)
        h = np.zeros((n, 2 * joints + 2, size))
        h[:, :joints, :joints] = np.eye(joints)
        h[:, joints : joints + 2, :joints] = jacobian_at(arm, q)
        h[:, joints + 2 :, joints : 2 * joints] = np.eye(joints)
        seen = np.concatenate([observed.joint_angles, observed.tip, observed.joint_rates], axis=1)
        off = seen - np.concatenate([mean[:, :joints], tip, mean[:, joints : 2 * joints]], axis=1)
        return off, h, self.noise

    def _tip_seen(self, mean: np.ndarray, observed: DecodedObservation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same of the tip and its velocity."""
        arm, joints = self.plant.core.nominal, self.joints
        q, rates = mean[:, :joints], mean[:, joints : 2 * joints]

        def velocity(at: np.ndarray) -> np.ndarray:
            return np.asarray(np.einsum("nij,nj->ni", jacobian_at(arm, tuple(at.T)), rates))

        jacobian, here = jacobian_at(arm, tuple(q.T)), velocity(q)
        bends = [(velocity(q + _ANGLE_STEP * e) - here) / _ANGLE_STEP for e in np.eye(joints)]
        h = np.zeros((len(mean), 4, mean.shape[1]))
        h[:, :2, :joints] = h[:, 2:, joints : 2 * joints] = jacobian
        h[:, 2:, :joints] = np.stack(bends, axis=2)
        expected = np.concatenate([np.stack(arm.tip(tuple(q.T)), axis=1), here], axis=1)
        return np.concatenate([observed.tip, observed.tip_velocity], axis=1) - expected, h, self.tip_noise


def _rows(values: np.ndarray) -> np.ndarray:
    """Values (k, n, m) as rows (k n, m)."""
    return values.reshape(values.shape[0] * values.shape[1], values.shape[2])
