"""An environment as pure functions on components: mechanism x simulation x task.

The single and the vector shell run this one code.

Components are floats in the single environment and arrays of shape (n,) in the vector environment.
"""

from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from gymnasium import spaces

from tensegrity_envs.mechanics.namespace import Component, Components, namespace_of
from tensegrity_envs.mechanics.two_x import MURALIDHARAN2022, TwoX, TwoXDesign
from tensegrity_envs.simulation.protocol import FAILURES, RUNNING, Simulation, State
from tensegrity_envs.simulation.quasi_static import JointControl, TensionControl
from tensegrity_envs.tasks.reach import Reach, RewardWeights, feasible_solutions
from tensegrity_envs.tasks.sampling import Sampler

JOINT_LIMIT = 2.6  # [rad] shared with the MuJoCo variants, where a loop could flip beyond it
CONTROLS: dict[str, type[JointControl] | type[TensionControl]] = {"joint": JointControl, "tension": TensionControl}


def environment_design(design: TwoXDesign = MURALIDHARAN2022) -> TwoXDesign:
    """The design as the environments use it: joint limits of at most 2.6 rad."""
    return replace(design, joint_limit=min(design.joint_limit, JOINT_LIMIT))


class Episode(NamedTuple):
    """What stays the same during an episode.

    Attributes:
        mechanism: with its true parameters.
        goal: target position (x, y) [m], as float32 numbers.
        solutions: feasible configurations that put the tip there, for the reward.
    """

    mechanism: TwoX
    goal: Components
    solutions: tuple[Components, ...] | None


class Core:
    """The 2-X reaching environments.

    Args:
        design: of the arm that controllers are told about; joint limits beyond 2.6 rad are narrowed to that.
        control: "joint" (two increments of at most 0.1 rad) or "tension" (four of at most 15 N).
        payload_range: if given, every episode draws an unknown payload from it [kg], uniformly.
        observe: "full", or "tip_and_tensions" (no joint angles, no margins).
        reward_type: "dense" or "sparse".
        reward_weights: of the dense reward, by name; those left out keep their default.
        tolerance: success within this distance [m].

    Raises:
        ValueError: an argument is out of range; the message names it.
        TypeError: `design` is not a design.
    """

    def __init__(
        self,
        design: TwoXDesign = MURALIDHARAN2022,
        control: Literal["joint", "tension"] = "joint",
        payload_range: tuple[float, float] | None = None,
        observe: Literal["full", "tip_and_tensions"] = "full",
        reward_type: Literal["dense", "sparse"] = "dense",
        reward_weights: dict[str, float] | RewardWeights | None = None,
        tolerance: float = 0.005,
    ) -> None:
        if not isinstance(design, TwoXDesign):
            raise TypeError(
                f"design = {design!r}: must be a TwoXDesign, such as tensegrity_envs.mechanics.MURALIDHARAN2022"
            )
        if control not in CONTROLS:
            raise ValueError(f"control = {control!r}: must be one of {', '.join(map(repr, CONTROLS))}")
        if observe not in ("full", "tip_and_tensions"):
            raise ValueError(f"observe = {observe!r}: must be 'full' or 'tip_and_tensions'")
        if payload_range is not None and control != "tension":
            raise ValueError(
                "payload_range: needs control = 'tension' (in joint control the cables would give the payload away)"
            )
        self.design = environment_design(design)
        self.nominal = TwoX(self.design)
        self.simulation: Simulation = CONTROLS[control]()
        self.payload_range = payload_range
        self.observe_all = observe == "full"
        self.task = Reach(
            max_tension=float(self.design.max_tension),
            joint_span=2 * self.design.joint_limit,
            tolerance=tolerance,
            reward_type=reward_type,
            weights=_weights(reward_weights),
        )
        self.sampler = Sampler(self.design, payload_range)
        self.reach = float(self.nominal.reach)
        size = 2 + 4 + (4 + 2 if self.observe_all else 0)
        box = spaces.Box(-1.0, 1.0, (size,), np.float32)
        goal = spaces.Box(-self.reach, self.reach, (2,), np.float32)
        self.observation_space = spaces.Dict({"observation": box, "achieved_goal": goal, "desired_goal": goal})
        self.action_space = spaces.Box(-1.0, 1.0, (self.simulation.action_size,), np.float32)

    def begin(self, seed: np.ndarray, episode: np.ndarray) -> tuple[Episode, State]:
        """Draw the episodes of the given (seed, episode) pairs, both of shape (n,)."""
        drawn = self.sampler.draw(seed, episode)
        mechanism = drawn.mechanism
        state = (
            self.simulation.start(mechanism, drawn.configuration)
            if drawn.tensions is None
            else self.simulation.at(mechanism, drawn.configuration, drawn.tensions)
        )
        x, y = (np.float32(component).astype(float) for component in mechanism.tip(drawn.target_configuration))
        solutions = None
        if self.task.reward_type == "dense":
            solutions = feasible_solutions(mechanism, x, y, drawn.target_configuration)
        return Episode(mechanism, (x, y), solutions), state

    def advance(self, episode: Episode, state: State, action: Components) -> State:
        """The state one step later."""
        return self.simulation.advance(episode.mechanism, state, action)

    def observation(self, state: State) -> list[Component]:
        """Components of the "observation" entry, each within [-1, 1].

        tip / reach (2), tensions from -1 at their minimum to 1 at their maximum (4), and, if all is observed, sine and
        cosine of each joint angle (4), stability and wrench margin m as m / (1 + |m|) (2).
        """
        xp = namespace_of(state.tip[0])
        low, high = self.design.min_tension, self.design.max_tension
        parts = [component / self.reach for component in state.tip]
        parts += [(2 * f - (high + low)) / (high - low) for f in state.inputs]
        if self.observe_all:
            for angle in state.configuration:
                parts += [xp.sin(angle), xp.cos(angle)]
            parts += [m / (1 + abs(m)) for m in (state.stability_margin, state.wrench_margin)]
        return parts

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """Reward of the dense or sparse form for any goals, as `step` gives it. See `TwoXReachEnv.compute_reward`."""
        achieved, desired, batch, single = _goals(achieved_goal, desired_goal, info)
        state = _state_from_info(batch)
        error = np.hypot(achieved[:, 0] - desired[:, 0], achieved[:, 1] - desired[:, 1])
        solutions = None
        if self.task.reward_type == "dense":
            mechanism = self.nominal
            if self.payload_range is not None:
                mechanism = TwoX(replace(self.design, payload=batch["payload"]))
            solutions = feasible_solutions(mechanism, desired[:, 0], desired[:, 1])
        reward = np.asarray(total_reward(self.task.reward_terms(np, error, state, solutions)))
        return float(reward[0]) if single else reward

    def compute_terminated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> Any:
        """Whether the episode failed in that step; it does not depend on the goals."""
        _, _, batch, single = _goals(achieved_goal, desired_goal, info)
        failed = batch["failure"] != RUNNING
        return bool(failed[0]) if single else failed


