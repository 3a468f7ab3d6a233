"""All agents of all environments, measured once; what is there is not done again."""

from pathlib import Path
from typing import Annotated

import typer

import tensegrity_envs
from tensegrity_agents.ablations import FOLDER, VARIANTS, variants_of
from tensegrity_agents.campaign import Task, keep_median, run_campaign, tasks_of
from tensegrity_agents.command_options import find_experiment, parse_seeds
from tensegrity_agents.config import ConfigError, Experiment, known_env
from tensegrity_agents.console import GO_ON, checked_folder, clear_errors, progress_bar, say
from tensegrity_agents.env_options import level_numbers
from tensegrity_agents.evaluation.records import Record
from tensegrity_agents.reporting.table import percent
from tensegrity_envs.uncertainty import LEVELS


def main(
    ids: Annotated[
        str | None, typer.Option(help="comma-separated ids", show_default="all that have a config, quasi-static first")
    ] = None,
    seeds: Annotated[
        str | None,
        typer.Option(
            help="training seeds, such as 0,1,2", show_default="0,1,2,3,4, or those of a config that has more"
        ),
    ] = None,
    only: Annotated[str, typer.Option(help="agents, controllers, all, or names of controllers: informed,mpc")] = "all",
    levels: Annotated[
        str | None,
        typer.Option(
            help="levels of uncertainty, such as 0,2, beside the environment as it is",
            show_default="all that an id has",
        ),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="processes, at most one for each core")] = 1,
    ablate: Annotated[
        bool,
        typer.Option(
            help="agents of each config with one thing taken out (teacher, history, fine-tuning, ...), 3 seeds, into "
            "ablations/ in the folder of the rows"
        ),
    ] = False,
    timesteps: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="with --ablate: steps of each training, one of the whole method included",
            show_default="those of the config",
        ),
    ] = None,
    ray: Annotated[
        str | None, typer.Option(help="address of a Ray cluster to measure on, such as auto or host:port")
    ] = None,
    results: Annotated[Path, typer.Option(help="folder of trainings")] = Path("results"),
    records: Annotated[Path, typer.Option(help="folder of the rows: a small JSON file each")] = Path("records"),
    policies: Annotated[
        Path | None, typer.Option(help="keep the policy of the median seed of each finished id in this folder")
    ] = None,
) -> None:
    """Train 5 seeds of the config of every id (or all of a config that has more), evaluate them and the analytic
    controllers on 1,000 test episodes each (or as many as the config says), and keep every row: success of each
    episode, training time (CPU and wall), steps, a hash of the config.

    Interrupt it whenever you like: the same command goes on, and rows that are there are not measured again. A row that
    fails is named, and the others go on. The matrix of all rows is drawn by: tensegrity matrix

    With --ablate agents of variants of each config are trained instead, such as no_history: three seeds each. With
    --timesteps, too, all of them and the whole method are trained for so many steps.

    With --ray the rows are measured on a cluster, on whose nodes this package is installed; trainings whose node dies
    go on from their last checkpoint, which is kept here.

    Example: tensegrity campaign --ids TwoXReach-v0,TwoXTensionReach-v0 --seeds 0,1,2 --jobs 2
    """
    with clear_errors(GO_ON):
        for folder, option in ((results, "--results"), (records, "--records"), (policies, "--policies")):
            if folder is not None:
                checked_folder(folder, option)
        if ablate and policies is not None:
            raise ConfigError("--policies: policies of ablations are not kept; leave it out")
        if timesteps is not None and not ablate:
            raise ConfigError(f"--timesteps {timesteps}: is for --ablate; a config has its own total_timesteps")
        if ablate and only not in ("all", "agents"):
            raise ConfigError(f"--only {only}: ablations are of agents alone; leave it out")
        chosen = parse_seeds(("0,1,2" if ablate else "0,1,2,3,4") if seeds is None else seeds)
        experiments = [
            one if seeds is None and not ablate and len(one.seeds) > len(chosen) else one.changed(seeds=chosen)
            for one in _experiments(ids)
        ]
        chosen_levels = None if levels is None else _parse_levels(levels)
        groups = {records: _only(only, [task for one in experiments for task in tasks_of(one, levels=chosen_levels)])}
        if ablate:
            groups = _ablated(experiments, records / FOLDER, chosen_levels, timesteps)
        failed, total, number = list[str](), sum(map(len, groups.values())), 0
        with progress_bar() as progress:
            for folder, tasks in groups.items():
                rows = run_campaign(tasks, results, folder, progress, jobs)
                if ray is not None:
                    from tensegrity_agents.cluster import run_on_cluster

                    rows = run_on_cluster(tasks, results, folder, progress, ray)
                for task, found in rows:
                    number += 1
                    name = f"{task.short_id} {task.name}" + (f" {folder.name}" if ablate else "")
                    say(f"{number}/{total} {name}: {_in_words(found)}")
                    if isinstance(found, Exception):
                        failed.append(name)
                    elif policies is not None and task.seed is not None:
                        keep_median(task.experiment, results, records, policies)
        say(f"{total - len(failed)} of {total} rows are in {records}/")
        if failed:
            say("failed: " + ", ".join(failed))
            raise typer.Exit(1)


