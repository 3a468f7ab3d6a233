"""Groups of options that several commands share, and what becomes of them.

A command takes a group as one argument; `with_option_groups` puts the group's fields in its place for Typer.
"""

import inspect
import os
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from tensegrity_agents import env_options
from tensegrity_agents.config import ConfigError, Experiment, did_you_mean, known_env, load_experiment
from tensegrity_agents.console import checked_folder, say
from tensegrity_agents.yaml_file import read_yaml
from tensegrity_envs.registration import ENTRIES


def completed_ids(incomplete: str) -> list[tuple[str, str]]:
    """Ids that begin like what was typed, with what they are, for the shell."""
    begun = incomplete.removeprefix("tensegrity/")
    prefix = incomplete[: len(incomplete) - len(begun)]
    known = {env_options.short_name(entry.id): entry.summary for entry in ENTRIES}
    return [(prefix + name, summary) for name, summary in known.items() if name.startswith(begun)]


# The options that several commands have. Typer's help takes square brackets for markup, so defaults that are computed
# are described by `show_default`.
Config = Annotated[Path | None, typer.Option(help="YAML file, such as configs/two_x_reach.yaml")]
EnvArgument = Annotated[
    str | None,
    typer.Argument(
        help="id, such as TwoXReach-v0, or of your own as module:id",
        autocompletion=completed_ids,
        show_default=False,
    ),
]
EnvOption = Annotated[str | None, typer.Option(help="the same as ENVIRONMENT", autocompletion=completed_ids)]
EnvOfConfig = Annotated[
    str | None,
    typer.Option(
        help="the same as ENVIRONMENT: take the config in configs/ for this id",
        autocompletion=completed_ids,
        show_default="TwoXReach-v0",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        help="results folder; with options that change the environment, a hash of these follows its name",
        show_default="results/<environment>",
    ),
]
Seeds = Annotated[
    str | None, typer.Option(help="training seeds, such as 0,1,2,3,4", show_default="those of the config")
]
Jobs = Annotated[
    int | None,
    typer.Option(min=1, help="agents that are trained at once, each in a process", show_default="one for each core"),
]
Json = Annotated[bool, typer.Option("--json", help="as JSON, for machines; all else goes to standard error")]
Fresh = Annotated[bool, typer.Option("--fresh", help="train anew even where an agent or a checkpoint is there")]
Design = Annotated[
    str | None,
    typer.Option(
        help="an arm of your own: a published design such as muralidharan2022, fields such as b=0.06 or "
        "'{\"b\": 0.06}' (the others are those of the environment's design), both as muralidharan2022,b=0.06, or a "
        "YAML file with fields; 'base' names another design that the rest comes from",
        show_default="the environment's",
    ),
]
Randomization = Annotated[
    str | None,
    typer.Option(
        help="what differs from episode to episode, as JSON such as '{\"stiffness\": [0.9, 1.1]}' or a YAML file",
        show_default="the environment's",
    ),
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        help="distance from the target that counts as reached, in m (posture change: rad)",
        show_default="the environment's",
    ),
]
LoadRange = Annotated[
    str | None,
    typer.Option(
        help="range of the unknown load, such as 0,1, in the environment's unit", show_default="the environment's"
    ),
]
Level = Annotated[
    str | None,
    typer.Option(
        help="of uncertainty: 0 (the nominal arm) to 3; several, such as 0,2, or drawn, all of them: each episode has "
        "one of these",
        show_default="the environment's",
    ),
]
Option = Annotated[
    list[str] | None,
    typer.Option(
        help="any other argument of the environment, as name=value with the value in YAML, such as segments=4; may be "
        "repeated"
    ),
]
PayloadRange = Annotated[
    str | None, typer.Option(help="range of the unknown payload in kg, such as 0,0.4", show_default="the environment's")
]


