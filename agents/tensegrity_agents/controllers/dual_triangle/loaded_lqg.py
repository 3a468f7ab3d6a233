"""LQG of a dual-triangle arm whose joints are not seen and whose load is hidden.

The filter (`loaded_filter`, `kalman`) believes in angles, rates, parameters and the load. The inputs are held for
`look` steps; the mean of the tip in these, at rest, is what it begins with. The load is reckoned to drift a little: a
belief that went wrong where the motion is far from linear is unlearned again. Then a joint path is chosen as the
observer does (`planning.choose_posture`), for the load that is believed: a posture has its tip at the target whatever
the load is, so that a belief that changes moves no path, only the torques that hold it. Every `again` steps the rest of
the path is looked at under the load of then; where its clearance (the least of stability margin, distance to the joint
limits and to the bounds of the inputs) is below `narrow`, and another path from there has more, that one is taken.
Regulator, delay and integral action are those of `lqg`.
"""

from typing import Any, ClassVar

import numpy as np

from tensegrity_agents.controllers.base import with_rows
from tensegrity_agents.controllers.delay_line import first_line
from tensegrity_agents.controllers.dual_triangle.loaded_filter import LoadedFilter
from tensegrity_agents.controllers.dual_triangle.planning import choose_posture, course, validity
from tensegrity_agents.controllers.dual_triangle.reach import Observer
from tensegrity_agents.controllers.lqg import KNOWS, LQG, LQGMemory
from tensegrity_agents.controllers.resting import ends_of_plans
from tensegrity_envs.core import Core
from tensegrity_envs.observation import DecodedObservation

_STEPS = 140  # of a path
_STILL = 1e-6  # [rad]
_MORE = 0.01  # clearance by which another path must be better
_NEVER = 10**6
_LEAST_LOAD = 1e-3  # critical loads: largest that is reckoned with at least
_CHANGE = 0.1  # of the largest load: beyond it gains and inputs are found anew


