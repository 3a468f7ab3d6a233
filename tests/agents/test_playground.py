"""The playground's pages give in a browser what Python gives, load nothing, and obey pointer and keyboard."""

import json
import re
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from tensegrity_agents.playground import PLAYGROUNDS, write_playground
from tensegrity_envs.mechanics import (
    JI2014,
    MURALIDHARAN2022,
    NX,
    THREE_X,
    ZHAO2021_CAPTION,
    DualTriangle,
    PlanarFourBar,
    SpatialPrism,
    TwoX,
)

COUNT = 1000
NEAR_FOLD = 1e-3  # of a determinant or a margin: there two solutions all but meet, and digits are lost

POSTURES = {
    "two-x": lambda design: TwoX(replace(MURALIDHARAN2022, **design)),
    "n-x": lambda design: NX(replace(THREE_X, **design)),
    "dual-triangle": lambda design: DualTriangle(replace(ZHAO2021_CAPTION, **design)),
}


def random_inputs(name):
    """Slider values and targets, uniform over the sliders' ranges and the plot."""
    rng, page = np.random.default_rng(18), PLAYGROUNDS[name]
    x0, y0, x1, y1 = page.main.bounds
    found = []
    for k in range(COUNT):
        one = {
            "target": [rng.uniform(x0, x1), rng.uniform(y0, y1)],
            "design": dict(page.design),
            "load": {},
            "extra": {},
        }
        for slider in page.sliders:
            value = slider.value if k % 4 == 0 else rng.uniform(slider.low, slider.high)
            if slider.group == "extra":
                value = rng.uniform(slider.low, slider.high)
            for key in slider.keys:
                one[slider.group][key] = value
        one["load"] = [one["load"][i] for i in range(len(one["load"]))]
        if name in POSTURES:  # a tip that can be reached
            arm, q = POSTURES[name](one["design"]), rng.uniform(-1.5, 1.5, 3)
            one["extra"] = {"q1": q[0]}
            one["target"] = list(arm.tip(tuple(1.8 * q[:2] if name == "two-x" else q)))
        found.append(one)
    return found


def solutions_in_browser(in_browser, name, inputs):
    keep = "({nodes, ...rest}) => ({...rest, tip: nodes.P ?? nodes.F})"
    html = f"<!DOCTYPE html><html><head><script>{PLAYGROUNDS[name].solver()}</script></head><body></body></html>"
    return in_browser(html, f"return {json.dumps(inputs)}.map(one => MECHANISM.solve(one).map({keep}));")


def assert_close(found, expected, scale=1.0):
    np.testing.assert_allclose(np.array(found, float), np.array(expected, float), rtol=1e-9, atol=1e-9 * scale)


def close_to(angles, others):
    gap = np.abs(np.array(angles) - np.array(others))
    return np.minimum(gap, np.abs(gap - 4 * np.pi)).max() < 1e-9


def test_two_x(in_browser):
    inputs = random_inputs("two-x")
    compared = 0
    for one, answers in zip(inputs, solutions_in_browser(in_browser, "two-x", inputs), strict=True):
        arm = POSTURES["two-x"](one["design"])
        expected = arm.inverse_kinematics(*one["target"])
        if any(
            abs(s.singularity) < NEAR_FOLD * arm.reach**2 or max(map(abs, s.configuration)) > 3.13 for s in expected
        ):
            continue
        assert len(answers) == len(expected)
        for answer, solution in zip(answers, expected, strict=True):
            assert close_to(answer["q"], solution.configuration)
            assert answer["label"] == solution.state
            assert_close(answer["determinant"], solution.singularity)
            tensions, stability, wrench = arm.posture(solution.configuration, one["load"])
            near_flat = abs(np.cos(np.array(solution.configuration) / 2)).min() < 0.05  # where tensions are huge
            if not near_flat:
                assert_close(answer["tensions"], tensions, 155)
                assert_close([answer["stability"], answer["wrench"]], [stability, wrench])
                assert answer["usable"] == (stability > 0 and wrench >= 0)
            compared += 1
    assert compared > 1500


