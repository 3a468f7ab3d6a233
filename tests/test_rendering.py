import dataclasses
import math
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

from tensegrity_envs.mechanics.two_x import FURET2018, TwoX
from tensegrity_envs.rendering import Scene, View, Viewer, draw, tension_colour

ARM = TwoX()
TARGET = (-0.2, -0.1)


def scene_of(arm: TwoX, q: tuple[float, float], **changes: object) -> Scene:
    cables = [member.name for member in arm.members if member.kind == "cable"]
    scene = Scene(
        nodes=arm.nodes(q),
        members=arm.members,
        tensions=dict(zip(cables, arm.stiffest_tensions(q))),
        tension_bounds=(arm.design.min_tension, arm.design.max_tension),
        tip=arm.tip(q),
        target=TARGET,
        tolerance=0.005,
        trace=[arm.tip((share * q[0], share * q[1])) for share in np.linspace(0, 1, 20)],
        margins={"stability": 0.8, "wrench": -0.1},
        caption="step 17   tip error 12.3 mm",
        reach=arm.reach,
    )
    return dataclasses.replace(scene, **changes)


SCENE = scene_of(ARM, (0.5, -0.9))


def near(picture: np.ndarray, at: tuple[float, float], radius: int = 5) -> np.ndarray:
    x, y = round(at[0]), round(at[1])
    return picture[y - radius : y + radius + 1, x - radius : x + radius + 1]