def with_option_groups(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the fields of each argument that is a group (a dataclass) as options of their own."""
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    members = {name: get_type_hints(group, include_extras=True) for name, group in groups.items()}
    parameters = []
    for parameter in inspect.signature(command).parameters.values():
        if parameter.name not in groups:
            parameters.append(parameter.replace(annotation=hints[parameter.name], kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        parameters += [
            inspect.Parameter(
                field.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=field.default,
                annotation=members[parameter.name][field.name],
            )
            for field in fields(groups[parameter.name])
        ]

    def expanded(**given: Any) -> None:
        made = {name: group(**{key: given.pop(key) for key in members[name]}) for name, group in groups.items()}
        command(**given, **made)

    annotations = {parameter.name: parameter.annotation for parameter in parameters}
    vars(expanded).update(__signature__=inspect.Signature(parameters))
    expanded.__doc__, expanded.__name__, expanded.__annotations__ = command.__doc__, command.__name__, annotations
    return expanded


@dataclass
class EnvironmentOptions:
    """The options that make an environment one's own."""

    design: Design = None
    randomization: Randomization = None
    tolerance: Tolerance = None
    load_range: LoadRange = None
    payload_range: PayloadRange = None
    level: Level = None
    option: Option = None

    def parsed(self) -> dict[str, Any]:
        """The environment's options that were given at the command line.

        Raises:
            ConfigError: one cannot be read.
        """
        options: dict[str, Any] = {}
        if self.design is not None:
            options["design"] = env_options.parse_design(self.design)
        if self.randomization is not None:
            options["randomization"] = env_options.parse_randomization(self.randomization)
        if self.tolerance is not None:
            options["tolerance"] = self.tolerance
        if self.load_range is not None:
            options["load_range"] = env_options.parse_range(self.load_range, "--load-range")
        if self.payload_range is not None:
            options["payload_range"] = env_options.parse_range(self.payload_range, "--payload-range")
        if self.level is not None:
            options["level"] = env_options.parse_level(self.level, "--level")
        return options | self.others()

    def others(self) -> dict[str, Any]:
        """Those of them that have no option of their own.

        Raises:
            ConfigError: one cannot be read.
        """
        return env_options.parse_others(self.option or [])

    def checked(self, *env_ids: str) -> dict[str, Any]:
        """The same, once all of these environments have taken them; the last one's are explained.

        Raises:
            ConfigError: one cannot be read, or an environment does not take it.
        """
        options = self.parsed()
        for env_id in env_ids:
            env_options.check_options(env_id, options)
        explain_options(env_ids[-1], options)
        return options


@dataclass
class EnvironmentChoice:
    """The environment, as an argument or an option."""

    environment: EnvArgument = None
    env: EnvOption = None

    def named(self, default: str) -> str:
        """The full id of what was named.

        Args:
            default: id, if nothing was.

        Raises:
            ConfigError: both were given, or there is none of this name.
        """
        return known_env(one_of(self.environment, self.env) or default)


def one_of(environment: str | None, env: str | None) -> str | None:
    """The environment's name as an argument or an option.

    Raises:
        ConfigError: both were given.
    """
    if environment is not None and env is not None:
        raise ConfigError(f"{environment} and --env {env}: give one of them")
    return environment if env is None else env


@dataclass
class ExperimentOptions:
    """The options that choose an experiment and the folder of its results."""

    environment: EnvArgument = None
    config: Config = None
    env: EnvOfConfig = None
    out: Out = None
    seeds: Seeds = None
    fresh: Fresh = False
    jobs: Jobs = None

    @property
    def processes(self) -> int:
        """How many agents are trained at once."""
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        return self.jobs or cores

    def chosen(self, options: EnvironmentOptions, **changes: Any) -> tuple[Experiment, Path]:
        """The experiment, and the folder of its results.

        Args:
            options: of the environment.
            **changes: further values of the experiment; None for those that stay as the config has them.

        Raises:
            ConfigError: something does not fit.
        """
        others = options.others()
        own = {name: value for name, value in options.parsed().items() if name not in others}
        changes = {name: value for name, value in changes.items() if value is not None} | own
        if self.seeds is not None:
            changes["seeds"] = parse_seeds(self.seeds)
        experiment = find_experiment(self.config, one_of(self.environment, self.env))
        if more := changes.pop("more_controllers", None):
            changes["controllers"] = list(dict.fromkeys([*experiment.compared, *more]))
        experiment = experiment.changed(**changes, env_options=experiment.env_options | others)
        folder = checked_folder(self.out or Path("results") / experiment.results_name, "--out")
        explain_options(experiment.env, experiment.options)
        return experiment, folder


def explain_options(env_id: str, options: dict[str, Any]) -> None:
    """Say which options count, and from which design the fields come that are not given."""
    for line in env_options.explain(env_id, options):
        say(line)


def parse_seeds(text: str) -> list[int]:
    """Training seeds from "0,1,2".

    Raises:
        ConfigError: they are not different whole numbers.
    """
    try:
        seeds = [int(part) for part in text.split(",")]
    except ValueError:
        raise ConfigError(f"--seeds {text}: must be whole numbers with commas between them, such as 0,1,2") from None
    if len(set(seeds)) != len(seeds):
        raise ConfigError(f"--seeds {text}: must be different numbers")
    return seeds


def shipped_configs() -> Path:
    """The folder of the configs that come with the package: in it, or, in a checkout, `configs/`."""
    inside = Path(str(files("tensegrity_agents"))) / "configs"
    return inside if inside.is_dir() else Path(__file__).parents[2] / "configs"


def config_folders() -> list[Path]:
    """Where configs are looked up: `configs` in the working directory, and then those that come with the package."""
    return [Path("configs"), shipped_configs()]


def config_ids() -> list[str]:
    """The ids for which there is a config."""
    return list(_configs_in(config_folders())[0])


def _configs_in(folders: list[Path]) -> tuple[dict[str, Path], list[str]]:
    """The configs of some folders by id, of several for one the first; and what is wrong with those that are none."""
    found: dict[str, Path] = {}
    unreadable = []
    for path in [path for place in folders for path in sorted(place.glob("*.yaml"))]:
        try:
            given = str(read_yaml(path, "env: TwoXReach-v0").get("env"))
        except ConfigError as error:
            unreadable.append(str(error))
            continue
        bare = given.rpartition(":")[2]
        found.setdefault(bare if "/" in bare else f"tensegrity/{bare}", path)
    return found, unreadable


def find_experiment(config: Path | None, env: str | None, folder: Path | None = None) -> Experiment:
    """The experiment of a config file, or of the config whose environment is `env`.

    Args:
        config: file.
        env: id, with or without "tensegrity/"; TwoXReach-v0 if neither is given.
        folder: of configs; by default `configs` in the working directory, and then the shipped ones.

    Raises:
        ConfigError: there is none, or the config is for another environment than `env`.
    """
    if config is not None:
        experiment = load_experiment(config)
        if env is not None and known_env(env) != experiment.env:
            raise ConfigError(f"--config {config} is for {experiment.env}, --env says {env}: give one of them")
        return experiment
    wanted = known_env(env or "TwoXReach-v0")
    folders = config_folders() if folder is None else [folder]
    found, unreadable = _configs_in(folders)
    if wanted not in found:
        notes = "".join(f"\n  {note}" for note in unreadable)
        raise ConfigError(
            f"no config for {wanted} in {' and '.join(f'{place.absolute()}{os.sep}' for place in folders)}"
            f"{did_you_mean(wanted, found) or ';'} --config takes a file from anywhere{notes}"
        )
    return load_experiment(found[wanted])