def test_n_x(in_browser):
    """The last two joints are a 2-X that stands on the first: Python finds its solutions by a polynomial."""
    inputs = random_inputs("n-x")
    compared = 0
    for one, answers in zip(inputs, solutions_in_browser(in_browser, "n-x", inputs), strict=True):
        arm, q1 = POSTURES["n-x"](one["design"]), one["extra"]["q1"]
        pair = TwoX(replace(MURALIDHARAN2022, **{name: one["design"][name] for name in ("a", "b", "l")}))
        nodes = {name: complex(*place) for name, place in arm.nodes((q1, 0.0, 0.0)).items()}
        seen = (complex(*one["target"]) - (nodes["A2"] + nodes["B2"]) / 2) / np.exp(1j * q1)
        expected = pair.inverse_kinematics(seen.real, seen.imag)
        if any(
            abs(s.singularity) < NEAR_FOLD * pair.reach**2 or max(map(abs, s.configuration)) > 3.13 for s in expected
        ):
            continue
        assert len(answers) == len(expected)
        for answer, solution in zip(answers, expected, strict=True):
            q = (q1, *solution.configuration)
            assert close_to(answer["q"], q)
            assert_close(answer["tip"], one["target"])
            assert_close(answer["determinant"], arm.jacobian_determinant(q))
            if abs(np.cos(np.array(q) / 2)).min() > 0.05:  # else flat, where tensions are huge
                tensions, stability, wrench = arm.posture(q, one["load"])
                assert_close(answer["tensions"], tensions, 250)
                assert_close([answer["stability"], answer["wrench"]], [stability, wrench])
                assert answer["usable"] == (stability > 0 and wrench >= 0)
            compared += 1
    assert compared > 1000


def test_dual_triangle(in_browser):
    inputs = random_inputs("dual-triangle")
    compared = 0
    for one, answers in zip(inputs, solutions_in_browser(in_browser, "dual-triangle", inputs), strict=True):
        arm = POSTURES["dual-triangle"](one["design"])
        expected = arm.inverse_kinematics(*one["target"], one["extra"]["q1"])
        if any(abs(np.sin(s.configuration[2])) < NEAR_FOLD for s in expected):
            continue
        assert len(answers) == len(expected)
        for answer, solution in zip(answers, expected, strict=True):
            q = solution.configuration
            assert_close(answer["q"], q)
            assert_close(answer["determinant"], solution.singularity)
            assert_close(answer["tip"], one["target"])
            if not solution.is_within_limits:
                continue
            control = arm.control(q, one["load"])
            lengths = arm.free_lengths(control)
            assert_close(answer["control"], control)
            assert_close(answer["stability"], arm.stability_margin(q, lengths, one["load"]))
            assert_close([answer["limit"], answer["length"]], [arm.limit_margin(q), min(lengths)])
            compared += 1
    assert compared > 800


def test_planar_four_bar(in_browser):
    inputs = random_inputs("planar-four-bar")
    compared = 0
    for one, answers in zip(inputs, solutions_in_browser(in_browser, "planar-four-bar", inputs), strict=True):
        arm = PlanarFourBar(replace(JI2014, **one["design"]))
        expected = arm.inverse_kinematics(*one["target"], one["load"])

        def worst(s, arm=arm, load=one["load"]):
            (j11, j12), (j21, j22) = arm.jacobian(s.configuration, s.lengths, load)
            det, hess = (
                j11 * j22 - j12 * j21,
                np.linalg.det(np.array(arm.stiffness_matrix(s.configuration, s.lengths, load))),
            )
            size = (arm.stiffness * arm.length**2) ** 2
            return min(1 / (1e-9 + abs(det)), abs(det), abs(hess) / size, min(s.lengths) / 10, 2 - max(s.lengths) / 10)

        if any(worst(s) < NEAR_FOLD for s in expected):
            continue
        assert len(answers) == len(expected)
        order = [
            sorted(range(len(found)), key=key)
            for found, key in (
                (answers, lambda i, a=answers: (*np.round(a[i]["lengths"], 6), a[i]["q"][0])),
                (expected, lambda i, e=expected: (*np.round(e[i].lengths, 6), e[i].configuration[0])),
            )
        ]
        for i, j in zip(*order, strict=True):
            answer, solution = answers[i], expected[j]
            assert_close(answer["lengths"], solution.lengths, 10)
            turned = np.array(answer["q"]) - np.array(solution.configuration)
            assert_close(np.sin(turned / 2), (0.0, 0.0))
            assert_close(answer["thrusts"], solution.thrusts, arm.largest_force / worst(solution))
            assert answer["usable"] == solution.is_stable
            assert_close(answer["tip"], one["target"], 10)
            compared += 1
    assert compared > 500


