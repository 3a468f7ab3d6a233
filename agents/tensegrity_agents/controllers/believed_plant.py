"""The simulation of a dynamic environment as a controller knows it: nominal, but for parameters that it estimates.

What is uncertain is drawn from ranges that are documented (`tensegrity_envs.uncertainty`); the true values stay hidden.
Factors x of damping and friction, whose ranges go over a factor of four, are told as log x, the others as x - 1: all
estimates are 0 for the nominal arm.
"""

from typing import Any

import numpy as np

from tensegrity_envs.core import Core

FACTORS = ("stiffness", "mass", "damping", "friction", "bandwidth")
_LOGARITHMIC = ("damping", "friction")
_GRID = 0.02  # of the prior's deviation: estimates that are closer share a model
_KEPT = 4000  # models


class BelievedPlant:
    """A dynamic environment's simulation, of many arms at once, each with the parameters that are believed of it.

    Args:
        core: of the environment; joints of hinges.

    Attributes:
        names: of the uncertain factors.
        ranges: of their estimates, shape (p, 2).
        variance: of an estimate before anything was seen, shape (p,).
        joints: how many coordinates there are.
    """

    def __init__(self, core: Core) -> None:
        engine = core.engine
        assert engine is not None
        self.core, self.model = core, engine.model
        drawn = {name: getattr(core.randomization, name) for name in FACTORS}
        drawn = {name: given for name, given in drawn.items() if given is not None and given[0] < given[1]}
        self.names = tuple(drawn)
        ranges = [[self._told(name, end) for end in given] for name, given in drawn.items()]
        self.ranges = np.array(ranges, float).reshape(-1, 2)
        self.variance = (self.ranges[:, 1] - self.ranges[:, 0]) ** 2 / 12
        self.joints = int(engine.joints)
        self._models: dict[tuple[float, ...], Any] = {}

    @staticmethod
    def _told(name: str, factor: float) -> float:
        return float(np.log(factor)) if name in _LOGARITHMIC else factor - 1.0

    def factors(self, estimates: np.ndarray) -> dict[str, np.ndarray]:
        """The factors by name, each (n,), of estimates (n, p)."""
        columns = zip(self.names, estimates.T, strict=True)
        return {name: np.exp(x) if name in _LOGARITHMIC else 1.0 + x for name, x in columns}

    def mechanism(self, estimates: np.ndarray) -> Any:
        """The analytic mechanism of n arms."""
        core: Any = self.core
        known = {name: x for name, x in self.factors(estimates).items() if name in ("stiffness", "mass")}
        return core.mechanism(core.design_of(known))

    def follows(self, estimates: np.ndarray) -> np.ndarray:
        """Share of the way to a command that an actuator goes in a step, (n,)."""
        dynamics = self.model.dynamics
        if not dynamics.time_constant:
            return np.ones(len(estimates))
        factor = self.factors(estimates).get("bandwidth", np.ones(len(estimates)))
        return np.asarray(1 - np.exp(-dynamics.step_time * factor / dynamics.time_constant))

    def models(self, estimates: np.ndarray) -> list[Any] | None:
        """MuJoCo's models of n arms, to within a hundredth of the prior's deviation; None if nothing is uncertain."""
        if not self.names:
            return None
        unit = _GRID * np.sqrt(self.variance)
        places = np.round(estimates / unit)
        return [self._model(tuple(place), unit) for place in places.tolist()]

    def _model(self, place: tuple[float, ...], unit: np.ndarray) -> Any:
        if place not in self._models:
            core: Any = self.core
            own = {name: float(x[0]) for name, x in self.factors(np.array([place]) * unit).items()}
            model = self.model.variant(core.mechanism(core.design_of(own)), self.model.dynamics.varied(own))
            if len(self._models) >= _KEPT:
                del self._models[next(iter(self._models))]
            self._models[place] = model
        return self._models[place]

    def actuation(self, inputs: np.ndarray) -> np.ndarray:
        """What the actuators do under inputs (n, inputs), shape (n, actuators)."""
        simulation: Any = self.core.simulation
        return np.stack(simulation.actuation(self.core.nominal, tuple(inputs.T)), axis=1)

    def states(self, q: np.ndarray, rates: np.ndarray, reached: np.ndarray) -> np.ndarray:
        """The engine's states (n, ...) of arms in q (n, joints) with these rates, whose actuators have reached this."""
        limit = self.model.linkage.limit
        reached = np.clip(reached, *self.model.input_bounds)
        return np.asarray(self.model.state(np.clip(q, -limit, limit), rates, reached))

    def moved(
        self, states: np.ndarray, actuation: np.ndarray, models: list[Any] | None, load: np.ndarray | None = None
    ) -> np.ndarray:
        """The states a step later under constant commands (n, actuators) and tip forces (n, 2) [N]."""
        actuation = np.clip(actuation, *self.model.input_bounds)
        return np.asarray(self.model.rollout(states, actuation, load, models=models).states)

    def read(self, states: np.ndarray) -> np.ndarray:
        """Joint angles and their rates (n, 2 joints)."""
        return np.concatenate([self.model.configuration(states), self.model.velocity(states)], axis=1)