def _ablated(
    experiments: list[Experiment], folder: Path, levels: tuple[int, ...] | None, timesteps: int | None
) -> dict[Path, list[Task]]:
    """The agents of all variants, by the folder of their rows.

    Raises:
        ConfigError: no config has anything to take out.
    """
    found: dict[Path, list[Task]] = {}
    for experiment in experiments:
        for name, variant in variants_of(experiment, timesteps).items():
            found.setdefault(folder / name, []).extend(tasks_of(variant, controllers=False, levels=levels))
    if not found:
        raise ConfigError(f"--ablate: no config here has any of {', '.join(VARIANTS)}")
    return found


def _only(what: str, tasks: list[Task]) -> list[Task]:
    """The rows of agents, controllers, all, or of named controllers.

    Raises:
        ConfigError: there is no such controller.
    """
    if what == "all":
        return tasks
    if what in ("agents", "controllers"):
        return [task for task in tasks if (task.seed is None) == (what == "controllers")]
    names, known = what.split(","), list(dict.fromkeys(task.controller for task in tasks if task.seed is None))
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ConfigError(
            f"--only {what}: must be agents, controllers, all, or names of controllers of these ids, of which "
            f"{unknown[0]!r} is none; there are {', '.join(known)}"
        )
    return [task for task in tasks if task.controller in names]


def _parse_levels(text: str) -> tuple[int, ...]:
    try:
        return tuple(level_numbers(text))
    except ValueError as error:
        raise ConfigError(f"--levels {text}: must be whole numbers from 0 to {len(LEVELS) - 1}, such as 0,2") from error


def _in_words(found: Record | Exception) -> str:
    if isinstance(found, Exception):
        return f"failed: {found}"
    trained = "" if found.frames is None else f", {found.frames:,} steps"
    trained += "" if found.cpu_seconds is None else f" in {found.cpu_seconds:.0f} s of CPU time"
    return f"{percent(float(found.flags().mean()), '%')} of {found.episodes:,} test episodes{trained}"


def _experiments(ids: str | None) -> list[Experiment]:
    """Those of these ids, or of all that have a config.

    Raises:
        ConfigError: an id is unknown or has none.
    """
    if ids is not None:
        names = [known_env(name.strip()) for name in ids.split(",")]
        if len(set(names)) != len(names):
            raise ConfigError(f"--ids {ids}: must be different ids")
        return [find_experiment(None, name) for name in names]
    found = []
    for env_id in sorted(tensegrity_envs.ENV_IDS, key=lambda name: ("MuJoCo" in name, "Uncertain" in name)):
        try:
            found.append(find_experiment(None, env_id))
        except ConfigError as error:
            say(f"{env_id}: {str(error).partition(';')[0]}")
    return found
