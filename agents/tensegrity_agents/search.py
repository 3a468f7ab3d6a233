"""Search for the settings of a training with Optuna, whose result is a config. Needs the extra `optuna`."""

import csv
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import yaml

from tensegrity_agents.config import ConfigError, Experiment
from tensegrity_agents.evaluation.records import hash_of
from tensegrity_agents.evaluation.results import Progress
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.extras import need
from tensegrity_envs.seeding import VALIDATION_SEED

if TYPE_CHECKING:
    import optuna

STORAGE, BEST, TRIALS = "search.db", "best.yaml", "trials.csv"
_AGENT = "trial-"  # and a hash of its settings: a training that was interrupted is found again
_LOOKS = 10  # how often a trial may be given up in its course
_UNJUDGED = 5  # first trials, which are not
_PATIENCE = 60  # [s] of a process that waits while another one writes into the storage


@dataclass(frozen=True)
class Between:
    """A number from low to high; the config's own counts as within.

    Attributes:
        low: lowest.
        high: highest.
        log: whether its logarithm is drawn.
        whole: whether it is a whole number.
    """

    low: float
    high: float
    log: bool = False
    whole: bool = False

    def suggest(self, trial: "optuna.Trial", name: str, own: float | None) -> Any:
        """A value for a trial."""
        low, high = (self.low, self.high) if own is None else (min(self.low, own), max(self.high, own))
        if self.whole:
            return trial.suggest_int(name, int(low), int(high), log=self.log)
        return trial.suggest_float(name, low, high, log=self.log)


@dataclass(frozen=True)
class OneOf:
    """One of some values; the config's own counts as one of them."""

    values: tuple[Any, ...]

    def suggest(self, trial: "optuna.Trial", name: str, own: object) -> Any:
        """A value for a trial. Lists are written as text, since Optuna keeps plain values only."""
        known = [json.dumps(value) for value in self.values]
        if json.dumps(own) not in known:
            known.append(json.dumps(own))
        return json.loads(trial.suggest_categorical(name, known))


Space = Mapping[str, Between | OneOf]
_NETWORKS = OneOf(([64, 64], [128, 128], [256, 256], [400, 300]))
# What is searched, by the key in the section `train` of a config.
ON_POLICY: Space = {
    "net_arch": _NETWORKS,
    "ppo.learning_rate": Between(1e-4, 1e-2, log=True),
    "ppo.gamma": Between(0.8, 0.999),
    "ppo.gae_lambda": Between(0.8, 1.0),
    "ppo.n_steps": OneOf((8, 16, 32)),
    "ppo.batch_size": OneOf((1024, 2048, 4096, 8192)),
    "ppo.n_epochs": Between(2, 12, whole=True),
    "ppo.clip_range": Between(0.1, 0.4),
    "ppo.log_std_init": Between(-2.0, 0.0),
}
OFF_POLICY: Space = {
    "net_arch": _NETWORKS,
    "off_policy.learning_rate": Between(1e-4, 1e-2, log=True),
    "off_policy.gamma": Between(0.8, 0.999),
    "off_policy.tau": Between(1e-3, 0.1, log=True),
    "off_policy.batch_size": OneOf((128, 256, 512, 1024)),
    "off_policy.n_sampled_goal": Between(1, 8, whole=True),
}
TEACHER: Space = {
    "teacher.learning_rate": Between(3e-4, 3e-3, log=True),
    "teacher.gradient_steps": Between(20, 100, whole=True),
    "history": Between(0, 5, whole=True),
}


Outcome = float | str  # of a trial: its score, or why it has none


class Begun(NamedTuple):
    """A trial that is to be tried.

    Attributes:
        trial: Optuna's.
        experiment: with its settings.
    """

    trial: "optuna.Trial"
    experiment: Experiment

    @property
    def name(self) -> str:
        """Of the folder of its training."""
        return f"{_AGENT}{hash_of(self.experiment.train.model_dump(mode='json'))}"

    def is_behind(self, look: int, success: float) -> bool:
        """Whether the trial is worse than half of the others were at this look, the first of which is 1."""
        self.trial.report(success, look)
        return bool(self.trial.should_prune())


# runner(begin, folder, episodes, progress): tries what `begin` gives, until it gives none; see `one_by_one`
Runner = Callable[[Callable[[], Begun | None], Path, int, Progress | None], Iterator[tuple[Begun, Outcome]]]


def space_of(experiment: Experiment) -> Space:
    """What is searched for an experiment."""
    train = experiment.train
    space = ON_POLICY if train.is_on_policy else OFF_POLICY
    taught = {} if train.teacher is None else dict(TEACHER)
    if not train.history:  # it changes what an agent observes: whoever wants it has some
        taught.pop("history", None)
    return {**space, **taught}