class LoadedLQG(LQG):
    """See the module. `more` of its memory: the path before corners are rounded (n, steps, joints) [rad], the load
    (n, 2) [N], relative to the stiffness, for which it was made, and the mean tip (n, 2) [m] of the first looks.

    Args:
        core: of the environment, a dynamic dual-triangle arm with a hidden load.
        softness: see `LQG`.
        smoothing: see `LQG`.
        integral: see `LQG`.
        speed: share of the full speed.
        look: steps in which the inputs are held.
        rate_drift: see `ArmFilter`.
        load_drift: see `LoadedFilter`.
    """

    tunable: ClassVar[dict[str, tuple[float, ...]]] = {
        "softness": (0.3, 1.0, 3.0),
        "smoothing": (3, 5, 8),
        "speed": (0.5, 1.0),
        "look": (1, 10),
    }
    again = 5  # steps
    narrow = 0.05

    def __init__(
        self,
        core: Core,
        softness: float = 3.0,
        smoothing: int = 8,
        integral: float = 0.05,
        speed: float = 0.5,
        look: int = 10,
        rate_drift: float = 0.01,
        load_drift: float = 0.003,
    ) -> None:
        super().__init__(core, Observer, softness, smoothing, integral)
        self.speed, self.look = speed, int(look)
        sampler: Any = core.sampler  # type: ignore[attr-defined]
        low, high = sampler.load_range
        loads = float(sampler.critical) * low, float(sampler.critical) * max(high, _LEAST_LOAD)
        self.filter: LoadedFilter = LoadedFilter(self.plant, loads, rate_drift, load_drift)
        self.knows = KNOWS.format("angles, parameters and load")

    def initial(self, observed: DecodedObservation, index: np.ndarray) -> LQGMemory:
        """See `AnalyticController.initial`: nothing is planned yet."""
        belief, n = self.filter.first(observed), len(index)
        q = self._reachable(belief.mean)
        way = np.repeat(q[:, None], _STEPS, axis=1)
        plan = np.repeat(observed.inputs[:, None], _STEPS, axis=1)
        load = self._relative(belief.mean)
        inertia, gain = self._along(plan, way, np.zeros(n, int), load)
        line, step = first_line(observed.inputs, self.delays), np.zeros(n, int)
        end = np.full(n, _NEVER)
        return LQGMemory(plan, way, end, inertia, gain, 0 * q, belief, line, step, (way, load, observed.tip))

    def _reachable(self, mean: np.ndarray) -> np.ndarray:
        """The believed joint angles, which noise may have put beyond their limits, within these."""
        limit = self.model.linkage.limit
        return np.asarray(mean[:, : self.joints].clip(-limit, limit))

    def _relative(self, mean: np.ndarray) -> np.ndarray:
        """The believed load relative to the believed stiffness, (n, 2) [N]."""
        estimates = mean[:, 2 * self.joints :][:, : len(self.plant.names)]
        return np.asarray(mean[:, -2:] / self.plant.factors(estimates).get("stiffness", np.ones(len(mean)))[:, None])

    def _act(self, observed: DecodedObservation, memory: LQGMemory) -> tuple[np.ndarray, LQGMemory]:
        return super()._act(observed, self._looked(observed, memory))

    def _looked(self, observed: DecodedObservation, memory: LQGMemory) -> LQGMemory:
        """The memory after a look at arms at rest, which counts until the inputs are no longer held."""
        way, made, tip = memory.more
        new = tip + (observed.tip - tip) / (memory.step + 1)[:, None]
        tip = np.where((memory.step <= self.look)[:, None], new, tip)
        memory = memory._replace(more=(way, made, tip))
        seen = np.flatnonzero(memory.step == self.look)
        if not len(seen):
            return memory
        belief = self.filter.first(observed.take(seen).replace(tip=tip[seen]), self.look + 1)
        return memory._replace(belief=with_rows(memory.belief, seen, belief))

    def _led(self, observed: DecodedObservation, memory: LQGMemory) -> LQGMemory:
        """The memory, with a path where there is none yet, and another where that is better."""
        since = memory.step - self.look
        due = np.flatnonzero((since >= 0) & (since % self.again == 0) & (memory.step < _STEPS - 1))
        if not len(due):
            return memory
        way, made, _ = (values.copy() for values in memory.more)
        load = self._relative(memory.belief.mean)
        changed = []
        for i in due:
            k = int(memory.step[i])
            first = k == self.look
            old = self._reachable(memory.belief.mean[i : i + 1]) if first else way[i, k:][::3]
            clearance = -np.inf if first else float(validity(self.nominal, float(self.high), old, load[i])[0].min())
            if clearance < self.narrow:
                goal, other = choose_posture(
                    self.nominal, float(self.high), old[:1], observed.target[i : i + 1], load[i : i + 1]
                )
                if other[0] > clearance + _MORE or first:
                    way[i, k:] = self._course(np.concatenate([old[:1], goal]), load[i], _STEPS - k)
                    changed.append(i)
                    continue
            if np.hypot(*(load[i] - made[i])) > _CHANGE * self.filter.largest_load:
                changed.append(i)
        if not changed:
            return memory
        return self._with_paths(memory, np.array(changed), way, made, load)

    def _course(self, path: np.ndarray, load: np.ndarray, steps: int) -> np.ndarray:
        return course(self.nominal, path, load, self.speed * self.rate, steps, 0.2 * self.speed)

    def _with_paths(
        self, memory: LQGMemory, index: np.ndarray, way: np.ndarray, made: np.ndarray, load: np.ndarray
    ) -> LQGMemory:
        """The memory with what follows from the ways of the environments at `index`."""
        made[index] = load[index]
        start = way[index, 0]
        path = self._averaged(start, way[index])[:, :_STEPS]
        columns = tuple(np.ascontiguousarray(path[..., j]).ravel() for j in range(self.joints))
        forces = tuple(np.repeat(load[index, j], _STEPS) for j in range(2))
        plan = np.stack(self.nominal.control(columns, forces), axis=1).reshape(path.shape)
        plan = np.clip(plan, self.low, self.high)
        ends = ends_of_plans(path, _STILL)
        found = dict(path=path, plan=plan, end=ends)
        found["inertia"], found["gain"] = self._along(plan, path, ends, load[index])
        news = {}
        for name, values in found.items():
            news[name] = getattr(memory, name).copy()
            news[name][index] = values
        return memory._replace(more=(way, made, memory.more[2]), **news)
