"""Tune an analytic controller on validation episodes."""

from typing import Annotated

import typer

from tensegrity_agents.command_options import EnvironmentChoice, EnvironmentOptions, with_option_groups
from tensegrity_agents.console import clear_errors, progress_bar, say
from tensegrity_agents.evaluation.tuning import Tried, tune


@with_option_groups
def main(
    chosen: EnvironmentChoice,
    options: EnvironmentOptions,
    controller: Annotated[str, typer.Option(help="baseline whose class says what is to be tuned")] = "servo",
    episodes: Annotated[int, typer.Option(min=1, help="validation episodes")] = 200,
) -> None:
    """Evaluate a controller with every combination of the values that its class has in `tunable`; the best come first.

    Test episodes are not touched. Ctrl-C ends the search; the best so far are shown. ENVIRONMENT is
    TwoXPayloadReachUncertain-v0 if it is left out.

    Example: tensegrity tune TwoXPayloadReachUncertain-v0 --controller identifying_observer
    """
    with clear_errors():
        env_id = chosen.named("TwoXPayloadReachUncertain-v0")
        given = options.checked(env_id)
        tried: list[Tried] = []
        try:
            with progress_bar() as progress:

                def report(so_far: list[Tried], total: int) -> None:
                    tried[:] = so_far
                    progress(f"tuning {controller}", len(tried), total, f"best {tried[0].success:4.0%}")

                tune(controller, env_id, episodes, given, report)
        finally:
            for one in tried[:10]:
                settings = ", ".join(f"{name} = {value:g}" for name, value in one.settings.items())
                settling = f"  settles in {one.settling:.2f} s" if one.settling else ""
                say(f"{one.success:6.1%}{settling}  {settings}")
