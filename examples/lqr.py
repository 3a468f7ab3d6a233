"""A linear-quadratic regulator from `tensegrity_envs.linearize`, on a dynamic environment.

python examples/lqr.py [--episodes 50]

The arm goes from where it stands to the nearest posture that has its tip on the target, along a smooth path of postures
that the stiffest feasible tensions hold. About a few of these the environment is linearized, and a regulator is made
for each; on the way, feedforward moves the tensions as the path has them, and the nearest regulator does the rest.
"""

import argparse

import gymnasium as gym
import numpy as np
from rich.console import Console
from scipy.linalg import solve_discrete_are

from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.results import kind_of
from tensegrity_agents.evaluation.rollout import evaluate
from tensegrity_agents.reporting.table import print_table, summary_rows, verdict
from tensegrity_envs import linearize
from tensegrity_envs.mechanics import TwoX
from tensegrity_envs.seeding import TEST_SEED

ENV = "tensegrity/TwoXTensionReachMuJoCo-v0"
STEPS, REGULATORS = 50, 5  # of a path
Q = np.diag([100.0] * 2 + [1.0] * 2 + [1e-4] * 4)  # angles [rad], rates [rad/s], tensions [N]
R = np.eye(4)


def gain(model):
    """The gain of the regulator of a linear model, shape (actions, states)."""
    p = solve_discrete_are(model.A, model.B, Q, R)
    return np.linalg.solve(R + model.B.T @ p @ model.B, model.B.T @ p @ model.A)


class Lqr:
    """The controller. Its memory is one path for each episode, which it is handed back."""

    knows = "the nominal model, linearized about postures on its way"

    def __init__(self, core):
        self.core, self.arm, self.rate = core, TwoX(core.design), core.simulation.rate

    def path_to(self, target, start, tensions):
        """States (angles, rates, tensions) after each step, shape (STEPS + 1, 8), and the gains on the way."""
        found = [one for one in self.arm.inverse_kinematics(*target) if one.is_stable_wrench_feasible]
        goals = [one.configuration for one in found] or [start]
        goal = min(goals, key=lambda q: np.abs(np.array(q) - start).max())
        share = np.linspace(0.0, 1.0, STEPS + 1)[:, None]
        share = share**3 * (10 - 15 * share + 6 * share**2)  # without jerks at its ends
        angles = start + share * (np.array(goal) - start)
        rates = np.gradient(angles, axis=0) / self.step_time(start)
        held = np.stack([self.arm.stiffest_tensions(tuple(q)) for q in angles])
        held += (1 - share) * (tensions - held[0])
        knots = np.linspace(0, STEPS, REGULATORS).astype(int)
        gains = [gain(linearize(self.core, tuple(angles[k]))) for k in knots]
        return np.hstack([angles, rates, held]), gains

    def step_time(self, posture):
        """Of the environment [s]."""
        return linearize(self.core, tuple(posture)).dt

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Actions for a batch of observations, and the paths as what is remembered."""
        seen = self.core.schema.decode(observation)
        now = np.hstack([seen.joint_angles, seen.joint_rates, seen.tensions])
        memory = [None] * len(now) if state is None else list(state)
        actions = np.empty((len(now), 4))
        for i, x in enumerate(now):
            if memory[i] is None or (episode_start is not None and episode_start[i]):
                memory[i] = (0, *self.path_to(seen.target[i], x[:2], x[4:]))
            step, path, gains = memory[i]
            here, after = path[min(step, STEPS)], path[min(step + 1, STEPS)]
            regulator = gains[round(min(step, STEPS) / STEPS * (REGULATORS - 1))]
            actions[i] = (after[4:] - here[4:]) / self.rate - regulator @ (x - here)
            memory[i] = (step + 1, path, gains)
        return np.clip(actions, -1, 1), memory


def main(arguments=None):
    """Score on the test episodes beside the closed form behind a smooth ramp."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=50)
    given = parser.parse_args(arguments)
    mine = Lqr(gym.make(ENV).unwrapped.core)
    runs = [evaluate(mine, ENV, given.episodes, TEST_SEED, "my LQR", "baseline")]
    for name in ("closed_form_ramp", "random"):
        runs.append(evaluate(make_controller(name, ENV), ENV, given.episodes, TEST_SEED, name, kind_of(name)))
    rows = summary_rows(runs)
    print_table(rows, Console())
    print(verdict(rows))
    return rows


if __name__ == "__main__":
    main()
