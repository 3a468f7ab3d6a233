"""An agent that corrects the actions of an analytic controller with feedback: residual learning [Johannink2019].

The controller sees what the agent sees, before anything is appended to it, and says what it would do, a. The agent's
output d says how far the command is to be from where the controller alone would have it, up to `by` steps of the
inputs' rate. With what was added so far, s,

    a' = clip(a + by d - s, -1, 1).

The controller is told a', and goes on from where that leads (`controllers.correctable`): with feedback, it plans from
there, and then s is zero. Appended to the entry "observation" are a, what the controller says of its intentions, and s.
With d = 0 the agent is the controller, and so it is while the controller holds the inputs to identify the arm.

[Johannink2019]: see `correction`.
"""

from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from tensegrity_agents.controllers.base import beginning, with_rows
from tensegrity_agents.controllers.correctable import Correctable
from tensegrity_agents.sb3.augmented import as_batch, with_numbers

_MOST = 3.0  # of what the controller says


class Advice(NamedTuple):
    """What is remembered of n episodes.

    Attributes:
        action: a of the module, shape (n, action size).
        added: s of the module, shape (n, action size); a tensor where gradients go by way of it.
        by: largest correction, shape (n, 1); 0 while the controller looks at rest.
        said: a and what the controller says of its intentions, shape (n, action size + outlook size).
        before: what it remembered when it was asked, a NamedTuple of arrays (n, ...).
        after: what it wants to be remembered.
    """

    action: np.ndarray
    added: Any
    by: np.ndarray
    said: np.ndarray
    before: Any
    after: Any


class FeedbackCorrection:
    """Asks a controller in every step, shows an agent what it says, and corrects that.

    Args:
        controller: which is asked.
        by: largest correction, in steps of the inputs' rate.
    """

    def __init__(self, controller: Correctable[Any], by: float) -> None:
        self.controller, self.by = controller, by
        self.size = int(controller.core.simulation.action_size)
        self._observed = controller.core.schema.size

    def space(self, space: spaces.Dict) -> spaces.Dict:
        """The observation space with what the controller says."""
        size = int(np.prod(space["observation"].shape or ())) + 2 * self.size + self.controller.outlook_size
        return spaces.Dict({**space.spaces, "observation": spaces.Box(-np.inf, np.inf, (size,), np.float32)})

    def __call__(
        self, observation: dict[str, Any], memory: Advice | None = None, begins: np.ndarray | None = None
    ) -> tuple[dict[str, Any], Advice]:
        """The observation or batch of n observations with what the controller says, and what to remember.

        Args:
            observation: Dict of arrays, whatever else was appended to it.
            memory: what `acted` returned; None at first.
            begins: which of them begin an episode, shape (n,); by default none, but all without a memory.
        """
        batch = as_batch(observation)
        asked = self._asked(batch, None if memory is None else memory.after, begins)
        return with_numbers(observation, self.shown(np, asked)), asked

    def begun(self, observation: dict[str, np.ndarray]) -> Advice:
        """What is remembered of episodes that begin with these observations, shape (n, ...)."""
        return self._asked(observation, None, None)

    def asked(self, observation: dict[str, np.ndarray], memory: Advice) -> Advice:
        """What is remembered one step after `memory`, with these observations, shape (n, ...)."""
        advice = self._asked(observation, memory.after, np.zeros(len(memory.action), bool))
        if not hasattr(memory.added, "detach"):
            return advice
        # What was added counts as the tensor, unless the controller has planned anew, from where that has led.
        told = memory.added.new_tensor(advice.added)
        goes_on = (told != 0).any(dim=1, keepdim=True)
        return advice._replace(added=told + goes_on * (memory.added - memory.added.detach()))

    def _asked(self, observation: dict[str, np.ndarray], before: Any, begins: np.ndarray | None) -> Advice:
        own = {**observation, "observation": observation["observation"][:, : self._observed]}
        observed = self.controller.decode(own)
        fresh = np.flatnonzero(beginning(len(observed), before, begins))
        if before is None or len(fresh):
            before = with_rows(before, fresh, self.controller.initial(observed.take(fresh), fresh))
        action, after = self.controller.act(observed, before)
        added = self.controller.added(after).astype(np.float32)
        said = np.concatenate([action, self.controller.outlook(observed, after)], axis=1)
        by = np.where(self.controller.looks_at_rest(after), 0.0, self.by)[:, None].astype(np.float32)
        return Advice(
            action.astype(np.float32), added, by, np.clip(said, -_MOST, _MOST).astype(np.float32), before, after
        )

    def shown(self, xp: Any, memory: Advice) -> Any:
        """What is appended to observations, shape (n, 2 action size + outlook size).

        Args:
            xp: numpy or torch.
            memory: what is remembered.
        """
        return xp.concatenate([xp.asarray(memory.said), xp.asarray(memory.added)], axis=1)

    def action(self, xp: Any, memory: Advice, corrections: Any) -> Any:
        """The environment's actions, shape (n, action size), for corrections within [-1, 1]."""
        return xp.clip(
            xp.asarray(memory.action) + xp.asarray(memory.by) * corrections - xp.asarray(memory.added), -1.0, 1.0
        )

    def bounded(self, xp: Any, memory: Advice, actions: Any) -> Any:
        """What of these actions counts: all."""
        return actions

    def after(self, xp: Any, memory: Advice, actions: Any) -> Advice:
        """What is remembered after actions of the environment; gradients go by way of what is added alone."""
        if not hasattr(actions, "detach"):
            return self.acted(memory, actions)
        added = xp.asarray(memory.added) + actions - xp.asarray(memory.action)
        return self.acted(memory, actions.detach().numpy())._replace(added=added)

    def applied(self, memory: Advice, actions: np.ndarray) -> np.ndarray:
        """The environment's actions for those of the agent, of shape (n, action size) or of one environment."""
        corrections = np.reshape(actions, (-1, self.size)).astype(np.float32)
        given: np.ndarray = self.action(np, memory, corrections)
        return given.reshape(np.shape(actions))

    def acted(self, memory: Advice, actions: np.ndarray) -> Advice:
        """What to remember after these actions of the environment."""
        taken = np.reshape(actions, (-1, self.size)).astype(float)
        return memory._replace(after=self.controller.given(memory.before, memory.after, taken))
