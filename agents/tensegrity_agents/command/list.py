"""The environments: id, what they are, spaces, baselines."""

import json as json_format
from typing import Annotated, Any

import gymnasium as gym
import typer
from rich.table import Table
from rich.text import Text

from tensegrity_agents.console import clear_errors, console, say
from tensegrity_agents.controllers import baselines_of
from tensegrity_agents.pretrained import pretrained_ids
from tensegrity_envs.registration import ENTRIES


def described(env_id: str, summary: str) -> dict[str, Any]:
    """What `list` says about an environment."""
    sizes: dict[str, list[int]] = {}
    action: list[int] = []
    needs = ""
    try:
        env = gym.make(env_id, disable_env_checker=True)
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


def main(
    json: Annotated[bool, typer.Option("--json", help="as JSON, for machines")] = False,
) -> None:
    """List the environments: id, what they are, sizes of actions and observations, baselines, shipped policies.

    Example: tensegrity list
    """
    with clear_errors():
        rows = [described(entry.id, entry.summary) for entry in ENTRIES]
        if json:
            typer.echo(json_format.dumps(rows, indent=2))
            return
        table = Table("id", "what it is", "action", "observation", "steps", "baselines", "policy")
        for row in rows:
            sizes = " + ".join(str(size[0]) for size in row["observation"].values()) or "?"
            table.add_row(
                Text(row["id"].removeprefix("tensegrity/")),
                Text(row["summary"]),
                str(row["action"][0]) if row["action"] else "?",
                sizes,
                str(row["max_episode_steps"]),
                Text(", ".join(row["baselines"])),
                "yes" if row["policy"] else "",
            )
        console.print(table)
        for needs in dict.fromkeys(row["needs"] for row in rows if row["needs"]):
            say(f"?: {needs}")
