"""A word to callers of `predict` who do not hand back what is to be remembered."""

import warnings

_MANY = 8  # calls in a row; fewer may be the beginnings of as many episodes


class Reminder:
    """Warns once where many calls in a row have no state.

    One without is the beginning of an episode; many are most often a loop that has forgotten it, in which every step
    begins an episode anew: plans are made again, and nothing is learned about a hidden load.

    Args:
        what: asks for the state, in words.
    """

    def __init__(self, what: str) -> None:
        self.what, self.without, self.has_warned = what, 0, False

    def __call__(self, state: object) -> None:
        """Take note of a call with this state."""
        self.without = self.without + 1 if state is None else 0
        if self.without == _MANY and not self.has_warned:
            self.has_warned = True
            warnings.warn(
                f"{self.what} was called {_MANY} times in a row without a state, and begins an episode in each call. "
                "Within an episode, hand back the state that it returned: "
                "actions, state = predict(observation, state, episode_start)",
                stacklevel=3,
            )
