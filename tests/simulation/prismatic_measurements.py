"""What docs/mujoco.md reports of prismatic actuators: python tests/simulation/prismatic_measurements.py WHAT."""

import argparse
import math
import time
from dataclasses import replace

import numpy as np
from scipy.linalg import eigh

from tensegrity_envs.environments.planar_four_bar.reach import DYNAMICS as FOUR_BAR_DYNAMICS
from tensegrity_envs.environments.spatial_prism.track import DYNAMICS as PRISM_DYNAMICS
from tensegrity_envs.mechanics import PlanarFourBar, SpatialPrism
from tensegrity_envs.simulation.floating_lengths import FloatingFourBar
from tensegrity_envs.simulation.mujoco import MujocoModel

FOUR_BAR, PRISM = PlanarFourBar(), SpatialPrism()
DYNAMICS = {"planar 4-bar": FOUR_BAR_DYNAMICS, "spatial prism": PRISM_DYNAMICS}


def model_of(name, **fields):
    """The model with the environment's parameters, but for these."""
    return MujocoModel(FOUR_BAR if "bar" in name else PRISM, replace(DYNAMICS[name], **fields))


def feasible(name, count, seed, loaded):
    """Random lengths and loads, and coordinates of the simulation in their stable equilibria: (lengths, load, u)."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        if name == "planar 4-bar":
            lengths = tuple(rng.uniform(0.2, 19.8, 2))
            load = tuple(rng.normal(0.0, 30.0 * loaded, 2))
            square, rest = FOUR_BAR.flatness(lengths)
            if 2 * min(square, rest) < 0.1:
                continue
            start, _ = FOUR_BAR.rectangle(lengths, rng.choice([-1.0, 1.0]))
            rest = FOUR_BAR.equilibrium(lengths, start, load)
            if rest.is_stable and FOUR_BAR.stability_margin(rest.configuration, lengths, load) > 0.1:
                u = FloatingFourBar(FOUR_BAR).coordinates(rest.configuration, lengths)
                found.append((lengths, load, np.array(u, float)))
        else:
            lengths = PRISM.unloaded_lengths((*rng.uniform(-0.2, 0.2, 2), rng.uniform(0.25, 0.7)))
            load = tuple(rng.normal(0.0, 8.0 * loaded, 3))
            rest = PRISM.loaded_equilibrium(lengths, load)
            if rest.fraction == 1 and rest.is_stable:
                found.append((lengths, load, np.array(rest.configuration, float)))
    return found


def relax(name, count, loaded=True):
    """Distances [m] between the settled tip and that of the analytic equilibrium, from a start beside it."""
    model = model_of(name)
    rng = np.random.default_rng(1)
    errors = []
    for lengths, load, u in feasible(name, count, 0, loaded):
        aside = 0.02 * rng.normal(size=u.shape) * ([0, 0, 1, 1] if name == "planar 4-bar" else [0, 0, 0, 1, 1, 1])
        settled = model.relax(lengths, u + aside, load)
        assert settled.reason == "at rest", settled
        tips = model.tip(model.state(np.stack([settled.configuration, u])))
        errors.append(np.linalg.norm(tips[0] - tips[1]))
    return np.array(errors)


def member_energy(model, u, inputs, load):
    """Energy of springs and servos (None: locked) from nodes and members, minus the work of the load [J]."""
    nodes = {name: np.array(place) for name, place in model.floating_model.nodes(tuple(u)).items()}
    energy, servos = -np.dot(load, nodes["P"]), None if inputs is None else iter(inputs)
    for member in model.floating_model.members:
        length = np.linalg.norm(nodes[member.nodes[1]] - nodes[member.nodes[0]])
        if member.kind == "spring":
            energy += member.stiffness / 2 * length**2
        elif member.kind == "actuator" and servos is not None:
            energy += model.dynamics.servo_stiffness / 2 * (length - next(servos)) ** 2
    return energy


def energies(name, count):
    """Largest differences of potential energy and gradient from those of nodes and members, as shares of the largest.

    With soft servos, so that differences of the energy are exact enough.
    """
    model = model_of(name, servo_stiffness=300.0)
    rng = np.random.default_rng(2)
    worst, scale, h = np.zeros(2), np.zeros(2), 1e-5
    for _ in range(count):
        if name == "planar 4-bar":
            u, inputs, load = rng.uniform(-3, 3, 4), rng.uniform(1, 19, 2), rng.normal(0.0, 50.0, 2)
        else:
            u = np.concatenate([rng.uniform([-0.3, -0.3, 0.2], [0.3, 0.3, 0.8]), rng.uniform(-1.2, 1.2, 3)])
            inputs, load = rng.uniform(0.5, 1.2, 3), rng.normal(0.0, 8.0, 3)
        expected = member_energy(model, u, inputs, load)
        steps = h * np.eye(len(u))
        slope = np.array(
            [
                (member_energy(model, u + e, inputs, load) - member_energy(model, u - e, inputs, load)) / (2 * h)
                for e in steps
            ]
        )
        off = model.potential_energy(u, inputs, load) - expected, model.energy_gradient(u, inputs, load) - slope
        worst = np.maximum(worst, [abs(off[0]), abs(off[1]).max()])
        scale = np.maximum(scale, [abs(expected), abs(slope).max()])
    return worst / scale


def locked(name, lengths, u):
    """What small motion with locked actuators is, without MuJoCo: coordinates of the simulation at an orientation
    (prism) or at (theta, gamma) (4-bar), Hessian by differences of the energy of nodes, and mass matrix.
    """
    model = model_of(name)
    if name == "planar 4-bar":
        rest = np.array(model.floating_model.configuration(tuple(u)))

        def place(w):
            return np.array(model.floating_model.coordinates(tuple(w), lengths))

        m, l = model.dynamics.bar_line_density * FOUR_BAR.length, FOUR_BAR.length
        bar = m * l * l / 3 + m * (0.008 * 2 * l) ** 2 / 4  # solid cylinders turning about one end
        mass = np.diag([bar, bar + model.dynamics.tip_mass * l * l])
    else:
        rest = u[3:]

        def place(w):
            return np.array([*PRISM.locked_pose(tuple(w), lengths).position, *w])

        # The centroid follows the orientation; inertia of a uniform triangle by integration over its area.
        h, d, m = 1e-5, PRISM.design.d, model.dynamics.platform_mass
        follow = np.array([(place(rest + h * e) - place(rest - h * e))[:3] / (2 * h) for e in np.eye(3)]).T
        mass = m * follow.T @ follow + np.diag([m * d * d / 8, m * d * d / 8, m * d * d / 4])
    h = 1e-3 if name == "planar 4-bar" else 1e-4
    n = len(rest)

    def energy(w):
        return member_energy(model, place(w), None, np.zeros(model.linkage.space))

    hessian = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            a, b = h * np.eye(n)[i], h * np.eye(n)[j]
            hessian[i, j] = (
                energy(rest + a + b) - energy(rest + a - b) - energy(rest - a + b) + energy(rest - a - b)
            ) / (4 * h * h)
    return rest, place, hessian, mass


def frequencies(name, lengths, u, periods=5):
    """Frequencies [Hz] of small oscillations with locked actuators: from Hessian and mass matrix, and simulated."""
    step = 0.0005
    model = model_of(name, joint_damping=0.0, timestep=step, servo_time=step)
    rest, place, hessian, mass = locked(name, lengths, u)
    squares, modes = eigh(hessian, mass)
    simulated = []
    for square, mode in zip(squares, modes.T, strict=True):
        states = model.state(place(rest + 3e-3 / abs(mode).max() * mode), inputs=lengths)[None]
        way = []
        for _ in range(round((periods + 1) * 2 * math.pi / square**0.5 / (2 * step))):
            states = model.rollout(states, lengths, steps=2).states
            here = model.configuration(states)[0]
            w = np.array(model.floating_model.configuration(tuple(here))) if name == "planar 4-bar" else here[3:]
            way.append(mode @ mass @ (w - rest))
        x = np.array(way)
        up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
        crossing = up - x[up] / (x[up + 1] - x[up])
        simulated.append((len(up) - 1) / (2 * step * (crossing[-1] - crossing[0])))
    return np.sqrt(squares) / (2 * math.pi), np.array(simulated)


def drift(name, integrator, seconds):
    """Kinetic energy and that of the springs, without damping, actuators locked: the share left after so many seconds.

    What servos store, by deviations of nanometres, is left out: they lose it at once.
    """
    servo_time = 0.0 if integrator == "discrete" else DYNAMICS[name].servo_time
    model = model_of(name, joint_damping=0.0, integrator=integrator, servo_time=servo_time)
    lengths, _, u = feasible(name, 1, 5, False)[0]
    rest, place, _, _ = locked(name, lengths, u)
    states = model.state(place(rest + (0.2 if name == "planar 4-bar" else 0.03)), inputs=lengths)[None]

    def of(state):
        at, none = model.configuration(state), np.zeros(model.linkage.space)
        servos = member_energy(model, at, lengths, none) - member_energy(model, at, None, none)
        return model.energy(state, lengths) - servos

    least = of(model.state(model.relax(lengths, u).configuration, inputs=lengths))
    states = model.rollout(states, lengths, steps=20).states  # servos have come to rest
    energy = [of(states[0])]
    for _ in range(round(seconds / model.dynamics.timestep)):
        states = model.rollout(states, lengths, steps=1).states
        energy.append(of(states[0]))
    share = (np.array(energy) - least) / (energy[0] - least)
    late = share[-round(1.0 / model.dynamics.timestep) :]  # it swings to and fro with the motion
    return late.mean(), late.min(), late.max()


def speed(name):
    """Time steps per second: single, and in a rollout of 512."""
    model = model_of(name)
    lengths, _, u = feasible(name, 1, 0, False)[0]
    states = model.state(np.tile(u, (512, 1)), inputs=lengths)
    skip, rates = model.dynamics.frame_skip, []
    for count, run in ((200, lambda: model.advance(states[0], lengths, np.zeros(model.linkage.space))), (2, None)):
        best = 0.0
        for _ in range(5):
            start = time.perf_counter()
            for _ in range(count):
                run() if run else model.rollout(states, lengths)
            best = max(best, count * skip * (1 if run else 512) / (time.perf_counter() - start))
        rates.append(best)
    return rates


def main():
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("relax", "energies", "frequencies", "drift", "speed"))
    parser.add_argument("--count", type=int, default=200)
    arguments = parser.parse_args()
    for name in DYNAMICS:
        if arguments.what == "relax":
            for loaded in (False, True):
                errors = relax(name, arguments.count, loaded)
                print(
                    f"{name}, {'loads' if loaded else 'no load'}: median {np.median(errors):.1e}, "
                    f"max {errors.max():.1e} m"
                )
        elif arguments.what == "energies":
            print(name, "energy {:.1e}, gradient {:.1e} of the largest".format(*energies(name, arguments.count)))
        elif arguments.what == "frequencies":
            at = [(lengths, u) for lengths, _, u in feasible(name, 3, 3, False)]
            if name == "spatial prism":
                rest = (0.0, 0.0, 0.4, 0.0, 0.0, 0.0)
                at.insert(0, (PRISM.unloaded_lengths(rest[:3]), np.array(rest)))
            for lengths, u in at:
                expected, simulated = frequencies(name, lengths, u)
                print(name, expected.round(3), simulated.round(3), f"off by {abs(simulated / expected - 1).max():.1e}")
        elif arguments.what == "drift":
            for integrator in ("implicitfast", "discrete"):
                print(
                    name,
                    integrator,
                    "energy left after 5 s: mean {:.3f}, {:.3f} to {:.3f}".format(*drift(name, integrator, 5.0)),
                )
        else:
            print(name, "step {:,.0f}/s, rollout of 512 {:,.0f}/s".format(*speed(name)))


if __name__ == "__main__":
    main()
