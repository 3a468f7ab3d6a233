"""All of `gymnasium.wrappers.vector` on native vectors: each gives what it gives on Gymnasium's own SyncVectorEnv.

Both run the same seeds and actions through the same wrapper, for some episodes, in Gymnasium's default mode NEXT_STEP.
"""

import os
import tempfile
from collections.abc import Callable
from typing import Any

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # HumanRendering opens a window

import gymnasium as gym
import gymnasium.wrappers.vector as wrappers
import numpy as np
import torch
from gymnasium.vector import VectorEnv
from gymnasium.wrappers import RescaleAction, TransformObservation, TransformReward
from report import IDS, Client, Inapplicable, must, same

import tensegrity_envs  # noqa: F401  (registers)

NUM_ENVS, STEPS = 3, 330  # more than two episodes of the longest id
PICTURES, SIDE = 12, 300  # steps of wrappers that draw; pixels
Vector = VectorEnv[Any, Any, Any]


def flat(envs: Vector) -> Vector:
    """The observations as one row each, for wrappers that take a Box."""
    return wrappers.FlattenObservation(envs)


def pictures(envs: Vector) -> Vector:
    """The rendered pictures as observations, for wrappers of pictures."""
    one = gym.spaces.Box(0, 255, (SIDE, SIDE, 3), np.uint8)
    batch = gym.vector.utils.batch_space(one, envs.num_envs)
    return wrappers.TransformObservation(envs, lambda _: np.stack(envs.render()), batch, one)


def array_conversion(envs: Vector) -> Vector:
    """NumPy arrays as Torch tensors, by the wrapper for any two array libraries."""
    return wrappers.ArrayConversion(envs, env_xp=np, target_xp=torch)


def of_jax(envs: Vector) -> Vector:
    """Wrappers of environments whose arrays are JAX's."""
    raise Inapplicable("for environments whose own arrays are JAX's")


NUMBERS: dict[str, Callable[[Vector], Vector]] = {
    "VectorizeTransformObservation": lambda e: wrappers.VectorizeTransformObservation(
        e,
        TransformObservation,
        func=lambda o: o["observation"],
        observation_space=e.single_observation_space["observation"],
    ),
    "VectorizeTransformAction": lambda e: wrappers.VectorizeTransformAction(
        e, RescaleAction, min_action=np.float32(-2), max_action=np.float32(2)
    ),
    "VectorizeTransformReward": lambda e: wrappers.VectorizeTransformReward(e, TransformReward, func=lambda r: 2 * r),
    "DictInfoToList": wrappers.DictInfoToList,
    "TransformObservation": lambda e: wrappers.TransformObservation(
        e,
        lambda o: o["achieved_goal"],
        e.observation_space["achieved_goal"],
        e.single_observation_space["achieved_goal"],
    ),
    "FilterObservation": lambda e: wrappers.FilterObservation(e, ["observation", "desired_goal"]),
    "FlattenObservation": wrappers.FlattenObservation,
    "ReshapeObservation": lambda e: wrappers.ReshapeObservation(
        flat(e), (1, gym.spaces.flatdim(e.single_observation_space))
    ),
    "RescaleObservation": lambda e: wrappers.RescaleObservation(flat(e), np.float32(-1), np.float32(1)),
    "DtypeObservation": lambda e: wrappers.DtypeObservation(flat(e), np.float64),
    "NormalizeObservation": lambda e: wrappers.NormalizeObservation(flat(e)),
    "TransformAction": lambda e: wrappers.TransformAction(e, lambda a: 0.5 * a),
    "ClipAction": wrappers.ClipAction,
    "RescaleAction": lambda e: wrappers.RescaleAction(e, np.float32(-2), np.float32(2)),
    "TransformReward": lambda e: wrappers.TransformReward(e, lambda r: 2 * r),
    "ClipReward": lambda e: wrappers.ClipReward(e, 0.1, 0.5),
    "NormalizeReward": wrappers.NormalizeReward,
    "RecordEpisodeStatistics": wrappers.RecordEpisodeStatistics,
    "ArrayConversion": array_conversion,
    "NumpyToTorch": wrappers.NumpyToTorch,
    "JaxToNumpy": of_jax,
    "JaxToTorch": of_jax,
}
DRAWING: dict[str, Callable[[Vector], Vector]] = {
    "GrayscaleObservation": lambda e: wrappers.GrayscaleObservation(pictures(e)),
    "ResizeObservation": lambda e: wrappers.ResizeObservation(pictures(e), (64, 64)),
    "HumanRendering": wrappers.HumanRendering,
}


