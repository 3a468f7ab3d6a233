"""The environments: id, what they are, spaces, baselines."""

from textwrap import fill
from typing import Any

import gymnasium as gym
from rich.table import Table
from rich.text import Text

from tensegrity_agents.command_options import EnvArgument, Json, config_ids
from tensegrity_agents.config import known_env
from tensegrity_agents.console import clear_errors, console, for_machines, say, tell_json
from tensegrity_agents.controllers import baselines_of
from tensegrity_agents.env_options import short_name
from tensegrity_agents.pretrained import pretrained_ids
from tensegrity_envs.env import unwrapped
from tensegrity_envs.registration import ENTRIES


def described(env_id: str, summary: str) -> dict[str, Any]:
    """What `list` says about an environment."""
    sizes: dict[str, list[int]] = {}
    action: list[int] = []
    needs = ""
    try:
        env = gym.make(env_id)
    except ImportError as error:
        needs = str(error)
    else:
        sizes = {name: list(space.shape or ()) for name, space in env.observation_space.spaces.items()}  # type: ignore[attr-defined]
        action = list(env.action_space.shape or ())
        env.close()
    return {
        "id": env_id,
        "summary": summary,
        "action": action,
        "observation": sizes,
        "max_episode_steps": gym.spec(env_id).max_episode_steps,
        "baselines": list(baselines_of(env_id)),
        "policy": env_id in pretrained_ids(),
        "needs": needs,
    }


def detailed(row: dict[str, Any]) -> dict[str, Any]:
    """The same, and what the numbers mean, for one environment whose packages are there."""
    core = unwrapped(gym.make(row["id"])).core
    simulation, schema = core.simulation, core.schema
    moved = "joint angles" if core.control == "joint" else schema.fields[core.input_name].meaning
    return row | {
        "an_action_of_1": f"moves the {moved} by {simulation.rate:.5g} {simulation.rate_unit} in a step",
        "observed": {name: f"{field.meaning} [{field.unit}]" for name, field in schema.fields.items()},
        "goal": core.goal_text,
        "tolerance": float(core.task.tolerance),
        "tolerance_unit": "m" if core.error_unit == "mm" else "rad",
        "reward": type(core.task.weights).__name__,
        "randomizable": sorted(core.randomizable),
        "config": row["id"] in config_ids(),
    }


def main(
    environment: EnvArgument = None,
    json: Json = False,
) -> None:
    """List the environments, one line for each: id, sizes of actions and observations, what it is, baselines.

    With an id, tell all about that one.

    Example: tensegrity list, or tensegrity list TwoXReach-v0
    """
    with for_machines(json), clear_errors():
        summaries = {entry.id: entry.summary for entry in ENTRIES}
        if environment is not None:
            env_id = known_env(environment)
            row = described(env_id, summaries.get(env_id, "an environment of your own"))
            row = row if row["needs"] else detailed(row)
            if json:
                tell_json(row)
            else:
                tell_one(row, environment if ":" in environment else short_name(env_id))
            return
        rows = [described(env_id, summary) for env_id, summary in summaries.items()]
        if json:
            tell_json(rows)
            return
        tell_all(rows)


def tell_all(rows: list[dict[str, Any]]) -> None:
    """One line for each environment, of which a terminal cuts off what has no room; a file or a pipe gets all of it,
    in lines that go on below each other.
    """
    lines = [("id", "action", "observation", "steps", "policy", "what it is; baselines")]
    lines += [
        (
            short_name(row["id"]),
            str(row["action"][0]) if row["action"] else "?",
            "+".join(str(size[0]) for size in row["observation"].values()) or "?",
            str(row["max_episode_steps"]),
            "yes" if row["policy"] else "",
            f"{row['summary']}; {', '.join(row['baselines'])}",
        )
        for row in rows
    ]
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]) - 1)]
    room = console.width
    for *cells, text in lines:
        start = "".join(f"{cell:{width}}  " for cell, width in zip(cells, widths, strict=True))
        if console.is_terminal:
            line = start + text
            say(line if len(line) <= room else line[: room - 1] + "…")
        else:
            say(fill(text, room, initial_indent=start, subsequent_indent="    ", break_on_hyphens=False))
    for needs in dict.fromkeys(row["needs"] for row in rows if row["needs"]):
        say(f"?: {needs}")
    say("observation: sizes of achieved_goal + desired_goal + observation. All about one: tensegrity list ID")


def tell_one(row: dict[str, Any], name: str) -> None:
    """All about one environment, which commands know by a name."""
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for key, value in row.items():
        shown: object = value
        if isinstance(value, dict):
            shown = "\n".join(f"{name}: {one[0] if isinstance(one, list) else one}" for name, one in value.items())
        elif isinstance(value, list):
            shown = ", ".join(str(one) for one in value)
        elif isinstance(value, bool):
            shown = "yes" if value else "no"
        if shown != "":
            table.add_row(key.replace("_", " "), Text(str(shown)))
    console.print(table)
    say(f"\ntensegrity watch {name}    tensegrity play {name}    tensegrity compare {name}")
