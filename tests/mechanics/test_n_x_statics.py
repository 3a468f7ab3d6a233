"""The n-X: equal to the 2-X for n = 2, its derivatives and torque matrix by autograd of nodes and members, designs."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
from mechanism_cases import random_n_x_design, random_two_x_design
from n_x_checks import derivative_errors, draw, random_arm

from tensegrity_envs.compiler import kernel, store
from tensegrity_envs.compiler.kernel import evaluate
from tensegrity_envs.mechanics import (
    MURALIDHARAN2022,
    NX,
    DualTriangle,
    NXDesign,
    PlanarFourBar,
    SpatialPrism,
    TwoX,
)

THREE = NXDesign.from_two_x(MURALIDHARAN2022, 3)


def shared_quantities(m, q, tensions, load):
    """Everything that both arms have, by name."""
    u = m.to_sines(q)
    nodes = m.nodes(q)
    return {
        "reach": m.reach,
        "scale": m.stiffness_scale,
        "tip": m.tip(q),
        "jacobian": m.jacobian(q),
        "singularity": m.jacobian_determinant(q),
        "nodes": [nodes[name] for name in sorted(nodes)],
        "lengths": m.cable_lengths(q),
        "energy": m.potential_energy(q, tensions, load),
        "energy without load": m.potential_energy(q, tensions),
        "gradient": m.energy_gradient(q, tensions, load),
        "gradient without load": m.energy_gradient(q, tensions),
        "hessian": m.stiffness_matrix(q, tensions, load),
        "sines": (u, m.from_sines(u)),
        "sine gradient": m.sine_statics(u, tensions, load)[0],
        "sine hessian": m.sine_statics(u, tensions, load)[1],
        "stiffest": m.stiffest_tensions(q, load),
        "posture": (m.posture(q)[1], m.posture(q)[2]),
        "posture and tip": (*m.posture_and_tip(q)[0], *m.posture_and_tip(q)[3]),
        "wrench": (m.wrench_margin(q), m.wrench_margin(q, tensions, load), m.wrench_margin(q, load=load)),
        "stability": (m.stability_margin(q), m.stability_margin(q, tensions, load), m.stability_margin(q, load=load)),
        "limits": m.is_within_limits(q),
        "feasible": m.is_stable_wrench_feasible(q, load),
    }


@pytest.mark.parametrize("seed", range(30))
def test_two_equal_joints_are_the_two_x(seed):
    design = random_two_x_design(seed)
    two, arm = TwoX(design), NX(NXDesign.from_two_x(design))
    rng = np.random.default_rng(seed)
    limit = min(design.joint_limit, 3.1) if seed % 2 else design.joint_limit
    q = tuple(rng.uniform(-limit, limit, (2, 40)))
    tensions, load = tuple(rng.uniform(0, design.max_tension, (4, 40))), tuple(rng.normal(0, 5, (2, 40)))
    expected, found = (shared_quantities(m, q, tensions, load) for m in (two, arm))
    for name, value in expected.items():
        size = np.abs(np.asarray(value, float)).max() + 1e-300
        np.testing.assert_allclose(
            np.asarray(found[name], float) / size, np.asarray(value, float) / size, 0, 1e-12, name
        )
    assert arm.input_names == two.input_names
    for ours, theirs in zip(arm.members, two.members, strict=True):
        assert (ours.name, ours.kind, ours.nodes, ours.more_spans) == (theirs.name, theirs.kind, theirs.nodes, ())
        assert (ours.mass, ours.stiffness, ours.radius) == pytest.approx((theirs.mass, theirs.stiffness, theirs.radius))


@pytest.mark.parametrize("seed", range(5))
def test_two_equal_joints_have_the_equilibria_of_the_two_x(seed):
    design = replace(random_two_x_design(seed), joint_limit=2.6, gravity=9.81)
    rng = np.random.default_rng(seed)
    tensions = tuple(rng.uniform(0, 0.3 * design.max_tension, 4).tolist())
    two, arm = TwoX(design), NX(NXDesign.from_two_x(design))
    expected, found = two.equilibria(tensions), arm.equilibria(tensions)
    assert [e.is_stable for e in found] == [e.is_stable for e in expected]
    for ours, theirs in zip(found, expected, strict=True):
        assert ours.configuration == pytest.approx(theirs.configuration, abs=1e-9)
    settled = arm.equilibrium(tensions, (0.1, -0.1)), two.equilibrium(tensions, (0.1, -0.1))
    assert settled[0].reason == settled[1].reason
    if settled[1].is_stable:
        assert settled[0].configuration == pytest.approx(settled[1].configuration, abs=1e-9)


@pytest.mark.parametrize("joints", range(1, 7))
def test_derivatives_and_torque_matrix_by_autograd(joints):
    pytest.importorskip("torch")
    for seed in range(6):
        arm, rng = random_arm(seed, joints)
        assert max(derivative_errors(arm, *draw(arm, rng))) < 1e-9, arm.design


def test_batches_of_designs_are_what_single_designs_give():
    singles = [random_n_x_design(seed, 3, "from_base") for seed in (3, 4, 5)]
    batch = {}
    for field in dataclasses.fields(NXDesign):
        if field.name in ("joints", "routing"):
            continue
        if field.name in ("b", "l", "a", "k_left", "k_right"):
            columns = zip(*(design.each(field.name) for design in singles), strict=True)
            batch[field.name] = tuple(np.array(column) for column in columns)
        elif field.name == "joint_limit":
            batch[field.name] = 2.5
        else:
            batch[field.name] = np.array([getattr(design, field.name) for design in singles])
    arms = NX(NXDesign(3, **batch, routing="from_base"))
    q = (0.2, -0.3, 0.1)
    together = arms.posture(q)
    for k, design in enumerate(singles):
        alone = NX(replace(design, joint_limit=2.5))
        one = arms.take(k)
        assert [float(f[k]) for f in together[0]] == pytest.approx(alone.stiffest_tensions(q), rel=1e-9)
        assert float(together[1][k]) == pytest.approx(alone.stability_margin(q), rel=1e-9)
        assert one.tip(q) == pytest.approx(alone.tip(q), abs=1e-15)


def test_another_design_compiles_nothing(monkeypatch, tmp_path):
    monkeypatch.setenv("TENSEGRITY_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kernel, "_LOADED", {})
    made, fetch = [], store.fetch
    monkeypatch.setattr(
        store, "fetch", lambda key, version, make: fetch(key, version, lambda: made.append(key) or make())
    )
    q = (0.2, -0.3, 0.1)
    for routing in ("per_joint", "from_base"):
        for scale in (1.0, 1.013):
            arm = NX(
                NXDesign(3, 0.05 * scale, (0.1, 0.11 * scale, 0.12), 0.2, 600.0 * scale, 5.0, 155.0, routing=routing)
            )
            compiled = evaluate(arm.posture_and_tip, q)
            plain = arm.posture_and_tip(q)
            assert compiled[0] == pytest.approx(plain[0], rel=1e-10)
            assert compiled[1:3] == pytest.approx(plain[1:3], rel=1e-10)
            assert compiled[3] == pytest.approx(plain[3], rel=1e-12)
            assert bool(made) == (scale == 1.0)
            del made[:]


@pytest.mark.parametrize(
    ("field", "value", "kind"),
    [
        ("joints", 0, ValueError),
        ("joints", 2.0, TypeError),
        ("b", (0.05, 0.05), ValueError),
        ("b", (0.05, 0.05, 0.1), ValueError),
        ("l", (0.1, "x", 0.1), TypeError),
        ("a", -0.1, ValueError),
        ("k_left", (1.0, -1.0, 1.0), ValueError),
        ("k_right", math.nan, ValueError),
        ("max_tension", 5.0, ValueError),
        ("joint_limit", 7.0, ValueError),
        ("routing", "per joint", ValueError),
        ("routing", 3, TypeError),
        ("routing", ((1, 0), (0, 1)), ValueError),
        ("routing", ((1, 0, 2),), ValueError),
        ("routing", ((0, 0, 0),), ValueError),
        ("routing", (), ValueError),
    ],
)
def test_what_is_wrong_with_a_design_is_named(field, value, kind):
    with pytest.raises(kind, match=rf"NXDesign\.{'l' if field == 'b' and len(value) == 3 else field} = "):
        replace(THREE, **{field: value})


def test_what_is_wrong_with_a_call_is_named():
    arm = NX(THREE)
    with pytest.raises(ValueError, match="tensions: 4 numbers, must be 6"):
        arm.equilibrium((1.0,) * 4, (0.0,) * 3)
    with pytest.raises(ValueError, match="up to three joints, not for 5"):
        NX(NXDesign.from_two_x(MURALIDHARAN2022, 5)).equilibria((1.0,) * 10)
    with pytest.raises(TypeError, match="q = 'abc': must be 3"):
        arm.posture("abc")
    many = NX(NXDesign.from_two_x(MURALIDHARAN2022, 14))
    with pytest.raises(ValueError, match="14 joints with 28 cables: 37,442,160 choices of 13 cables"):
        NX(replace(many.design, routing="from_base")).wrench_margin((0.01,) * 14)
    with pytest.raises(ValueError, match="14 joints with 28 cables"):
        _ = many.torque_zonotope((0.01,) * 14).volume
    with pytest.raises(TypeError, match="must be a TwoXDesign, such as"):
        NXDesign.from_two_x(THREE)
    assert replace(THREE, joints=np.int64(3)) == THREE


@pytest.mark.parametrize("mechanism", [NX, TwoX, DualTriangle, PlanarFourBar, SpatialPrism])
def test_a_design_of_another_mechanism_is_refused(mechanism):
    for design in (3, None, THREE if mechanism is not NX else MURALIDHARAN2022):
        with pytest.raises(TypeError, match=r"design = .*: must be a \w+Design, such as tensegrity_envs.mechanics.\w+"):
            mechanism(design)


@pytest.mark.parametrize(("joints", "routing"), [(4, "per_joint"), (6, "per_joint"), (4, "from_base")])
def test_compiled_postures_of_many_joints_are_the_plain_ones(joints, routing):
    """Smallest eigenvalues by rotations, which compiled code does, against LAPACK's."""
    arm = NX(replace(random_n_x_design(2, joints, routing), joint_limit=2.6))
    q = tuple(np.random.default_rng(0).uniform(-2, 2, (joints, 200)))
    for compiled, plain in zip(evaluate(arm.posture, q)[1:], arm.posture(q)[1:], strict=True):
        np.testing.assert_allclose(compiled, plain, rtol=1e-10, atol=1e-12 * np.abs(plain).max())