@pytest.mark.parametrize("count", [60, pytest.param(1000, marks=pytest.mark.full)])
def test_spatial_prism(in_browser, count):
    inputs = random_inputs("spatial-prism")[:count]
    prism, compared = SpatialPrism(), 0
    for one, answers in zip(inputs, solutions_in_browser(in_browser, "spatial-prism", inputs), strict=True):
        position, force = (*one["target"], one["extra"]["z"]), one["load"]
        expected = prism.loaded_inverse_kinematics(position, force)
        if (
            expected.fraction < 1
            or not expected.is_stable
            or prism.stability_margin(expected.configuration, None, force) < 0.05
        ):
            continue
        (answer,) = answers
        assert_close(answer["q"], expected.configuration)
        assert_close(answer["lengths"], expected.lengths)
        assert_close(answer["forces"], expected.forces, 100)
        assert_close(answer["tensions"], expected.tensions, 100)
        assert_close(answer["determinant"], prism.strut_determinant(position))
        assert_close(answer["stability"], prism.stability_margin(expected.configuration, None, force))
        assert_close(answer["wrench"], prism.wrench_margin(expected.configuration, None, force))
        compared += 1
    assert compared > count / 2


@pytest.mark.parametrize("name", PLAYGROUNDS)
def test_pages_load_nothing(name, tmp_path):
    text = write_playground(PLAYGROUNDS[name], tmp_path / "page.html").read_text()
    assert not re.search(r"\b(fetch|XMLHttpRequest|import)\s*\(|@import|url\((?!#)|\bsrc=|<link", text)
    assert set(re.findall(r"https?://[^\s\"'<]+", text)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"__[A-Z]+__", text)


@pytest.mark.parametrize("size", [(1300, 1000), (500, 900)], ids=["wide", "narrow"])
@pytest.mark.parametrize("name", PLAYGROUNDS)
def test_pages_are_worked_by_pointer_and_keyboard(in_browser, name, size, tmp_path):
    html = write_playground(PLAYGROUNDS[name], tmp_path / "page.html").read_text()
    script = """
      const count = rule => document.querySelectorAll(rule).length;
      const seen = [], note = () => seen.push({target: [...inputs.target], arms: count("#main .arm"),
        rows: count("tbody tr"), text: element("count").textContent});
      note();
      const svg = plots.main.svg, box = svg.getBoundingClientRect(), [u, v] = plots.main.at(inputs.target);
      const fire = (kind, dx) => svg.dispatchEvent(new PointerEvent(kind,
        {pointerId: 1, buttons: 1, bubbles: true, clientX: box.left + u + dx, clientY: box.top + v}));
      svg.setPointerCapture = () => {};
      fire("pointerdown", 0); fire("pointermove", 5); note();
      element("tip").focus();
      element("tip").dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowUp", bubbles: true})); note();
      element("tip").dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowUp", bubbles: true})); note();
      const slider = element("slider-1"); slider.value = slider.max; slider.dispatchEvent(new Event("input")); note();
      const texts = [...document.querySelectorAll("svg text")].map(t => t.getBoundingClientRect());
      const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
      const overlaps = texts.filter((a, i) => texts.some((b, j) => j > i && meet(a, b)));
      return {seen, overlaps: overlaps.length, wide: document.documentElement.scrollWidth - innerWidth,
        labels: [...document.querySelectorAll("svg text:not(.tick)")].map(t => t.textContent)};
    """
    found = in_browser(html, script, size)
    page = PLAYGROUNDS[name]
    start, moved, up, higher, loaded = found["seen"]
    assert start["target"] == pytest.approx(page.start)
    assert start["rows"] == len(page.quantities)
    assert start["arms"] % len(page.members) == 0
    assert start["arms"]
    assert moved["target"][0] > start["target"][0]
    assert moved["target"][1] == pytest.approx(start["target"][1])
    step = (page.main.bounds[2] - page.main.bounds[0]) / 100
    assert up["target"][1] == pytest.approx(moved["target"][1] + step)
    assert higher["target"][1] == pytest.approx(up["target"][1] + step)
    assert loaded["text"]
    assert found["overlaps"] == 0
    assert found["wide"] <= 0
    assert found["labels"] == [*page.main.axes, *page.second.axes]


def test_the_command_writes_pages_and_knows_the_mechanisms(tmp_path):
    app = typer.Typer()
    app.command()(import_module("tensegrity_agents.command.playground").main)
    done = CliRunner().invoke(app, ["two-x", "--out", str(tmp_path)])
    assert done.exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["two-x.html"]
    done = CliRunner().invoke(app, ["three-x", "--out", str(tmp_path)])
    assert done.exit_code != 0
    assert "spatial-prism" in done.output
    assert "Traceback" not in done.output