def needs_optuna() -> Any:
    """The package Optuna.

    Raises:
        ImportError: it is not installed; the message says how to.
    """
    need("optuna", "search needs", "optuna")
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


def search(
    experiment: Experiment,
    folder: Path,
    trials: int,
    share: float = 1.0,
    episodes: int = 200,
    seed: int = 0,
    fresh: bool = False,
    progress: Progress | None = None,
    remark: Callable[[str], None] = print,
    runner: Runner | None = None,
) -> tuple[Path, float]:
    """Try settings of a training, the config's own first, and write the best as a config.

    Every trial trains one agent and scores it on validation episodes; one that is worse than half of the others at the
    same point of their trainings is given up. Trials are kept in <folder>/search.db, so the same call goes on where it
    was interrupted, in the midst of a training, too.

    Args:
        experiment: whose first seed is trained; see `space_of` for what is searched.
        folder: gets search.db, trials.csv, best.yaml, and the agents.
        trials: how many there are to be in the end, those that are there included.
        share: of the config's steps, of each trial.
        episodes: of the validation, for the score: the share that ends on target.
        seed: of the search.
        fresh: forget the trials and agents that are there.
        progress: called while it works.
        remark: called with the result of each trial.
        runner: tries several at a time, such as `search_on_cluster.on_cluster`; by default one at a time, here.

    Returns:
        The path of best.yaml, and the score of the best trial.

    Raises:
        ConfigError: nothing was finished, or the folder has a search of another experiment.
        ImportError: the extra "optuna" is not installed.
    """
    optuna = needs_optuna()
    folder.mkdir(parents=True, exist_ok=True)
    if fresh:
        for path in folder.glob(f"{_AGENT}*"):
            shutil.rmtree(path)
        for name in (STORAGE, BEST, TRIALS):
            (folder / name).unlink(missing_ok=True)
    study = optuna.create_study(
        storage=optuna.storages.RDBStorage(
            f"sqlite:///{(folder / STORAGE).absolute()}",
            engine_kwargs={"connect_args": {"timeout": _PATIENCE}},
        ),
        study_name=experiment.env,
        direction="maximize",
        load_if_exists=True,
        pruner=optuna.pruners.MedianPruner(n_startup_trials=_UNJUDGED),
    )
    base, state = _shortened(experiment, share), optuna.trial.TrialState
    _check_same(study, base, folder)
    _begin(optuna, study, base)
    # Of several trials at a time each one takes it that the others will be bad, so that they differ.
    study.sampler = optuna.samplers.TPESampler(seed=seed + len(study.trials), constant_liar=runner is not None)

    def give_up(trial: Any, why: str) -> None:
        study.tell(trial, state=state.PRUNED)
        remark(f"trial {trial.number}: {why}")

    def begin() -> Begun | None:
        """The next trial, unless there are enough."""
        while True:
            done = len(study.get_trials(deepcopy=False, states=(state.COMPLETE, state.PRUNED)))
            if progress is not None:
                progress("trials", done, trials, _best_so_far(study))
            if done + len(study.get_trials(deepcopy=False, states=(state.RUNNING,))) >= trials:
                return None
            trial, own = study.ask(), base.train.model_dump()
            settings = {key: range_.suggest(trial, key, _at(own, key)) for key, range_ in space_of(base).items()}
            try:
                return Begun(trial, _with(base, settings))
            except ConfigError as error:  # settings that do not go together
                give_up(trial, str(error))

    for (trial, _), outcome in (runner or one_by_one)(begin, folder, episodes, progress):
        if isinstance(outcome, str):
            give_up(trial, outcome)
            continue
        study.tell(trial, outcome)
        remark(f"trial {trial.number}: {outcome:.1%}, best {_best_so_far(study)}")
        _write(study, experiment, folder, share)
    if not _complete(study):
        raise ConfigError(f"{folder}: no trial has been finished; more of them may be")
    _write(study, experiment, folder, share)
    return folder / BEST, float(study.best_value)


def one_by_one(
    begin: Callable[[], Begun | None], folder: Path, episodes: int, progress: Progress | None
) -> Iterator[tuple[Begun, Outcome]]:
    """Tries trials in this process.

    Args:
        begin: gives the next one, or None where there are enough.
        folder: of the trainings.
        episodes: of the validation.
        progress: called while it works.
    """
    while (begun := begin()) is not None:

        def report(done: int, total: int, success: float, number: int = begun.trial.number) -> None:
            if progress is not None:
                progress(f"trial {number}", done, total, f"success {success:4.0%}")

        yield begun, try_settings(begun.experiment, folder / begun.name, episodes, begun.is_behind, report)


