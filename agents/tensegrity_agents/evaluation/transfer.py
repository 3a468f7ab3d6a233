"""What controllers are worth where they were not made for: quasi-static ones in dynamics, and the reverse.

A pair of environments differs in nothing but the motion: the quasi-static one, and the same in MuJoCo, where velocities
are observed as well. A controller that knows no velocities is not shown them there; one that does sees zeros in the
quasi-static environment.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium as gym

from tensegrity_agents.env_options import short_name
from tensegrity_agents.evaluation.results import Progress, Run, kind_of
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_envs.seeding import TEST_SEED


class Candidate(NamedTuple):
    """A controller and where it comes from.

    Attributes:
        name: "agent", or that of a baseline.
        home: Gymnasium id for which it was trained or designed.
        controllers: the controller; agents have one for every training seed.
    """

    name: str
    home: str
    controllers: list[Any]


class Transferred(NamedTuple):
    """A candidate's runs, by the id where it was evaluated."""

    candidate: Candidate
    runs: dict[str, list[Run]]


def pair_of(env_id: str) -> tuple[str, str]:
    """The quasi-static and the dynamic id of which this is one.

    Raises:
        ValueError: there is no such pair.
    """
    rests = _rests(env_id)
    pair = rests, f"{rests.removesuffix('-v0')}MuJoCo-v0"
    if not all(name in gym.registry for name in pair):
        known = [short_name(one) for one in gym.registry if one.endswith("MuJoCo-v0") and _rests(one) in gym.registry]
        raise ValueError(f"{env_id}: has no twin with other motion; there are {', '.join(known)}")
    return pair


def _rests(env_id: str) -> str:
    """The quasi-static id of a pair."""
    return f"{env_id.removesuffix('-v0').removesuffix('MuJoCo')}-v0"


def transfer(
    pair: tuple[str, str],
    found: list[Candidate],
    episodes: int,
    progress: Progress | None = None,
    options: Mapping[str, Any] | None = None,
) -> list[Transferred]:
    """Evaluate every candidate on both environments with these options, on the same test episodes."""
    results = []
    for candidate in found:
        seen = {**(options or {}), "observe_velocities": candidate.home == pair[1]}
        runs: dict[str, list[Run]] = {}
        for where in pair:
            runs[where] = []
            for seed, controller in enumerate(candidate.controllers):
                what = f"{candidate.name} of {short_name(candidate.home)} on {short_name(where)}"

                def report(done: int, total: int, what: str = what) -> None:
                    if progress is not None:
                        progress(what, done, total, "")

                kind = "agent" if candidate.name == "agent" else kind_of(candidate.name)
                run = evaluate(
                    controller, where, episodes, TEST_SEED, candidate.name, kind, seen, report, made_elsewhere=True
                )
                run.training_seed = seed if kind == "agent" else None
                runs[where].append(run)
        results.append(Transferred(candidate, runs))
    return results
