"""The rows of a campaign on a Ray cluster; a worker or node that dies costs what it did since its last checkpoint.

Checkpoints, policies and records go to the machine on which the campaign was begun, through one actor there: nodes need
no file system in common. The package must be installed on each of them, in the same version. A row that is retried goes
on from its last checkpoint, to the same policy (see `sb3.training`) on the same kind of processor. `search_on_cluster`
does the same with the trials of a search.
"""

import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tensegrity_agents.campaign import Task, measure, silent, sorted_out
from tensegrity_agents.config import ConfigError, Experiment
from tensegrity_agents.evaluation.records import Record, read_record
from tensegrity_agents.evaluation.results import Progress
from tensegrity_agents.extras import need
from tensegrity_agents.sb3.checkpoint import CHECKPOINT
from tensegrity_agents.whole_file import PART, written_whole

RETRIES = 10  # of a row whose worker or node has died
_SECONDS = 5.0  # between two looks for a new checkpoint


class Keeper:
    """Keeps the files of trainings on the machine of the campaign.

    Args:
        results: folder of trainings.
    """

    def __init__(self, results: Path) -> None:
        self.results = results

    def put(self, home: str, files: dict[str, bytes]) -> None:
        """Write the files of a training, each whole or not at all.

        Args:
            home: folder of the training, below `results`.
            files: contents by name.
        """
        _write(self.results / home, files)

    def get(self, home: str) -> dict[str, bytes]:
        """What there is of a training."""
        return _read(self.results / home)


def _write(folder: Path, files: dict[str, bytes]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        with written_whole(folder / name) as part:
            part.write_bytes(content)


def _read(folder: Path) -> dict[str, bytes]:
    """The files of a folder; those that are being written, and folders, are left out."""
    found = sorted(folder.iterdir()) if folder.is_dir() else []
    return {path.name: path.read_bytes() for path in found if path.is_file() and path.suffix != PART}


@contextmanager
def _sending(folder: Path, send: Callable[[dict[str, bytes]], object]) -> Iterator[None]:
    """Sends the files of a training whenever there is a new checkpoint."""
    done = threading.Event()

    def watch() -> None:
        sent = 0
        while not done.wait(_SECONDS):
            path = folder / CHECKPOINT
            if path.is_file() and path.stat().st_mtime_ns != sent:
                sent = path.stat().st_mtime_ns
                send(_read(folder))

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


@contextmanager
def kept_by(keeper: Any, name: str, home: Path) -> Iterator[None]:
    """The files of a training come from a keeper, who gets them back with every new checkpoint and in the end.

    Args:
        keeper: handle of the actor.
        name: what the keeper calls the folder.
        home: the folder on this node.
    """
    import ray

    def send(files: dict[str, bytes]) -> None:
        ray.get(keeper.put.remote(name, files))

    _write(home, ray.get(keeper.get.remote(name)))
    with _sending(home, send):
        yield
    send(_read(home))


def measure_apart(settings: dict[str, Any], row: dict[str, Any], begun: bytes | None, keeper: Any) -> bytes:
    """Measure a row on a node of the cluster.

    Args:
        settings: of the experiment.
        row: the other fields of the `Task`.
        begun: the file of its record, as far as there is one.
        keeper: handle of the actor that keeps files.

    Returns:
        The record's file.
    """
    task = Task(Experiment(**settings), **row)
    with TemporaryDirectory() as place:
        results, records = Path(place) / "results", Path(place) / "records"
        home = task.home(results)
        name = str(home.relative_to(results))
        if begun is not None:
            _write(task.file(records).parent, {task.file(records).name: begun})

        if task.seed is None:
            measure(task, results, records, silent)
        else:
            with kept_by(keeper, name, home):
                measure(task, results, records, silent)
        return task.file(records).read_bytes()


def run_on_cluster(
    tasks: Sequence[Task], results: Path, records: Path, progress: Progress, address: str
) -> Iterator[tuple[Task, Record | Exception]]:
    """Measure all rows that are not there yet on a Ray cluster; each is yielded when it is.

    Args:
        tasks: the rows, in the order in which they are begun; each takes as many cores as its training has threads.
        results: of trainings, on this machine, see `campaign.measure`.
        records: of rows, on this machine, see `campaign.measure`.
        progress: called with the number of rows that are there.
        address: of the cluster, as Ray has it: "auto", "host:port", or "local" for one on this machine alone.

    Raises:
        ImportError: the extra "ray" is not installed.
        ConfigError: there is no cluster at this address.
    """
    with connected(address) as ray:
        keeper = actor_here(ray, Keeper, results.absolute())
        there, todo = sorted_out(tasks, records)
        yield from there
        begun = {}
        for task in todo:
            row = ray.remote(measure_apart).options(num_cpus=task.experiment.train.threads, max_retries=RETRIES)
            settings, fields = task.experiment.model_dump(mode="json"), task._asdict()
            del fields["experiment"]
            kept = task.file(records).read_bytes() if task.file(records).is_file() else None
            begun[row.remote(settings, fields, kept, keeper)] = task
        waiting = list(begun)
        while waiting:
            (ready, *_), waiting = ray.wait(waiting)
            task = begun[ready]
            progress("rows", len(todo) - len(waiting), len(todo), task.short_id)
            try:
                _write(task.file(records).parent, {task.file(records).name: ray.get(ready)})
                yield task, read_record(task.file(records))
            except (ray.exceptions.RayError, ValueError) as error:
                yield task, RuntimeError(str(error).strip().splitlines()[-1])


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """The package Ray, connected with a cluster.

    Args:
        address: see `run_on_cluster`, also for what is raised.
    """
    need("ray", "--ray needs", "ray")
    import ray
    import ray.util.scheduling_strategies

    host, _, port = address.rpartition(":")
    try:
        if host and port.isdecimal() and "/" not in host:  # Ray itself would try for minutes
            socket.create_connection((host, int(port)), timeout=10).close()
        ray.init(address=address, log_to_driver=False, logging_level="warning")
    except (OSError, ValueError) as error:
        raise ConfigError(f"--ray {address}: no Ray cluster there ({error}); start one by: ray start --head") from error
    try:
        yield ray
    finally:
        ray.shutdown()


def actor_here(ray: Any, kind: type[Keeper], *args: object) -> Any:
    """Handle of an actor on this machine, which keeps files.

    Args:
        ray: the package, connected.
        kind: of the actor.
        args: of its making.
    """
    here = ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy(
        ray.get_runtime_context().get_node_id(), soft=False
    )
    return ray.remote(kind).options(num_cpus=0, scheduling_strategy=here).remote(*args)
