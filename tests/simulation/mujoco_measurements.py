"""What docs/mujoco.md reports, measured: python tests/simulation/mujoco_measurements.py WHAT [--count N]."""

import argparse
import resource
import time
from collections import Counter
from dataclasses import replace

import gymnasium
import mujoco
import numpy as np
from scipy.linalg import eigh

import tensegrity_envs
from tensegrity_envs import termination_reason
from tensegrity_envs.mechanics import MURALIDHARAN2022, ZHAO2021_CAPTION, ZHAO2021_TEXT, DualTriangle, TwoX
from tensegrity_envs.simulation.mujoco import Dynamics, MujocoModel
from tensegrity_envs.vector_env import step_info

MECHANISMS = {
    "two-x": TwoX(replace(MURALIDHARAN2022, joint_limit=2.6)),
    "two-x with payload": TwoX(replace(MURALIDHARAN2022, joint_limit=2.6, payload=0.3)),
    "dual-triangle": DualTriangle(ZHAO2021_CAPTION),
    "dual-triangle, cables": DualTriangle(replace(ZHAO2021_TEXT, springs="cable")),
}


def input_range(mechanism):
    """Lowest and highest inputs to draw from, as in the analytic environments."""
    if isinstance(mechanism, TwoX):
        return np.full(4, mechanism.design.min_tension), np.full(4, mechanism.design.max_tension)
    return np.zeros(2 * mechanism.segments), np.full(2 * mechanism.segments, 1.5 * mechanism.design.free_length1)


def feasible(mechanism, count, seed):
    """Random inputs, loads and the stable equilibria under them, away from the joint limits and from buckling."""
    rng = np.random.default_rng(seed)
    n, (low, high) = mechanism.degrees_of_freedom, input_range(mechanism)
    found = []
    while len(found) < count:
        u = tuple(rng.uniform(low, high))
        load = tuple(rng.normal(0.0, 0.3, 2)) if n == 3 else tuple(rng.normal(0.0, 1.0, 2))
        e = mechanism.equilibrium(u, (0.0,) * n, load)
        near_limit = max(map(abs, e.configuration)) > mechanism.design.joint_limit - 0.15
        if e.is_stable and not near_limit and mechanism.stability_margin(e.configuration, u, load) > 0.02:
            found.append((u, load, np.array(e.configuration)))
    return found


def relax(name, count):
    """Errors [rad] and loop errors [m] of settled equilibria, from 0.1 rad beside."""
    model = MujocoModel(MECHANISMS[name])
    rng = np.random.default_rng(1)
    errors, loops = [], []
    for u, load, q in feasible(model.mechanism, count, 0):
        settled = model.relax(u, q + rng.uniform(-0.1, 0.1, len(q)), load)
        assert settled.reason == "at rest", settled
        errors.append(abs(settled.configuration - q).max())
        loops.append(settled.loop_error)
    return np.array(errors), np.array(loops)


def energies(name, count):
    """Largest differences of potential energy [J] and its gradient [N m/rad] from the analytic ones."""
    model = MujocoModel(MECHANISMS[name])
    rng = np.random.default_rng(2)
    low, high = input_range(model.mechanism)
    limit = 0.95 * model.linkage.limit
    differences = []
    for _ in range(count):
        q, u = rng.uniform(-limit, limit, model.linkage.size), rng.uniform(low, high)
        load = tuple(rng.normal(0.0, 5.0, 2))
        of_energy = model.potential_energy(q, u, load) - model.mechanism.potential_energy(tuple(q), tuple(u), load)
        of_gradient = model.energy_gradient(q, u, load) - model.mechanism.energy_gradient(tuple(q), tuple(u), load)
        differences.append((abs(of_energy), abs(of_gradient).max()))
    return np.max(differences, axis=0)


def swing(model):
    """A configuration far from the equilibrium of the inputs that come with it."""
    return ([0.5, -0.3], [130.0, 130.0, 90.0, 90.0]) if model.linkage.size == 2 else ([0.5, -0.3, 0.2], [0.03] * 6)


def drift(name, integrator, seconds):
    """Largest change of the energy without damping [J], and the energy above the equilibrium's [J]."""
    model = MujocoModel(MECHANISMS[name], Dynamics(joint_damping=0.0, integrator=integrator))
    q, u = swing(model)
    states = model.state(q)[None]
    start, largest = model.energy(states[0], u), 0.0
    for _ in range(round(seconds / 0.02)):
        states = model.rollout(states, u, steps=20).states
        largest = max(largest, abs(model.energy(states[0], u) - start))
    rest = model.mechanism.equilibrium(tuple(u), tuple(q)).configuration
    return largest, start - model.mechanism.potential_energy(rest, tuple(u))


