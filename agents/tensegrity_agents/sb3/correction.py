"""An agent that corrects an analytic controller's plan: residual learning [Johannink2019] about a path of inputs.

The controller, one of those that plan the inputs of an episode when it begins (`controllers.regulated.FullSpeedPlan`),
says where the inputs u are to be after each step, u*_k. The agent's output d moves that by up to `by` steps of the
inputs' rate, and the environment's action is

    a_k = clip((u*_k - u_k) / rate + by d_k, -1, 1),    u_(k+1) = clip(u_k + rate a_k).

u is the controller's own command: where a delay holds actions back, measured inputs would ask for the same step twice.
Appended to the entry "observation" are, in steps, how far the command is from u*_k, from where it is to be two steps
later, and from the plan's end. At the plan's end and with d = 0 the inputs rest where the controller has them.

[Johannink2019] Johannink, Bahl, Nair, Luo, Kumar, Loskyll, Ojea, Solowjow, Levine, "Residual reinforcement learning for
robot control", ICRA 2019.
"""

from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from tensegrity_agents.controllers.base import beginning, with_rows
from tensegrity_agents.controllers.regulated import FullSpeedPlan
from tensegrity_agents.sb3.augmented import as_batch, with_numbers

_NEAR, _FAR = 3.0, 10.0  # steps that are shown as 1, of what is near along the plan and of its end
_MOST = 3.0  # what is shown of the former at most
_LATER = 2  # steps


class Course(NamedTuple):
    """What is remembered of n episodes.

    Attributes:
        plan: inputs after each step, shape (n, steps, inputs).
        command: the inputs that have been asked for, shape (n, inputs).
        step: of the episode, shape (n,).
    """

    plan: Any
    command: Any
    step: Any


class Correction:
    """Shows an agent the plan of a controller, and makes the environment's actions of the agent's corrections.

    Args:
        planner: the controller.
        by: largest correction, in steps of the inputs' rate.
    """

    def __init__(self, planner: FullSpeedPlan, by: float) -> None:
        core = planner.core
        self.planner, self.by = planner, by
        simulation: Any = core.simulation
        self.rate, self.size = float(simulation.rate), int(simulation.action_size)
        self.low, self.high = (float(bound) for bound in simulation.bounds(core.nominal))
        self._observed = core.schema.size

    def space(self, space: spaces.Dict) -> spaces.Dict:
        """The observation space with what is shown of the plan."""
        size = int(np.prod(space["observation"].shape or ())) + 3 * self.size
        return spaces.Dict({**space.spaces, "observation": spaces.Box(-np.inf, np.inf, (size,), np.float32)})

    def __call__(
        self, observation: dict[str, Any], memory: Course | None = None, begins: np.ndarray | None = None
    ) -> tuple[dict[str, Any], Course]:
        """The observation or batch of n observations with what is shown of the plan, and what to remember.

        Args:
            observation: Dict of arrays, whatever else was appended to it.
            memory: what `acted` returned; None at first.
            begins: which of them begin an episode, shape (n,); by default none, but all without a memory.
        """
        batch = as_batch(observation)
        n = len(batch["observation"])
        fresh = np.flatnonzero(beginning(n, memory, begins))
        if memory is None or len(fresh):
            begun = self.begun({key: value[fresh] for key, value in batch.items()})
            memory = with_rows(memory, fresh, begun)
        return with_numbers(observation, self.shown(np, memory)), memory

    def begun(self, observation: dict[str, np.ndarray]) -> Course:
        """What is remembered of episodes that begin with these observations, shape (n, ...)."""
        own = {**observation, "observation": observation["observation"][:, : self._observed]}
        inputs = self.planner.decode(own).inputs.astype(np.float32)
        plan = self.planner.plan_for(own).astype(np.float32)
        return Course(plan, inputs, np.zeros(len(plan), np.int64))

    def asked(self, observation: dict[str, np.ndarray], course: Course) -> Course:
        """What is remembered one step later, with these observations: a plan stays what it is."""
        return course

    def shown(self, xp: Any, course: Course) -> Any:
        """What is appended to observations, shape (n, 3 inputs).

        Args:
            xp: numpy or torch, whose arrays are in the memory.
            course: the memory.
        """
        near = [self._off(xp, course, later) / _NEAR for later in (0, _LATER)]
        end = (course.plan[:, -1] - course.command) / (_FAR * self.rate)
        return xp.concatenate([*(xp.clip(part, -_MOST, _MOST) for part in near), end], axis=1)

    def action(self, xp: Any, course: Course, corrections: Any) -> Any:
        """The environment's actions, shape (n, inputs), for corrections within [-1, 1]."""
        return xp.clip(self._off(xp, course, 0) + self.by * corrections, -1.0, 1.0)

    def bounded(self, xp: Any, course: Course, actions: Any) -> Any:
        """What of these actions moves the inputs: nothing where they are at a bound. Agents remember that."""
        return (self.after(xp, course, actions).command - course.command) / self.rate

    def after(self, xp: Any, course: Course, actions: Any) -> Course:
        """What is remembered after actions of the environment."""
        command = xp.clip(course.command + self.rate * actions, self.low, self.high)
        return course._replace(command=command, step=course.step + 1)

    def _off(self, xp: Any, course: Course, later: int) -> Any:
        """How far the command is from the plan, in steps of the rate."""
        steps = xp.clip(course.step + later, 0, course.plan.shape[1] - 1)
        rows = xp.arange(len(steps))
        return (course.plan[rows, steps] - course.command) / self.rate

    def applied(self, memory: Course, actions: np.ndarray) -> np.ndarray:
        """The environment's actions for those of the agent, of shape (n, inputs) or of one environment."""
        corrections = np.reshape(actions, (-1, self.size)).astype(np.float32)
        given = self.bounded(np, memory, self.action(np, memory, corrections))
        within: np.ndarray = np.clip(given, -1.0, 1.0)  # rounding may have led beyond
        return within.reshape(np.shape(actions))

    def acted(self, memory: Course, actions: np.ndarray) -> Course:
        """What to remember after these actions of the environment."""
        return self.after(np, memory, np.reshape(actions, (-1, self.size)).astype(np.float32))
