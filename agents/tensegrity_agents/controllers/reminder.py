"""A word to callers of `predict` who do not hand back what is to be remembered."""

import warnings


class Reminder:
    """Warns once where two calls in a row have no state.

    One without is the beginning of an episode; two are most often a loop that has forgotten it, in which every step
    begins an episode anew: plans are made again, and nothing is learned about a hidden load.

    Args:
        what: asks for the state, in words.
    """

    def __init__(self, what: str) -> None:
        self.what, self.without = what, 0

    def __call__(self, state: object) -> None:
        """Take note of a call with this state."""
        self.without = self.without + 1 if state is None else 0
        if self.without == 2:
            warnings.warn(
                f"{self.what} was called twice without a state, and begins an episode in each call. Within an episode, "
                "hand back the state that it returned: actions, state = predict(observation, state, episode_start)",
                stacklevel=3,
            )