_INFO_KEYS = ("configuration", "tensions", "stability_margin", "wrench_margin", "failure", "payload")


def information(
    core: Core, state: State, error: Component, terms: dict[str, Component], payload: Component
) -> dict[str, Any]:
    """The `info` of a step, apart from its vectors: names as documented in `TwoXReachEnv`."""
    return {
        "is_success": core.task.is_success(error, state.failure),
        "tip_error": error,
        "stability_margin": state.stability_margin,
        "wrench_margin": state.wrench_margin,
        "is_stable": state.stability_margin > 0,
        "is_wrench_feasible": state.wrench_margin >= 0,
        "failure": state.failure,
        "payload": payload,
        "effort": core.task.effort(state),
        **{f"reward_{name}": term for name, term in terms.items()},
    }


def total_reward(terms: dict[str, Component]) -> Component:
    """The sum of the terms to nine decimals, so that float, batch and relabelled computations give the same number
    to the last bit.
    """
    total: Component = sum(terms.values())
    return np.round(total, 9) if isinstance(total, np.ndarray) else round(total, 9)


def _weights(given: dict[str, float] | RewardWeights | None) -> RewardWeights:
    if isinstance(given, RewardWeights):
        return given
    known = list(RewardWeights.__dataclass_fields__)
    for name in given or {}:
        if name not in known:
            raise ValueError(f"reward_weights: no term {name!r}; there are {', '.join(known)}")
    return RewardWeights(**(given or {}))


def _goals(achieved: Any, desired: Any, info: Any) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], bool]:
    """Goals as (n, 2) arrays and the infos as one dict of arrays."""
    achieved, desired = np.asarray(achieved, float), np.asarray(desired, float)
    single = achieved.ndim == 1
    if achieved.shape != desired.shape or achieved.shape[-1] != 2 or achieved.ndim > 2:
        raise ValueError(
            f"goals of shapes {achieved.shape} and {desired.shape}: both must be (2,) or (n, 2), in metres"
        )
    infos = [info] if isinstance(info, dict) and single else info
    if not isinstance(infos, dict):
        if len(infos) != (1 if single else len(achieved)) or any(key not in i for i in infos for key in _INFO_KEYS):
            raise ValueError(
                "compute_reward needs the info of every step (the reward depends on tensions and margins, "
                "not on the goals alone): with Stable-Baselines3, HerReplayBuffer(copy_info_dict=True)"
            )
        infos = {key: np.array([i[key] for i in infos]) for key in _INFO_KEYS}
    elif any(key not in infos for key in _INFO_KEYS):
        raise ValueError(
            f"info lacks {[key for key in _INFO_KEYS if key not in infos]}: pass the info that step returned"
        )
    return np.atleast_2d(achieved), np.atleast_2d(desired), infos, single


def _state_from_info(info: dict[str, np.ndarray]) -> State:
    configuration, tensions = info["configuration"].T, info["tensions"].T
    return State(
        tuple(configuration), tuple(tensions), (), info["stability_margin"], info["wrench_margin"], info["failure"]
    )


def failure_name(code: int) -> str:
    """Why an episode was terminated, in words; empty while it runs."""
    return FAILURES[code]