def changed(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Columns and rows (n, 2) of the pixels that differ."""
    return np.argwhere((first != second).any(axis=2))[:, ::-1]


@pytest.mark.parametrize("size", [(600, 600), (300, 300), (640, 400)])
def test_a_picture_has_the_requested_size_and_three_bytes_per_pixel(size):
    picture = draw(SCENE, size)
    assert picture.shape == (size[1], size[0], 3)
    assert picture.dtype == np.uint8
    assert (picture < 100).all(axis=2).any(), "the bars are dark"
    assert np.median(picture) > 245, "the background is light"


def test_gauges_legend_and_caption_are_drawn_over_obstacles():
    """They are what they are without the obstacle that fills the picture."""
    far = 4 * ARM.reach
    behind = draw(dataclasses.replace(SCENE, obstacles=[[(-far, -far), (far, -far), (far, far), (-far, far)]]))
    plain = draw(SCENE)
    assert len(changed(behind, plain)) > 0.5 * plain.shape[0] * plain.shape[1]
    np.testing.assert_array_equal(behind[:30], plain[:30])  # the caption
    for rows, columns in ((slice(550, 556), slice(82, 150)), (slice(563, 568), slice(465, 580))):  # a gauge, the legend
        np.testing.assert_array_equal(behind[rows, columns], plain[rows, columns])


def test_obstacles_have_an_outline():
    place = View((600, 600), ARM.reach).pixel
    corners = [(share * ARM.reach, 0.4 * ARM.reach) for share in (-0.95, -0.6)] + [(-0.6 * ARM.reach, 0.7 * ARM.reach)]
    picture = draw(dataclasses.replace(SCENE, obstacles=[corners])).astype(int)

    def redness(point):
        x, y = map(round, place(point))
        return picture[y, x, 0] - picture[y, x, 1:].max()

    inside = tuple(sum(axis) / 3 for axis in zip(*corners, strict=True))
    edge = tuple(sum(axis) / 2 for axis in zip(*corners[1:], strict=True))
    assert redness(edge) > redness(inside) + 40 > 60


def test_the_same_scene_gives_the_same_pixels():
    first = draw(SCENE)
    draw(scene_of(ARM, (-1.0, 0.3), failure="buckled"))
    np.testing.assert_array_equal(first, draw(scene_of(ARM, (0.5, -0.9))))


@pytest.mark.parametrize("reach", [0.5, 0.7, 10.0])
@pytest.mark.parametrize("size", [(600, 600), (300, 300), (500, 300)])
def test_the_target_is_where_the_view_says(reach, size):
    scene = dataclasses.replace(SCENE, reach=reach)
    pixels = changed(draw(scene, size), draw(dataclasses.replace(scene, target=None), size))
    centre = np.array(View(size, reach).pixel(TARGET))
    assert np.abs(pixels - centre).max() < 20
    np.testing.assert_allclose((pixels.min(axis=0) + pixels.max(axis=0) + 1) / 2, centre, atol=1.5)


def test_the_tolerance_is_drawn_to_scale():
    without = draw(dataclasses.replace(SCENE, target=None))
    view = View((600, 600), SCENE.reach)
    for tolerance in (0.05, 0.1):
        pixels = changed(draw(dataclasses.replace(SCENE, tolerance=tolerance)), without)
        radii = np.hypot(*(pixels - view.pixel(TARGET)).T)
        on_ring = np.abs(radii - tolerance * view.scale) < 3
        assert on_ring.sum() > 2 * math.pi * tolerance * view.scale


def test_the_view_shows_the_reach_and_keeps_directions():
    view = View((600, 400), 2.0)
    assert view.pixel((0.0, 1.0))[1] < view.pixel((0.0, 0.0))[1] < view.pixel((0.0, -2.0))[1] < 400
    assert 0 < view.pixel((-2.0, 0.0))[0] < view.pixel((0.0, 0.0))[0] == 300
    assert view.strip < view.pixel((0.0, 2.0))[1]
    assert view.pixel((1.0, 0.0))[0] - 300 == pytest.approx(view.scale)


@pytest.mark.parametrize(
    ("reach", "spacing"), [(0.5, 0.1), (0.6, 0.1), (2.0, 0.5), (4.0, 1.0), (10.0, 2.0), (0.04, 0.01)]
)
def test_the_scale_bar_is_a_round_number(reach, spacing):
    assert View((600, 600), reach).spacing == pytest.approx(spacing)


@pytest.mark.parametrize("name", ["left 1", "right 1", "left 2", "right 2"])
def test_a_cable_has_the_colour_of_its_tension(name):
    member = next(member for member in SCENE.members if member.name == f"cable {name}")
    ends = [View((600, 600), SCENE.reach).pixel(SCENE.nodes[node]) for node in member.nodes]
    middle = ((ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2)
    pictures = {}
    for tension in (10.0, 90.0, 150.0):
        pictures[tension] = draw(dataclasses.replace(SCENE, tensions={**SCENE.tensions, member.name: tension}))
        colour = tension_colour(tension, SCENE.tension_bounds)
        assert (np.abs(near(pictures[tension], middle).astype(int) - colour).max(axis=2) <= 2).any()
    pixels = changed(pictures[10.0], pictures[150.0])
    legend = (pixels[:, 0] > 400) & (pixels[:, 1] > 500)
    assert legend.any()
    assert (np.abs(pixels[~legend] - middle).max(axis=1) < math.dist(*ends) / 2 + 5).all()


def test_spring_and_cable_between_the_same_nodes_are_both_visible():
    everything = draw(SCENE)
    for kind in ("spring", "cable"):
        picture = draw(dataclasses.replace(SCENE, members=[m for m in SCENE.members if m.kind != kind]))
        pixels = changed(everything, picture)
        assert ((pixels[:, 1] > 50) & (pixels[:, 1] < 400)).sum() > 200


def test_members_abreast_do_not_depend_on_the_order_of_their_nodes():
    tensions = dict.fromkeys(SCENE.tensions, 150.0)
    turned = [dataclasses.replace(m, nodes=m.nodes[::-1]) if m.kind == "cable" else m for m in SCENE.members]
    cables = []
    for members in (SCENE.members, turned):
        arm = draw(dataclasses.replace(SCENE, tensions=tensions, members=members))[:400].astype(int)
        cables.append((np.abs(arm - tension_colour(150.0, SCENE.tension_bounds)) < 3).all(axis=2))
    assert (cables[0] & cables[1]).sum() > 0.8 * cables[0].sum() > 80


def test_colours_of_tension_grow_lighter_and_stop_at_the_bounds():
    luminance = [np.dot(tension_colour(t, (5.0, 155.0)), (0.2126, 0.7152, 0.0722)) for t in range(5, 156, 10)]
    assert (np.diff(luminance) > 0).all()
    assert tension_colour(-10.0, (5.0, 155.0)) == tension_colour(5.0, (5.0, 155.0))
    assert tension_colour(1e6, (5.0, 155.0)) == tension_colour(155.0, (5.0, 155.0))
    assert tension_colour(1.0, (2.0, 2.0)) == tension_colour(3.0, (2.0, 2.0))


@pytest.mark.parametrize(("value", "channel"), [(0.5, 1), (0.0, 1), (-0.5, 0), (math.nan, 0), (math.inf, 1), (-7.0, 0)])
def test_a_margin_is_green_from_zero_on_and_red_otherwise(value, channel):
    corner = draw(dataclasses.replace(SCENE, margins={"stability": value}))[500:, :250].astype(int)
    others = [other for other in (0, 1, 2) if other != channel]
    assert (corner[..., channel] - corner[..., others].max(axis=2) > 60).sum() > 20


def test_a_failure_is_red_and_drawn_without_hiding_the_caption():
    strip = draw(dataclasses.replace(SCENE, failure="buckled"))[:30].astype(int)
    red = strip[..., 0] - strip[..., 1:].max(axis=2) > 100
    assert red[8:, 500:].sum() > 50
    np.testing.assert_array_equal(strip[8:25, 10:300], draw(SCENE)[8:25, 10:300])


@pytest.mark.parametrize("size", [(600, 600), (300, 300)])
@pytest.mark.parametrize(
    "changes",
    [
        {"trace": [], "target": None},
        {"trace": [(0.0, 0.5)], "margins": {}, "tensions": {}, "caption": ""},
        {"nodes": {}, "members": []},
        {"members": [member for member in SCENE.members if member.kind == "bar"], "base": ()},
        {"base": ["A1"], "tension_bounds": (5.0, 5.0)},
        {"caption": "c" * 200, "failure": "f" * 200},
        {
            "nodes": {**SCENE.nodes, "P": (1e12, -1e300)},
            "tip": (math.inf, math.nan),
            "trace": [(0.0, 0.0), (1e9, -1e9)],
        },
    ],
)
def test_unusual_scenes_are_drawn(changes, size):
    assert draw(dataclasses.replace(SCENE, **changes), size).std() > 0


def test_mechanisms_without_offsets_are_drawn():
    arm = TwoX(FURET2018(0.5))
    assert draw(scene_of(arm, (0.7, -1.2), tensions={})).std() > 0


def test_a_trace_shows_its_last_positions():
    without = draw(dataclasses.replace(SCENE, trace=[]))
    recent = [(0.3 + 0.0005 * i, 0.2) for i in range(200)]
    shown = draw(dataclasses.replace(SCENE, trace=recent))
    assert len(changed(without, shown)) > 50
    np.testing.assert_array_equal(draw(dataclasses.replace(SCENE, trace=[(-0.3, 0.0)] * 50 + recent)), shown)


def test_importing_loads_no_pygame_and_drawing_opens_no_display():
    code = """
import sys
import tensegrity_envs.rendering as rendering
assert "pygame" not in sys.modules
scene = rendering.Scene({}, [], {}, (0.0, 1.0), (0.0, 0.0), None, 0.01, [], {}, "", 1.0)
assert rendering.draw(scene).shape == (600, 600, 3)
import pygame
assert not pygame.display.get_init()
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert not result.stdout, "pygame's greeting"


def test_drawing_survives_that_other_code_quits_pygame():
    import pygame

    first = draw(SCENE)
    pygame.quit()
    np.testing.assert_array_equal(draw(SCENE), first)


@pytest.fixture
def dummy_display(monkeypatch):
    import pygame

    pygame.display.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    yield
    pygame.display.quit()


def test_a_viewer_shows_what_draw_draws(dummy_display):
    import pygame

    viewer = Viewer((300, 300))
    assert viewer.show(SCENE, fps=1000)
    shown = pygame.surfarray.array3d(viewer._window.get_surface()).transpose(1, 0, 2)
    np.testing.assert_array_equal(shown, draw(SCENE, (300, 300)))
    viewer.close()
    viewer.close()
    assert not viewer.show(SCENE)


def test_closing_one_window_leaves_the_other_open(dummy_display):
    import pygame

    first, second = Viewer((100, 100)), Viewer((100, 100))
    pygame.event.post(pygame.event.Event(pygame.WINDOWCLOSE, window=second._window))
    assert first.show(SCENE, fps=1000)
    assert not second.show(SCENE, fps=1000)
    assert first.show(SCENE, fps=1000)
    first.close()


def test_a_viewer_ends_quietly_when_other_code_quits_pygame(dummy_display):
    import pygame

    viewer = Viewer((100, 100))
    pygame.quit()
    assert not viewer.show(SCENE)
    viewer.close()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems always have a display")
@pytest.mark.parametrize("display", [None, ":7777"])
def test_a_viewer_without_display_says_what_to_do(monkeypatch, display):
    import pygame

    pygame.display.quit()
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    if display:
        monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(RuntimeError, match=r"DISPLAY.*rgb_array"):
        Viewer()
    assert not pygame.display.get_init()


@pytest.mark.parametrize(
    "name", ["TwoXReach", "DualTriangleReach", "PlanarFourBarReach", "SpatialPrismTrack", "SpatialPrismTrackMuJoCo"]
)
def test_arm_and_goal_fill_the_picture_and_are_inside(name):
    """Over 40 episodes everything is inside the frame, and at least 80% of its width or height is used."""
    if "MuJoCo" in name:
        pytest.importorskip("mujoco")
    env = gym.make(f"tensegrity_envs:tensegrity/{name}-v0").unwrapped
    points = []
    for seed in range(40):
        env.reset(seed=seed)
        scene = env.scene()
        here = np.array([*scene.nodes.values(), scene.tip, scene.target], float)
        points.append((here - scene.centre) / scene.reach)
    points = np.concatenate(points)
    assert np.abs(points).max() <= 1.0
    assert np.ptp(points, axis=0).max() > 1.6
    env.close()


def test_the_posture_to_be_reached_is_drawn():
    env = gym.make("tensegrity_envs:tensegrity/TwoXPostureChange-v0").unwrapped
    env.reset(seed=0)
    scene = env.scene()
    goal = 2 * np.array(env.episode.goal, float)
    for name, place in env.core.nominal.nodes(tuple(goal)).items():
        np.testing.assert_allclose(scene.ghost[name], place)
    pixels = changed(draw(scene), draw(dataclasses.replace(scene, ghost=None)))
    view = View((600, 600), scene.reach, centre=scene.centre)
    ends = [np.array(view.pixel(scene.ghost[node])) for node in scene.members[0].nodes]
    middle = (ends[0] + ends[1]) / 2
    assert np.abs(pixels - middle).max(axis=1).min() < 4
    env.close()
