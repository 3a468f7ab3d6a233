"""Episodes of controllers and agents as Minari datasets, for learning from data. Needs the extra `minari`."""

import os
import shutil
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from tensegrity_agents import env_options
from tensegrity_agents.config import ConfigError
from tensegrity_agents.controllers import baselines_of, make_controller
from tensegrity_agents.controllers.base import Controller
from tensegrity_agents.evaluation.player import Player
from tensegrity_agents.evaluation.results import Progress
from tensegrity_agents.extras import need
from tensegrity_agents.pretrained import AGENT, load_pretrained
from tensegrity_envs.seeding import VALIDATION_SEED

PATH = "MINARI_DATASETS_PATH"  # Minari's variable of the environment: where datasets are
_STAND_INS = {"oracle": "closed_form", "servo": "pseudo_inverse"}  # beginnings of names, where there is none


def needs_minari() -> Any:
    """The package Minari.

    Raises:
        ImportError: it is not installed; the message says how to.
    """
    need("minari", "datasets need", "h5py", "minari")
    import minari

    return minari


@contextmanager
def datasets_in(folder: Path | None) -> Iterator[None]:
    """Let Minari write to and read from a folder; None leaves its own, ~/.minari/datasets."""
    before = os.environ.get(PATH)
    if folder is not None:
        os.environ[PATH] = str(folder.absolute())
    try:
        yield
    finally:
        if folder is not None:
            os.environ.pop(PATH) if before is None else os.environ.update({PATH: before})


def dataset_id(env_id: str, options: Mapping[str, Any], controller: str) -> str:
    """The name of a dataset, such as "tensegrity/TwoXReach/oracle-v0"; a hash of options of one's own is part of it."""
    name = env_options.results_name(env_id, options).replace("-v0", "")
    return f"tensegrity/{name}/{controller.replace(':', '-')}-v0"


def standing_in(env_id: str, name: str, options: Mapping[str, Any] | None = None) -> str:
    """The baseline of this name, or where an environment has no oracle or servo what stands in for it."""
    known = baselines_of(env_id, options)
    beginning = _STAND_INS.get(name)
    if name in known or beginning is None:
        return name
    return next((one for one in known if one.startswith(beginning)), name)


def record(
    env_id: str,
    controllers: Sequence[str],
    episodes: int,
    options: Mapping[str, Any] | None = None,
    folder: Path | None = None,
    policy: Path | None = None,
    seed: int = 0,
    fresh: bool = False,
    progress: Progress | None = None,
    remark: Callable[[str], None] = print,
) -> list[str]:
    """Write a dataset for each controller: all of them run the same episodes.

    Actions are rounded to float32, as the action space has them. Infos are recorded, too; among them are hidden
    parameters, which are no part of what a controller observes.

    Args:
        env_id: Gymnasium id.
        controllers: names of baselines, "agent" for the shipped policy or `policy`, or "module:Class". Where an id has
            no oracle its closed form stands in, where it has no servo its pseudo-inverse; `remark` is told.
        episodes: how many, of the seeds seed, seed + 1, ...
        options: of the environment.
        folder: of the datasets; Minari's own by default.
        policy: folder of a trained policy, for "agent".
        seed: of the first episode, from those of trainings.
        fresh: write datasets anew that are there.
        progress: called while episodes run.
        remark: called with what is worth saying.

    Returns:
        The names of the datasets, for `minari.load_dataset`.

    Raises:
        ConfigError: a controller or policy is not there, a dataset is there already, or seeds would be those of
            evaluations.
        ImportError: the extra "minari" is not installed.
    """
    minari = needs_minari()
    given = dict(options or {})
    if not 0 <= seed <= VALIDATION_SEED - episodes:
        raise ConfigError(f"seeds {seed} to {seed + episodes - 1}: must be from 0 to {VALIDATION_SEED - 1}")
    players: dict[str, Controller] = {}
    for asked in controllers:
        name = standing_in(env_id, asked, given)
        if name != asked:
            remark(f"{env_id} has no {asked}: {name} stands in for it")
        players[name] = _agent(env_id, given, policy) if name == AGENT else make_controller(name, env_id, given)
    names = {controller: dataset_id(env_id, given, controller) for controller in players}
    with datasets_in(folder):
        there = minari.list_local_datasets()
        if taken := [name for name in names.values() if name in there and not fresh]:
            raise ConfigError(f"dataset {taken[0]} is there already; --fresh writes it anew")
        for controller, name in names.items():

            def report(done: int, what: str = controller) -> None:
                if progress is not None:
                    progress(f"recording {what}", done, episodes, "")

            env = gym.make(env_id, **given)
            buffers = _buffers(env, players[controller], seed, episodes, report)
            if name in there:
                shutil.rmtree(minari.storage.get_dataset_path(name))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # that there is no link to the code, no author
                minari.create_dataset_from_buffers(
                    name,
                    buffers,
                    env=env.spec,
                    eval_env=env.spec,
                    algorithm_name=controller,
                    description=f"{controller} on {env_id}, {episodes} episodes of the seeds {seed} to "
                    f"{seed + episodes - 1}; infos hold hidden parameters.",
                    requirements=[f"tensegrity-envs=={version('tensegrity-envs')}"],
                )
            env.close()
    return list(names.values())


def _agent(env_id: str, options: dict[str, Any], policy: Path | None) -> Controller:
    """The trained policy.

    Raises:
        ConfigError: none was given, and none is shipped.
    """
    if policy is None:
        try:
            return load_pretrained(env_id, env_options.canonical(env_id, options))
        except ValueError as error:
            raise ConfigError(f"agent: {error}; --policy takes the folder of one that you have trained") from error
    from tensegrity_agents.sb3.policy_file import load_policy

    return load_policy(policy, env_id, env_options.canonical(env_id, options))


def _buffers(
    env: gym.Env[Any, Any], controller: Controller, seed: int, episodes: int, report: Callable[[int], None]
) -> list[Any]:
    """Whole episodes, as Minari takes them."""
    from minari.data_collector import EpisodeBuffer

    player, buffers = Player(env, controller), []
    for episode in range(episodes):
        player.begin(seed + episode)
        observations, infos = [player.observation], [player.info]
        actions: list[np.ndarray] = []
        rewards: list[float] = []
        while not player.ended:
            actions.append(np.clip(player.action(), -1.0, 1.0).astype(np.float32))
            rewards.append(player.step(actions[-1]))
            observations.append(player.observation)
            infos.append(player.info)
        last = [False] * (len(rewards) - 1)
        buffers.append(
            EpisodeBuffer(
                id=episode,
                seed=seed + episode,
                observations=_columns(observations),
                actions=actions,
                rewards=rewards,
                terminations=[*last, player.failed],
                truncations=[*last, not player.failed],
                infos=_columns(infos),
            )
        )
        report(episode + 1)
    return buffers


def _columns(steps: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """A dict of lists from a list of dicts."""
    return {key: [step[key] for step in steps] for key in steps[0]}
