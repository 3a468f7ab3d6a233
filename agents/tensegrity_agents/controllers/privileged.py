"""What oracles share: they are told the truth."""

from typing import Any

import numpy as np

from tensegrity_envs.simulation import Episode


class Privileged:
    """Mixed into a controller that asks the evaluation for the true episodes."""

    wants_privileged = True

    def begin_episodes(self, mask: np.ndarray, design: Any, privileged: Episode | None = None) -> None:
        """Take the nominal design and the true episodes.

        Raises:
            ValueError: the evaluation did not hand over the true episodes.
        """
        if privileged is None:
            raise ValueError(
                f"{type(self).__name__}: needs the privileged episodes "
                "(evaluate it through tensegrity_agents.evaluation.rollout)"
            )
        super().begin_episodes(mask, design, privileged)  # type: ignore[misc]
