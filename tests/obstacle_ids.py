"""Environments among obstacles: the ids that there are, and the arms that have none, under ids of the tests."""

import gymnasium as gym

import tensegrity_envs

# By the name of the arm, the id that it is an option of.
_ARMS = {"TwoXObstacleReach": "TwoXReach", "PlanarFourBarObstacleReach": "PlanarFourBarReach"}
IDS = [env_id for env_id in tensegrity_envs.ENV_IDS if "Obstacle" in env_id]
for _arm, _id in _ARMS.items():
    _spec = gym.spec(f"tensegrity/{_id}-v0")
    IDS.append(f"tests/{_arm}-v0")
    if IDS[-1] not in gym.registry:
        gym.register(
            IDS[-1],
            entry_point=_spec.entry_point,
            vector_entry_point=_spec.vector_entry_point,
            max_episode_steps=_spec.max_episode_steps,
            kwargs={**_spec.kwargs, "arm": _arm},
        )
