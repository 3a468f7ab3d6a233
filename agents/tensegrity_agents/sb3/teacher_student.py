"""Teacher to student: a planner that is told the truth shows an agent what to do wherever the agent comes to.

This is DAgger [Ross2011] with a privileged teacher [Chen2020]. The teacher is an oracle of the environment. From the
true state of an episode it is run ahead in the environment's own equations, without noise and delay; the inputs that it
goes through are a path, and the path is rejoined from wherever the student has come to. The student is the policy of
PPO. It sees what agents see, acts, and is trained by regression on what the teacher would have done there. The
teacher's own actions fade out in the first rounds; episodes for which the teacher finds no way to the target are left
out.

[Ross2011] Ross, Gordon, Bagnell, "A reduction of imitation learning and structured prediction to no-regret online
learning", AISTATS 2011.
[Chen2020] Chen, Zhou, Koltun, Kraehenbuehl, "Learning by cheating", CoRL 2020.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from tensegrity_agents.config import Experiment
from tensegrity_agents.controllers import teachers_of
from tensegrity_agents.sb3.errors import TrainingError
from tensegrity_agents.sb3.levels import Shells
from tensegrity_agents.sb3.policy_file import Normalization
from tensegrity_envs.core import Core
from tensegrity_envs.env import unwrapped
from tensegrity_envs.simulation.protocol import RUNNING
from tensegrity_envs.vector_env import ManipulatorVectorEnv

_AHEAD = 8  # steps of a path among which the one to go to is looked for
_OFF = 1.5  # steps: farther from its path than that, the teacher plans anew
_SETTLED = 5  # steps before which it does not
_STILL = 1e-3  # steps: what moves less has come to rest
_HIDDEN = ("actuation_delay", "tip_noise", "angle_noise")  # what the teacher's model of an episode is without
_CREEP = 0.25  # of a step, at least, near the edge of the stable set
_EDGE = 0.25  # stability margin below which steps weigh more
_SLOWEST = 0.02  # of the learning rate, at the end


class Teacher:
    """What an oracle would do, in every environment of a vector.

    Args:
        name: of the oracle, see `controllers.teachers_of`.
        env_id: Gymnasium id.
        options: of the environments.
        shell: the vector environment (`tensegrity_envs.vector_env.ManipulatorVectorEnv`).
        horizon: steps of a plan.
        replan_after: steps after which it plans anew, if the target is not reached.
        plan_every: steps from one planning to the next. Until its turn comes, an environment whose episode has begun
            is shown nothing.
        careful_below: stability margin below which its steps get shorter, down to a quarter; 0 for whole steps always.

    Attributes:
        path: values of what the actions change, (n, horizon, action size); see `driven`.
        place: how far each has come along its path, (n,).
        age: steps since the path was planned, (n,).
        off: distance from the path in steps, (n,).
        knows_a_way: whether the path leads to the target, (n,).
        margin: of stability, where each environment is, (n,).
        past: the latest actions, which may still be pending, (delay, n, action size).
        waits: whether an episode has begun that no path is planned for yet, (n,).
        step: how many there were.
    """

    def __init__(
        self,
        name: str,
        env_id: str,
        options: dict[str, Any],
        shell: ManipulatorVectorEnv,
        horizon: int,
        replan_after: int,
        plan_every: int = 1,
        careful_below: float = 0.0,
    ) -> None:
        self.shell, self.horizon, self.replan_after, self.plan_every = shell, horizon, replan_after, plan_every
        self.careful_below = careful_below
        self.true = shell.core
        drawn = {n: getattr(self.true.randomization, n) for n in self.true.randomization.names if n not in _HIDDEN}
        own = {**options, "randomization": drawn, "level": 0}
        env = unwrapped(gym.make(env_id, **own))
        self.core = env.core
        self.oracle = teachers_of(env_id, options)[name](self.core)
        sampled = self.core.sample(np.zeros(2, np.int64), np.arange(2)).episode
        try:
            self.oracle.begin_episodes(np.ones(2, bool), sampled.design, sampled)
        except ValueError as error:
            drawn_design = ", ".join(name for name in drawn if name in ("stiffness", "mass", "payload"))
            raise TrainingError(
                f"teacher {name!r} of {env_id} cannot be told what every episode draws ({drawn_design}): {error}"
            ) from error
        n, size = shell.num_envs, self.core.simulation.action_size
        self.rate = float(self.core.simulation.rate)
        self.path = np.zeros((n, horizon, size))
        self.place, self.age, self.off = np.zeros(n, int), np.zeros(n, int), np.zeros(n)
        self.knows_a_way, self.margin = np.zeros(n, bool), np.zeros(n)
        self.past = np.zeros((self.true.randomization.longest_delay, n, size))
        self.waits, self.step = np.zeros(n, bool), np.zeros((), int)

    def state(self) -> dict[str, np.ndarray]:
        """All that determines what follows, beside the environments."""
        names = ("path", "place", "age", "off", "knows_a_way", "past", "waits", "step")
        return {name: np.array(getattr(self, name)) for name in names}  # never a scalar: no checkpoint can hold one

    def go_on(self, state: dict[str, np.ndarray]) -> None:
        """Go on where `state` was told; what it is without, since it is older, is as it was made."""
        for name, value in state.items():
            setattr(self, name, value)

    def actions(self, begins: np.ndarray) -> np.ndarray:
        """What the oracle would do now, (n, action size).

        Args:
            begins: which environments are at the beginning of an episode, (n,).
        """
        episodes, outcomes = self.shell.matrices
        self.past[:, begins] = 0.0
        rows = self.true.outcomes.rows
        self.margin = outcomes[rows.state.stability_margin].copy()
        if begins.any():
            self.path[begins] = driven(self.true, outcomes)[begins, None]
            self.waits, self.knows_a_way = self.waits | begins, self.knows_a_way & ~begins
            self.place[begins] = self.age[begins] = 0
            self.off[begins] = 0.0
        if self.step % self.plan_every == 0:
            lost = (self.age >= self.replan_after) | ((self.off > _OFF) & (self.age >= _SETTLED))
            anew = np.flatnonzero(self.waits | (lost & (outcomes[rows.info["is_success"]] == 0)))
            if len(anew):
                self.path[anew], self.knows_a_way[anew] = self._planned(episodes[:, anew], outcomes[:, anew])
                self.place[anew] = self.age[anew] = 0
            self.waits[:] = False
        self.step = self.step + 1
        self.age += 1
        return self._rejoined(self._coming(episodes, outcomes))

    def note(self, actions: np.ndarray) -> None:
        """Remember what was done, (n, action size): under a delay it is still to come."""
        if len(self.past):
            self.past = np.concatenate([np.clip(actions, -1.0, 1.0)[None], self.past[:-1]])

    def _coming(self, episodes: np.ndarray, outcomes: np.ndarray) -> np.ndarray:
        """What the actions change, (n, action size), once the pending actions are taken."""
        here = driven(self.true, outcomes)
        if not len(self.past):
            return here
        delay = episodes[self.true.episodes.rows.random["actuation_delay"]]
        for k, actions in enumerate(self.past):
            here = here + np.where((delay > k)[:, None], self.rate * actions, 0.0)
        if drives_inputs(self.true):
            control: Any = self.true.simulation
            here = np.clip(here, *control.bounds(self.true.nominal))
        return np.asarray(here)

    def _planned(self, episodes: np.ndarray, outcomes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Paths (n, horizon, action size) from these states, and whether each leads to the target."""
        episodes, outcomes = self._undisturbed(episodes, outcomes)
        n, rows = outcomes.shape[1], self.core.outcomes.rows
        episode = self.core.episodes.unpack(episodes)
        # It is told the true design where others are told the nominal one.
        self.oracle.begin_episodes(np.ones(n, bool), episode.design, episode)
        path = np.empty((n, self.horizon, self.path.shape[2]))
        start, memory, before = np.ones(n, bool), None, driven(self.core, outcomes)
        failed = np.zeros(n, bool)
        for step in range(self.horizon):
            actions, memory = self.oracle.predict(observations(self.core, outcomes), memory, start, deterministic=True)
            outcomes = self.core.step(episodes, outcomes, np.clip(np.asarray(actions, float).T, -1.0, 1.0))
            here = driven(self.core, outcomes)
            path[:, step:] = here[:, None]
            start = np.zeros(n, bool)
            failed |= outcomes[rows.state.failure] != RUNNING
            rests = np.abs(here - before).max(axis=1) < _STILL * self.rate
            if (failed | (rests & (outcomes[rows.info["is_success"]] != 0))).all():
                break
            before = here
        # Tasks that last to the end of the episode tell of success only then.
        on_target = outcomes[rows.info[self.core.error_name]] <= self.core.task.tolerance
        return path, ((outcomes[rows.info["is_success"]] != 0) | on_target) & ~failed

    def _undisturbed(self, episodes: np.ndarray, outcomes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same episodes and states without delay and noise."""
        n = outcomes.shape[1]
        episode = self.true.episodes.unpack(episodes)
        kept = {name: value for name, value in episode.random.items() if name in self.core.episodes.rows.random}
        episodes = self.core.episodes.pack(episode._replace(random=kept), n)
        state = self.true.states.unpack(outcomes[: self.true.states.size])._replace(pending=(), noise=())
        return episodes, self.core.evaluate(episodes, self.core.states.pack(state, n))

    def _rejoined(self, here: np.ndarray) -> np.ndarray:
        """Actions that lead to the path, as far along it as one step goes, (n, action size)."""
        rows = np.arange(len(here))
        near = np.minimum(self.place[:, None] + np.arange(_AHEAD), self.horizon - 1)
        away = np.abs(self.path[rows[:, None], near] - here[:, None]).max(axis=2) / self.rate
        fits = away <= 1.0 + 1e-6
        best = np.where(fits.any(axis=1), _AHEAD - 1 - fits[:, ::-1].argmax(axis=1), away.argmin(axis=1))
        self.place, self.off = near[rows, best], away[rows, best]
        aim = self.path[rows, self.place]
        onward = self.path[rows, np.minimum(self.place + 1, self.horizon - 1)] - aim
        # A whole step: between two points of the path, too. Else the length of a step would be that of the way to the
        # last point within reach, which nothing that a student sees can tell it.
        share = np.where(fits.any(axis=1), _share_within(aim - here, onward, self.rate), 0.0)
        gap = (aim + share[:, None] * onward - here) / self.rate
        gap *= np.clip(self.margin / self.careful_below, _CREEP, 1.0)[:, None] if self.careful_below else 1.0
        return np.asarray(gap / np.maximum(np.abs(gap).max(axis=1, keepdims=True), 1.0))


def _share_within(start: np.ndarray, way: np.ndarray, reach: float) -> np.ndarray:
    """How much of a way, at most all, can be gone before a component exceeds `reach`; start and way (n, size)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(way == 0, 1.0, (np.sign(way) * reach - start) / way)
    return np.asarray(np.clip(shares.min(axis=1), 0.0, 1.0))


class Teachers:
    """One teacher for each of several vector environments that are side by side as one; see `Teacher`.

    Args:
        parts: a teacher for each.
    """

    def __init__(self, parts: list[Teacher]) -> None:
        self.parts = parts
        self.ends = np.cumsum([part.shell.num_envs for part in parts])

    @property
    def knows_a_way(self) -> np.ndarray:
        """Whether each path leads to the target, (n,)."""
        return np.concatenate([part.knows_a_way for part in self.parts])

    @property
    def margin(self) -> np.ndarray:
        """Of stability, where each environment is, (n,)."""
        return np.concatenate([part.margin for part in self.parts])

    def state(self) -> list[dict[str, np.ndarray]]:
        """All that determines what follows, beside the environments."""
        return [part.state() for part in self.parts]

    def go_on(self, state: list[dict[str, np.ndarray]]) -> None:
        """Go on where `state` was told."""
        for part, own in zip(self.parts, state, strict=True):
            part.go_on(own)

    def actions(self, begins: np.ndarray) -> np.ndarray:
        """What the oracles would do now, (n, action size); see `Teacher.actions`."""
        return np.concatenate([part.actions(own) for part, own in self._with(begins)])

    def note(self, actions: np.ndarray) -> None:
        """Remember what was done, (n, action size)."""
        for part, own in self._with(actions):
            part.note(own)

    def _with(self, values: np.ndarray) -> list[tuple[Teacher, np.ndarray]]:
        return list(zip(self.parts, np.split(values, self.ends[:-1]), strict=True))


def observations(core: Core, outcomes: np.ndarray) -> dict[str, np.ndarray]:
    """What n environments observe, according to a matrix of outcomes of n columns."""
    rows = core.outcomes.rows
    parts = {"observation": rows.observation, "achieved_goal": rows.achieved, "desired_goal": rows.desired}
    return {name: np.ascontiguousarray(outcomes[list(part)].T, np.float32) for name, part in parts.items()}


def driven(core: Core, outcomes: np.ndarray) -> np.ndarray:
    """What actions change, (n, action size): the inputs, or the configuration where the joints themselves are driven.

    Args:
        core: of the environment.
        outcomes: matrix of n columns.
    """
    state = core.outcomes.rows.state
    return np.asarray(outcomes[list(state.inputs if drives_inputs(core) else state.configuration)].T)


def drives_inputs(core: Core) -> bool:
    """Whether actions change the inputs, not the joints themselves."""
    return bool(len(core.outcomes.rows.state.inputs) == core.simulation.action_size)


class Lessons:
    """Rounds of steps with the teacher at hand, each followed by training on all that was seen lately.

    Args:
        experiment: whose `train.teacher` says how.
        model: of PPO, whose policy is the student.
        env: its environments.
        shell: the vector environment within, or `levels.Shells`.

    Attributes:
        round: how many are over.
    """

    def __init__(
        self, experiment: Experiment, model: PPO, env: VecNormalize, shell: ManipulatorVectorEnv | Shells
    ) -> None:
        settings = experiment.train.teacher
        assert settings is not None
        self.settings, self.model, self.env = settings, model, env
        options = experiment.training_options
        self.teacher = Teachers(
            [
                Teacher(
                    settings.controller,
                    experiment.env,
                    options,
                    part,
                    settings.horizon,
                    settings.replan_after,
                    settings.plan_every,
                    settings.careful_below,
                )
                for part in (shell.parts if isinstance(shell, Shells) else [shell])
            ]
        )
        net: Any = model.policy
        self.parameters = [*net.mlp_extractor.policy_net.parameters(), *net.action_net.parameters()]
        self.optimizer = torch.optim.Adam(self.parameters, lr=settings.learning_rate)
        self.round, self.rounds = 0, -(-settings.timesteps // (settings.n_steps * env.num_envs))
        size = min(settings.buffer_size, self.timesteps)
        space: Any = env.observation_space
        self.seen = {key: np.zeros((size, *part.shape), np.float32) for key, part in space.spaces.items()}
        self.shown = np.zeros((size, *(model.action_space.shape or ())), np.float32)
        self.weight = np.zeros((size, 1), np.float32)
        self.filled = self.next = 0
        self.begins = np.ones(env.num_envs, bool)
        self.observation: Any = None  # before normalization

    @property
    def timesteps(self) -> int:
        """How many there are in all rounds."""
        return self.rounds * self.settings.n_steps * self.env.num_envs

    def begin(self) -> None:
        """Begin episodes everywhere."""
        self.model._last_obs = self.env.reset()
        self.model._last_episode_starts = self.begins = np.ones(self.env.num_envs, bool)
        self.observation = self.env.get_original_obs()

    def state(self) -> dict[str, Any]:
        """All that determines what follows, beside model and environments."""
        return {
            "teacher": self.teacher.state(),
            "optimizer": self.optimizer.state_dict(),
            "round": self.round,
            "seen": {key: array[: self.filled] for key, array in self.seen.items()},
            "shown": self.shown[: self.filled],
            "weight": self.weight[: self.filled],
            "next": self.next,
            "begins": self.begins,
            "observation": self.observation,
        }

    def go_on(self, state: dict[str, Any]) -> None:
        """Go on where `state` was told."""
        self.teacher.go_on(state["teacher"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.round, self.next, self.begins = state["round"], state["next"], state["begins"]
        self.observation, self.filled = state["observation"], len(state["shown"])
        self.shown[: self.filled], self.weight[: self.filled] = state["shown"], state["weight"]
        for key, array in state["seen"].items():
            self.seen[key][: self.filled] = array

    def give(self, after_step: Callable[[np.ndarray, list[dict[str, Any]]], None]) -> None:
        """One round.

        Args:
            after_step: called with dones and infos of every step of all environments.
        """
        model, settings = self.model, self.settings
        share = max(0.0, 1.0 - self.round / settings.rounds_with_teacher) if settings.rounds_with_teacher else 0.0
        observation: Any = model._last_obs
        for _ in range(settings.n_steps):
            wanted = self.teacher.actions(self.begins)
            self._store(self.observation, wanted, np.flatnonzero(self.teacher.knows_a_way))
            actions, _ = model.policy.predict(observation, deterministic=True)
            own = torch.rand(self.env.num_envs).numpy() < share
            actions = np.where(own[:, None], wanted, actions).astype(np.float32)
            self.teacher.note(actions)
            observation, _, self.begins, infos = self.env.step(actions)
            self.observation = self.env.get_original_obs()
            model.num_timesteps += self.env.num_envs
            after_step(self.begins, infos)
        model._last_obs, model._last_episode_starts = observation, self.begins
        self._train()
        self.round += 1

    def _store(self, observation: dict[str, np.ndarray], wanted: np.ndarray, index: np.ndarray) -> None:
        size = len(self.shown)
        index = index[:size]
        place = (self.next + np.arange(len(index))) % size
        for key, array in self.seen.items():
            array[place] = observation[key][index]
        self.shown[place] = wanted[index]
        edge = _EDGE / np.maximum(self.teacher.margin[index], 1e-9)
        self.weight[place, 0] = np.clip(edge, 1.0, self.settings.edge_weight)
        self.next = int(self.next + len(index)) % size
        self.filled = min(self.filled + len(index), size)

    def _train(self) -> None:
        settings, policy = self.settings, self.model.policy
        normalization = Normalization.of(self.env)
        if not self.filled:
            return
        policy.set_training_mode(True)
        for k in range(settings.gradient_steps):
            done = (self.round + k / settings.gradient_steps) / self.rounds
            self.optimizer.param_groups[0]["lr"] = settings.learning_rate * max(1.0 - done, _SLOWEST)
            place = torch.randint(self.filled, (settings.batch_size,)).numpy()
            batch = normalization({key: array[place] for key, array in self.seen.items()})
            tensors = {key: torch.from_numpy(array) for key, array in batch.items()}
            told = policy.get_distribution(tensors).mode()
            shown = torch.from_numpy(self.shown[place])
            loss = torch.nn.functional.smooth_l1_loss(told, shown, beta=settings.beta, reduction="none")
            loss = (torch.from_numpy(self.weight[place]) * loss).mean()
            self.optimizer.zero_grad()
            torch.autograd.backward(loss)
            self.optimizer.step()
        policy.set_training_mode(False)
