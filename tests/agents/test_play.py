"""Driving an arm by keyboard and mouse, on an invisible window."""

import gymnasium as gym
import numpy as np
import pytest

from tensegrity_agents.command.play import Pointer, action_of, drive, move_target, place_of
from tensegrity_agents.controllers import make_controller
from tensegrity_agents.evaluation.player import Player
from tensegrity_envs.rendering import View, Viewer

ENV = "tensegrity/TwoXReach-v0"
SIZE = (600, 600)


class Scripted:
    """Hands that do one thing after another, and then press Escape."""

    def __init__(self, *moments):
        self.moments, self.now = list(moments), -1

    def pressed(self, key):
        if key == "escape":  # is asked for once a step, first
            self.now += 1
        keys, _ = self.moments[self.now] if self.now < len(self.moments) else ({"escape"}, None)
        return key in keys

    def pointer(self):
        pointer = self.moments[self.now][1]
        return pointer or Pointer((0.0, 0.0), False, False)


@pytest.fixture
def player():
    env = gym.make(ENV, render_mode="rgb_array", max_episode_steps=-1)
    yield Player(env, make_controller("pseudo_inverse", ENV))
    env.close()


@pytest.fixture
def viewer(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    shown = Viewer(SIZE)
    yield shown
    shown.close()


def pixel_of(scene, place):
    return View(SIZE, scene.reach, 1, scene.centre).pixel(place)


def test_keys_become_actions():
    np.testing.assert_allclose(action_of({"right", "down"}.__contains__, 3, 0.3), [0.3, -0.3, 0.0], rtol=1e-6)


@pytest.mark.parametrize("size", [(600, 600), (300, 700), (900, 400)])
def test_a_pixel_and_its_place_are_each_others_inverse(player, size):
    player.begin(0)
    scene = player.env.unwrapped.scene()
    place = np.array([0.12, 0.31])
    pixel = View(size, scene.reach, 1, scene.centre).pixel(tuple(place))
    np.testing.assert_allclose(place_of(scene, size, pixel), place, atol=1e-12)


def test_keys_move_the_joints(player, viewer):
    drive(player, viewer, Scripted(*[({"right"}, None)] * 3), seed=0, speed=0.3)
    after = np.array(player.info["configuration"])
    player.begin(0)
    before, rate = np.array(player.info["configuration"]), player.env.unwrapped.core.simulation.rate
    np.testing.assert_allclose(after - before, [3 * 0.3 * rate, 0.0], atol=1e-6)


def test_the_tip_follows_the_mouse(player, viewer):
    player.begin(0)
    scene = player.env.unwrapped.scene()
    place = np.array(scene.tip) + np.array([0.01, 0.01])
    held = Pointer(pixel_of(scene, tuple(place)), True, False)
    drive(player, viewer, Scripted(*[(set(), held)] * 12), seed=0, speed=0.3)
    np.testing.assert_allclose(player.observation["achieved_goal"], place, atol=2e-3)


def test_the_target_follows_the_mouse_where_the_arm_can_go(player, viewer):
    player.begin(0)
    scene = player.env.unwrapped.scene()
    place = np.array(scene.tip) + np.array([0.02, 0.0])
    before = np.array(player.info["configuration"])
    drive(player, viewer, Scripted((set(), Pointer(pixel_of(scene, tuple(place)), False, True))), seed=0, speed=0.3)
    np.testing.assert_allclose(player.observation["desired_goal"], place, atol=1e-6)
    np.testing.assert_allclose(player.info["configuration"], before, atol=1e-6)
    assert not move_target(player, np.array([9.0, 9.0]))
    np.testing.assert_allclose(player.observation["desired_goal"], place, atol=1e-6)


def test_another_episode_and_a_closed_window(player, viewer):
    drive(player, viewer, Scripted(({"r"}, None)), seed=0, speed=0.3)
    second = player.observation["desired_goal"].copy()
    player.begin(0)
    assert not np.array_equal(player.observation["desired_goal"], second)
    viewer.close()
    drive(player, viewer, Scripted(), seed=0, speed=0.3)  # ends at once


@pytest.mark.parametrize("env_id", ["tensegrity/SpatialPrismTrackMuJoCo-v0", "tensegrity/TwoXPostureChange-v0"])
def test_without_a_tip_in_the_plane_the_mouse_does_nothing(env_id, viewer):
    env = gym.make(env_id, render_mode="rgb_array", max_episode_steps=-1)
    player = Player(env, make_controller("pseudo_inverse", env_id))
    drive(player, viewer, Scripted((set(), Pointer((10.0, 10.0), True, True))), seed=0, speed=0.3)
    assert player.info["step"] == 1
    env.close()
