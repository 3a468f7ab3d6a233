"""Several agents trained at once, each in a process of its own: Torch and compiled code gain nothing from more threads.

What an agent becomes does not depend on it. A signal to the one process that the user sees is handed on to the others,
which write their checkpoints: the same call then goes on.
"""

import os
import signal
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing import get_context, parent_process
from pathlib import Path
from queue import Empty
from typing import Any

from tensegrity_agents.config import Experiment
from tensegrity_agents.sb3.errors import TrainingError, TrainingInterruptedError
from tensegrity_agents.sb3.stopping import stopping
from tensegrity_agents.sb3.training import train

# report(seed, timesteps, total, success share of the latest episodes)
Report = Callable[[int, int, int, float], None]
_WAIT = 0.2  # for messages [s]


def train_side_by_side(experiment: Experiment, homes: Mapping[int, Path], jobs: int, report: Report) -> None:
    """Train the agents of some seeds, or go on with them; each is saved in its folder.

    Args:
        experiment: of a registered id of this package.
        homes: the folder of each agent, by its seed.
        jobs: how many at once.
        report: called while they train.

    Raises:
        TrainingError: one of them failed; the others are finished first.
        TrainingInterruptedError: a signal asked to stop; checkpoints are written.
    """
    context = get_context("spawn")  # Torch and compiled code do not survive a fork
    messages = context.Queue()
    waiting, running = list(homes), dict[int, Any]()
    done, failures = dict.fromkeys(homes, 0), dict[int, str]()

    def listen() -> None:
        seed, what = messages.get(timeout=_WAIT)
        if isinstance(what, str):
            failures[seed] = what
        else:
            done[seed] = what[0]
            report(seed, *what)

    with stopping() as stop:
        asked = False
        while running or (waiting and not asked):
            while waiting and len(running) < jobs and not asked:
                seed = waiting.pop(0)
                running[seed] = context.Process(target=_train, args=(experiment, seed, homes[seed], messages))
                running[seed].start()
            with suppress(Empty):
                listen()
            if stop.number is not None and not asked:
                asked = True
                for process in running.values():
                    process.terminate()
            for seed in [seed for seed, process in running.items() if not process.is_alive()]:
                if (code := running.pop(seed).exitcode) and not asked:
                    failures.setdefault(seed, f"its process ended with exit code {code}")
        while not messages.empty():
            listen()
        if asked:
            raise TrainingInterruptedError(sum(done.values()), int(stop.number or signal.SIGTERM))
    if failures:
        raise TrainingError("; ".join(f"agent of seed {seed}: {what}" for seed, what in failures.items()))


def _train(experiment: Experiment, seed: int, home: Path, messages: Any) -> None:
    """One agent, in a process of its own."""
    if hasattr(os, "setsid"):
        os.setsid()  # Ctrl-C goes to the parent alone, which hands it on once
    shown = 0.0

    def report(done: int, total: int, success: float) -> None:
        nonlocal shown
        parent = parent_process()
        if parent is not None and not parent.is_alive():
            os.kill(os.getpid(), signal.SIGTERM)  # a checkpoint, and the end
        if time.monotonic() - shown >= 1.0 or done == total:
            shown = time.monotonic()
            messages.put((seed, (done, total, success)))

    try:
        train(experiment, seed, home, report)
    except TrainingInterruptedError:
        pass
    except Exception as error:  # its words are all that the parent can show
        messages.put((seed, str(error) or type(error).__name__))