def two_vectors(env_id: str, wrap: Callable[[Vector], Vector], **options: Any) -> tuple[Vector, Vector]:
    """The native vector and Gymnasium's of single environments, wrapped alike."""
    native = gym.make_vec(env_id, NUM_ENVS, vectorization_mode="vector_entry_point", **options)
    return wrap(native), wrap(gym.make_vec(env_id, NUM_ENVS, vectorization_mode="sync", **options))


def without_times(info: Any) -> Any:
    """The info less the wall-clock times that RecordEpisodeStatistics writes."""
    if isinstance(info, dict) and "episode" in info:
        info = info | {"episode": {k: v for k, v in info["episode"].items() if k not in ("t", "_t")}}
    return info


def alike(env_id: str, wrap: Callable[[Vector], Vector], steps: int, **options: Any) -> str:
    """Both wrapped vectors run alike; says for how long."""
    native, single = two_vectors(env_id, wrap, **options)
    (first, info), (expected, expected_info) = native.reset(seed=7), single.reset(seed=7)
    must(same(first, expected), "the first observations differ")
    must(same(info, expected_info), f"the first infos differ: {differences(info, expected_info)}")
    ended, generator = 0, np.random.default_rng(0)
    for step in range(steps):
        actions: Any = generator.uniform(-1, 1, native.action_space.shape).astype(np.float32)
        if isinstance(first if not isinstance(first, dict) else first["observation"], torch.Tensor):
            actions = torch.as_tensor(actions)
        *got, info = native.step(actions)
        *expected, expected_info = single.step(actions)
        must(same(got, expected), f"step {step} differs")
        must(
            same(without_times(info), without_times(expected_info)), f"infos differ: {differences(info, expected_info)}"
        )
        ended += int(np.asarray(got[2]).sum() + np.asarray(got[3]).sum())
    native.close()
    single.close()
    must(ended or steps < STEPS, "no episode ended")
    return "equal to SyncVectorEnv"


def differences(info: Any, expected: Any) -> list[Any]:
    """The entries in which two infos differ."""
    if isinstance(info, dict) and isinstance(expected, dict):
        return [
            k for k in set(info) | set(expected) if k not in info or k not in expected or not same(info[k], expected[k])
        ]
    return [info, expected]


def draw(env_id: str, wrap: Callable[[Vector], Vector], with_size: bool) -> str:
    """A wrapper that draws runs alike for a few steps, or says why nothing can be drawn here."""
    need_pictures(env_id)
    return alike(env_id, wrap, PICTURES, render_mode="rgb_array", **({"render_size": SIDE} if with_size else {}))


def need_pictures(env_id: str) -> None:
    """Raise where this machine draws no pictures of the environment (a dynamic one needs a GL library)."""
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    try:
        env.render()
    except Exception as fault:
        raise Inapplicable(f"no pictures on this machine: {str(fault).splitlines()[0]}") from fault


def record_video(env_id: str) -> str:
    """RecordVideo writes the films of the episodes that it was asked for."""
    need_pictures(env_id)
    with tempfile.TemporaryDirectory() as folder:
        made = gym.make_vec(env_id, NUM_ENVS, vectorization_mode="vector_entry_point", render_mode="rgb_array")
        envs = wrappers.RecordVideo(made, folder, step_trigger=lambda step: step == 0, video_length=PICTURES)
        envs.reset(seed=0)
        for _ in range(PICTURES + 2):
            envs.step(envs.action_space.sample())
        envs.close()
        films = [name for name in os.listdir(folder) if name.endswith(".mp4")]
        must(len(films) == 1 and os.path.getsize(os.path.join(folder, films[0])) > 0, f"films: {films}")
    return "one film"


def main() -> None:
    """Every wrapper on every id."""
    client = Client("gymnasium")
    unknown = set(wrappers.__all__) - set(NUMBERS) - set(DRAWING) - {"RecordVideo"}
    must(not unknown, f"wrappers that this script does not know: {unknown}")
    for env_id in IDS:
        for name, wrap in NUMBERS.items():
            client.check(env_id, name, alike, env_id, wrap, STEPS)
        for name, wrap in DRAWING.items():
            client.check(env_id, name, draw, env_id, wrap, name != "HumanRendering")
        client.check(env_id, "RecordVideo", record_video, env_id)


if __name__ == "__main__":
    main()
