"""The laws hold for an environment of one's own that never fails, and end in time."""

import sys
from pathlib import Path

import gymnasium as gym
import pytest

from tensegrity_envs.environments import TwoXReach
from tensegrity_envs.simulation.protocol import RUNNING
from tensegrity_envs.simulation.quasi_static import JointControl

sys.path.insert(0, str(Path(__file__).parent))
import test_laws as laws

ENV_ID = "tensegrity-test/Calm-v0"
LAWS = (
    laws.test_single_and_vector_environments_run_identically_episode_by_episode,
    laws.test_compute_functions_of_the_vector_environment_agree_with_its_step,
    laws.test_observations_stay_in_their_space_and_info_says_what_is_so,
    laws.test_staggered_episodes_reach_their_time_limit_one_after_another,
    laws.test_vector_refuses_bad_input_with_clear_errors,
)
LAWS_OF_FORMS = (
    laws.test_gymnasium_checker_has_nothing_to_say,
    laws.test_compute_functions_agree_with_step_on_batches,
    laws.test_failing_early_never_pays,
)


class CalmControl(JointControl):
    """Joint control that leaves the arm where it is instead of failing."""

    def advance(self, mechanism, episode, state, action):
        """See `Simulation.advance`."""
        new = super().advance(mechanism, episode, state, action)
        return new._replace(failure=RUNNING + 0 * new.failure)


class Calm(TwoXReach):
    """A 2-X whose episodes end by the time limit alone."""

    can_fail = False

    def __init__(self, **further):
        super().__init__(**further)
        self.simulation = CalmControl()


@pytest.fixture(autouse=True)
def registered():
    gym.register(
        ENV_ID,
        entry_point="tensegrity_envs.env:ManipulatorEnv",
        vector_entry_point="tensegrity_envs.vector_env:ManipulatorVectorEnv",
        max_episode_steps=60,
        kwargs={"arm": Calm},
    )
    yield
    del gym.registry[ENV_ID]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_law(law):
    law(ENV_ID)


@pytest.mark.parametrize("reward_type", ["dense", "sparse"])
@pytest.mark.parametrize("law", LAWS_OF_FORMS, ids=lambda law: law.__name__)
def test_law_of_both_forms(law, reward_type):
    law(ENV_ID, reward_type)
