"""The trials of a search on a Ray cluster; a worker or node that dies costs what it did since its last checkpoint.

Trials are Ray's tasks, asked for and told to Optuna's study on the machine where the search was begun; so the search
and its files are those of a search without a cluster (`search`). An actor there keeps the trainings' files, and answers
whether a trial is to be given up. Ray Tune would do the same upon a file system that all nodes have in common, with
pickled files of its own beside Optuna's.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tensegrity_agents.cluster import RETRIES, Keeper, actor_here, connected, kept_by
from tensegrity_agents.config import Experiment
from tensegrity_agents.evaluation.results import Progress
from tensegrity_agents.sb3.training import TrainingError
from tensegrity_agents.search import Begun, Outcome, Runner, try_settings


class Judge(Keeper):
    """Keeps the trainings of a search, and gives up trials that are behind the others."""

    def __init__(self, results: Path) -> None:
        super().__init__(results)
        self.begun = dict[str, Begun]()

    def begin(self, begun: Begun) -> None:
        """A trial is on its way."""
        self.begun[begun.name] = begun

    def is_behind(self, name: str, look: int, success: float) -> bool:
        """See `Begun.is_behind`; asked again, as after a retry, it answers again."""
        return self.begun[name].is_behind(look, success)


def try_apart(settings: dict[str, Any], name: str, episodes: int, judge: Any) -> Outcome:
    """Try settings on a node of the cluster.

    Args:
        settings: of the experiment.
        name: of the training, see `Begun.name`.
        episodes: of the validation.
        judge: handle of the actor.
    """
    import ray

    def is_behind(look: int, success: float) -> bool:
        return bool(ray.get(judge.is_behind.remote(name, look, success)))

    with TemporaryDirectory() as place, kept_by(judge, name, Path(place) / name):
        return try_settings(Experiment(**settings), Path(place) / name, episodes, is_behind)


def on_cluster(address: str) -> Runner:
    """Tries as many trials at a time as a cluster has cores for, each with as many as its training has threads.

    Args:
        address: see `cluster.run_on_cluster`, also for what the runner raises.
    """

    def run(
        begin: Callable[[], Begun | None], folder: Path, episodes: int, progress: Progress | None
    ) -> Iterator[tuple[Begun, Outcome]]:
        with connected(address) as ray:
            judge, running = actor_here(ray, Judge, folder.absolute()), dict[Any, Begun]()
            while True:
                while _has_room(ray, running) and (begun := begin()) is not None:
                    ray.get(judge.begin.remote(begun))
                    task = ray.remote(try_apart).options(num_cpus=begun.experiment.train.threads, max_retries=RETRIES)
                    settings = begun.experiment.model_dump(mode="json")
                    running[task.remote(settings, begun.name, episodes, judge)] = begun
                if not running:
                    return
                (ready, *_), _ = ray.wait(list(running))
                begun = running.pop(ready)
                try:
                    outcome = ray.get(ready)
                except ray.exceptions.RayError as error:
                    words = str(error).strip().splitlines()[-1]
                    raise TrainingError(
                        f"trial {begun.trial.number}: {words}; the same search goes on there"
                    ) from error
                yield begun, outcome

    return run


def _has_room(ray: Any, running: dict[Any, Begun]) -> bool:
    """Whether one more trial, with as many threads, finds free cores; the first one waits for them."""
    threads = [begun.experiment.train.threads for begun in running.values()]
    return not threads or sum(threads) + max(threads) <= ray.cluster_resources().get("CPU", 0)