def frequencies(name, periods=4):
    """Frequencies [Hz] of small oscillations, from Hessian and mass matrix and as simulated."""
    model = MujocoModel(MECHANISMS[name], Dynamics(joint_damping=0.0, integrator="RK4"))
    u, load, start = feasible(model.mechanism, 1, 3)[0]
    q = model.relax(u, start, load).configuration
    mass = model.mass_matrix(q)
    squares, modes = eigh(np.array(model.mechanism.stiffness_matrix(tuple(q), u, load)), mass)
    simulated = []
    for square, mode in zip(squares, modes.T, strict=True):
        states = model.state(q + 2e-3 / abs(mode).max() * mode)[None]
        way = []
        for _ in range(round((periods + 1) * 2 * np.pi / square**0.5 / 0.001)):
            states = model.rollout(states, u, load, steps=1).states
            way.append(mode @ mass @ (model.configuration(states)[0] - q))
        x = np.array(way)
        up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
        crossing = up - x[up] / (x[up + 1] - x[up])
        simulated.append((len(up) - 1) / (0.001 * (crossing[-1] - crossing[0])))
    return np.sqrt(squares) / (2 * np.pi), np.array(simulated)


def stress(name, steps, batch=50, seed=0):
    """Random bang-bang inputs, each held for one step of 20 ms; the worst of what must not happen.

    Returns:
        Numbers of divergences and of states that are not finite, the largest assembly error [-], loop error [m],
        |q| [rad] and speed [rad/s].
    """
    model = MujocoModel(MECHANISMS[name])
    rng = np.random.default_rng(seed)
    low, high = input_range(model.mechanism)
    states = model.state(np.zeros((batch, model.linkage.size)))
    diverged, bad, worst = 0, 0, np.zeros(4)
    for _ in range(max(1, steps // batch)):
        result = model.rollout(states, np.where(rng.uniform(size=(batch, model.input_size)) < 0.5, low, high))
        states = result.states
        diverged += int(result.diverged.sum())
        bad += int((~np.isfinite(states)).any(axis=1).sum())
        seen = (
            model.assembly_error(states),
            model.loop_error(states),
            abs(model.configuration(states)),
            abs(model.velocity(states)),
        )
        worst = np.maximum(worst, [value.max() for value in seen])
    return diverged, bad, *worst


# What the stress run of environments lets differ, so that each episode has a model of its own.
RANDOMIZED = {"stiffness": (0.8, 1.2), "mass": (0.8, 1.25), "damping": (0.5, 2.0)}


def resident():
    """MB of memory that this process has at the moment (Linux)."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 2**20


def stress_environment(env_id, steps, count=500, seed=0):
    """Random bang-bang actions in an environment, each held for 1 to 10 steps; how its episodes ended.

    Returns:
        Numbers of episodes by why they were terminated ("" at the time limit), numbers of observations or rewards that
        are not finite, largest assembly error [-] of states without failure, memory after a tenth of the steps and at
        its peak afterwards [MB].
    """
    envs = gymnasium.make_vec(
        env_id,
        count,
        vectorization_mode="vector_entry_point",
        autoreset_mode="SameStep",
        randomization=RANDOMIZED,
    )
    core = envs.unwrapped.core
    physics = list(core.states.rows.physics)
    rng = np.random.default_rng(seed)
    envs.reset(seed=seed)
    ends, bad, worst, early, peak = Counter(), 0, 0.0, 0.0, 0.0
    rounds = max(1, steps // count)
    actions = rng.choice([-1.0, 1.0], envs.action_space.shape)
    for number in range(rounds):
        if number == rounds // 10:
            early = resident()
        elif number > rounds // 10 and number % 50 == 0:
            peak = max(peak, resident())
        new = rng.random(count) < 1 / 5
        actions[new] = rng.choice([-1.0, 1.0], (int(new.sum()), actions.shape[1]))
        observation, reward, terminated, truncated, info = envs.step(actions)
        bad += sum(int((~np.isfinite(part)).any(axis=1).sum()) for part in observation.values())
        bad += int((~np.isfinite(reward)).sum())
        last = step_info(info)
        ends.update(str(reason) for reason in termination_reason(last["failure"])[terminated | truncated])
        worst = max(worst, float(core.engine.model.assembly_error(envs.unwrapped._outcomes[physics].T).max()))
    envs.close()
    return ends, bad, worst, early, max(peak, resident())


def best_rate(function, count, repeats=7):
    """Largest number of `count` per second over some repeats."""
    best = 0.0
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        best = max(best, count / (time.perf_counter() - start))
    return best


def speed():
    """Time steps per second on one thread, side by side with Reacher-v5 at 20 time steps for one step."""
    reacher = gymnasium.make("Reacher-v5", frame_skip=20).unwrapped
    reacher.reset(seed=0)
    action = reacher.action_space.sample()
    physics = best_rate(lambda: [mujoco.mj_step(reacher.model, reacher.data, nstep=20) for _ in range(50)], 1000)
    whole = best_rate(lambda: [reacher.step(action) for _ in range(50)], 1000)
    print(f"Reacher-v5: mj_step {physics:,.0f}/s, in env.step {whole:,.0f}/s")
    for name, mechanism in MECHANISMS.items():
        model = MujocoModel(mechanism)
        u = np.mean(input_range(mechanism), axis=0)
        size = model.linkage.size
        single = best_rate(lambda model=model, u=u: [model.step(u) for _ in range(50)], 1000)
        print(f"{name}: step {single:,.0f}/s ({single / physics:.2f} of Reacher's mj_step)", end="")
        for m, threads in ((1, 1), (512, 1), (512, 2)):
            states = model.state(np.random.default_rng(0).uniform(-0.5, 0.5, (m, size)))
            rate = best_rate(lambda s=states, u=u, t=threads, model=model: model.rollout(s, u, nthread=t), 20 * m, 5)
            print(f", rollout of {m} with {threads} threads {rate:,.0f}/s", end="")
        start = time.perf_counter()
        MujocoModel(mechanism)
        print(f"; built in {1000 * (time.perf_counter() - start):.0f} ms")
        model.close()


def main():
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    what = ("relax", "energies", "drift", "frequencies", "stress", "environments", "speed")
    parser.add_argument("what", choices=what)
    parser.add_argument("--id", help="of the one environment to run, such as SpatialPrismTrackMuJoCo-v0")
    parser.add_argument("--count", type=int, default=200, help="samples, or steps of the stress run")
    arguments = parser.parse_args()
    if arguments.what == "speed":
        speed()
        return
    if arguments.what == "environments":
        for env_id in [name for name in tensegrity_envs.ENV_IDS if "MuJoCo" in name and (arguments.id or "") in name]:
            start = time.perf_counter()
            ends, bad, assembly, early, peak = stress_environment(env_id, arguments.count)
            text = ", ".join(f"{count} {reason or 'time limit'}" for reason, count in ends.most_common())
            print(
                f"{env_id}: {arguments.count} steps, {bad} not finite, assembly error {assembly:.1e}; episodes: {text}"
                f"; {early:.0f} MB after a tenth, then at most {peak:.0f} MB "
                f"({time.perf_counter() - start:.0f} s)",
                flush=True,
            )
        return
    for name in MECHANISMS:
        start = time.perf_counter()
        if arguments.what == "relax":
            errors, loops = relax(name, arguments.count)
            text = f"median {np.median(errors):.1e}, max {errors.max():.1e} rad; loops {loops.max():.1e} m"
        elif arguments.what == "energies":
            energy, gradient = energies(name, arguments.count)
            text = f"energy {energy:.1e} J, gradient {gradient:.1e} N m/rad"
        elif arguments.what == "drift":
            parts = [(integrator, *drift(name, integrator, 5.0)) for integrator in ("RK4", "implicitfast")]
            text = "; ".join(f"{integrator} {change:.1e} of {above:.2f} J" for integrator, change, above in parts)
        elif arguments.what == "frequencies":
            expected, simulated = frequencies(name)
            off = abs(simulated / expected - 1).max()
            text = f"{expected.round(4)} Hz, simulated {simulated.round(4)}, off by {off:.1e}"
        else:
            diverged, bad, assembly, loop, angle, rate = stress(name, arguments.count)
            text = (
                f"{diverged} divergences, {bad} not finite, assembly error {assembly:.1e}, loops {loop:.1e} m, "
                f"|q| {angle:.3f} rad, speed {rate:.0f} rad/s"
            )
        print(f"{name}: {text} ({time.perf_counter() - start:.1f} s)", flush=True)


if __name__ == "__main__":
    main()