class _GivenUpError(Exception):
    pass


def try_settings(
    experiment: Experiment,
    home: Path,
    episodes: int,
    is_behind: Callable[[int, float], bool],
    report: Callable[[int, int, float], None] | None = None,
) -> Outcome:
    """Train an agent, or go on with it, and score it.

    Args:
        experiment: whose first seed is trained.
        home: folder of the training.
        episodes: of the validation.
        is_behind: asked ten times in a training, with its success by then; see `Begun.is_behind`.
        report: called with what is done, of how many steps, and the success.
    """
    from tensegrity_agents.sb3.training import train

    looked = 0

    def look(done: int, total: int, success: float) -> None:
        nonlocal looked
        if report is not None:
            report(done, total, success)
        if done * _LOOKS // total > looked and np.isfinite(success):
            looked = done * _LOOKS // total
            if is_behind(looked, success):
                raise _GivenUpError

    try:
        agent = train(experiment, experiment.seeds[0], home, look)
    except ConfigError as error:  # which only the training can tell
        return str(error)
    except _GivenUpError:
        return "given up"
    run = evaluate(agent, experiment.env, episodes, VALIDATION_SEED, "agent", "agent", experiment.options)
    return float(run.columns["success"].mean())


def _shortened(experiment: Experiment, share: float) -> Experiment:
    train = experiment.train.model_dump()
    train["total_timesteps"] = max(1, round(share * train["total_timesteps"]))
    for first in ("teacher", "gradient"):
        if train[first] is not None:
            train[first]["timesteps"] = max(1, round(share * train[first]["timesteps"]))
    return experiment.changed(train=train)


def _check_same(study: "optuna.Study", base: Experiment, folder: Path) -> None:
    """Remember what is searched for; another experiment in the same folder is an error."""
    described = base.model_dump(mode="json", include={"env", "train", "seeds"}) | {"options": str(base.options)}
    if study.user_attrs.setdefault("experiment", described) != described:
        raise ConfigError(f"{folder / STORAGE}: is of another experiment (or --share); another --out begins anew")
    study.set_user_attr("experiment", described)


def _begin(library: ModuleType, study: "optuna.Study", base: Experiment) -> None:
    """The config's own settings first; after an interrupt, those whose training was not finished."""
    if not study.trials:
        own = base.train.model_dump()
        study.enqueue_trial({key: _kept(range_, _at(own, key)) for key, range_ in space_of(base).items()})
    for trial in study.get_trials(states=(library.trial.TrialState.RUNNING,)):
        study.tell(trial.number, state=library.trial.TrialState.FAIL)
        if trial.params:
            study.enqueue_trial(trial.params)


def _kept(range_: Between | OneOf, value: object) -> Any:
    return json.dumps(value) if isinstance(range_, OneOf) else value


def _at(settings: Mapping[str, Any], key: str) -> Any:
    section, _, name = key.rpartition(".")
    return (settings[section] if section else settings)[name]


def _with(experiment: Experiment, settings: Mapping[str, Any]) -> Experiment:
    """The experiment with other settings of its training."""
    train = experiment.train.model_dump()
    for key, value in settings.items():
        section, _, name = key.rpartition(".")
        (train[section] if section else train)[name] = value
    return experiment.changed(train=train)


def _complete(study: "optuna.Study") -> "list[optuna.trial.FrozenTrial]":
    return [trial for trial in study.get_trials(deepcopy=False) if trial.state.name == "COMPLETE"]


def _best_so_far(study: "optuna.Study") -> str:
    return f"{study.best_value:.1%} (trial {study.best_trial.number})" if _complete(study) else "none yet"


def _write(study: "optuna.Study", experiment: Experiment, folder: Path, share: float) -> None:
    """The best trial as a config, with all of the experiment's steps, and a table of all trials."""
    best = study.best_trial
    space = space_of(experiment)
    settings = {
        key: json.loads(value) if isinstance(space[key], OneOf) else value for key, value in best.params.items()
    }
    content = _with(experiment, settings).model_dump(mode="json", exclude_defaults=True)
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110)
    (folder / BEST).write_text(
        f"# The best of {len(_complete(study))} finished trials of `tensegrity search`, trial {best.number}:\n"
        f"# {best.value:.1%} of the validation episodes with {share:.0%} of these steps, one training run.\n{text}"
    )
    with (folder / TRIALS).open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["trial", "state", "success", *space])
        for trial in study.trials:
            writer.writerow([trial.number, trial.state.name.lower(), trial.value, *map(trial.params.get, space)])
