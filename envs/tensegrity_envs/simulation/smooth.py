"""The dynamics of planar arms as equations that can be differentiated, for training through their gradient.

What MuJoCo simulates with hinges, constraints and actuators is here Lagrange's equation in the configuration q itself,

    (M + h D) (v' - v) / h = -dV/dq + J^T f - b(q, v) - D v - friction,    q' = q + h v',

a step h of the same semi-implicit integrator. V is the energy of `InputControl.statics`; M, D and the bias b follow
from the positions of the nodes alone: bars are uniform rods, the tip is a point. Loops are closed exactly. Dry friction
is smoothed, r w / sqrt(w^2 + w_s^2) for a hinge that turns at w, and implicit, too; simulations never fail: two
differences from the engine, and why agents are evaluated there. Actuators approach their command exponentially.

Arrays are those of JAX, which compiles and differentiates; only this module imports it.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.equilibrium import solve_symmetric
from tensegrity_envs.simulation.dynamic import DynamicControl, Motion, check_smooth
from tensegrity_envs.simulation.mujoco.linkage import usual_radius
from tensegrity_envs.simulation.protocol import Episode, State

Nodes = dict[str, Any]
_SLIP = 0.05  # [rad/s], at which dry friction has 0.7 of its value


class SmoothDynamics:
    """The step of a dynamic environment as a function of JAX's arrays.

    Args:
        core: of a dynamic environment of a planar arm without prismatic actuators.
        substeps: time steps in a step of the environment; by default those of the engine.

    Raises:
        ValueError: the environment has no such dynamics.
    """

    def __init__(self, core: Any, substeps: int | None = None) -> None:
        check_smooth(core)
        engine, dynamics = core.engine, core.dynamics
        assert engine is not None
        assert dynamics is not None
        assert isinstance(core.simulation, DynamicControl)
        linkage: Any = engine.model.linkage
        self.core, self.dynamics = core, dynamics
        self.control: Any = core.simulation.control
        self.substeps = substeps or dynamics.frame_skip
        self.timestep = dynamics.step_time / self.substeps
        self._bodies = [_Rigid.of(body, linkage, dynamics, core.nominal) for body in linkage.bodies[1:]]
        parents = [linkage.bodies[body.parent].frame if body.parent else None for body in linkage.bodies[1:]]
        self._hinges = [(body.frame, parent) for body, parent in zip(linkage.bodies[1:], parents, strict=True)]

    def step(self, episode: Episode, state: State, action: Components) -> tuple[Any, Component]:
        """The outcome one step later; its state's `physics` are the inputs that the actuators have reached.

        Returns:
            The outcome, nothing of which is differentiated by way of the margins; and the stability margin: an arm in
            motion may pass where it could not rest.
        """
        core = self.core
        assert isinstance(core.simulation, DynamicControl)
        command = core.command(episode, state, action)
        motion = self.move(episode, state, command.state.inputs, command.load)
        after = core.simulation.finish_step(core.mechanism(episode.design), episode, command.state, motion)
        # Eigenvalues are dear to differentiate, and what the margins tell is hardly what an action is for.
        margins = (jax.lax.stop_gradient(margin) for margin in (after.stability_margin, after.wrench_margin))
        after = after._replace(**dict(zip(("stability_margin", "wrench_margin"), margins, strict=True)))
        return core.outcome(episode, core.with_clearance(episode, command.state, after)), after.stability_margin

    def move(self, episode: Episode, state: State, inputs: Components, load: Components) -> Motion:
        """What the engine would find at the end of a step under these inputs."""
        mechanism = self.core.mechanism(episode.design)
        random = episode.random
        factor = {name: random.get(name, 1.0) for name in ("mass", "damping", "friction", "bandwidth")}
        h, d = self.timestep, len(state.configuration)
        tip_mass = self._tip_mass(mechanism, factor["mass"])
        damping = self.dynamics.joint_damping * factor["damping"]
        friction = self.dynamics.joint_friction * factor["friction"]
        constant = self.dynamics.time_constant
        left = jnp.exp(-h * factor["bandwidth"] / constant) if constant else 0.0

        def substep(carry: Any, _: None) -> Any:
            q, v, reached = carry
            nodes, columns, swing = self._moving(mechanism, q, v)
            mass, bias = self._inertia(nodes, columns, swing, factor["mass"], tip_mass)
            turns = self._turns(nodes, columns)
            rates = [sum(t * rate for t, rate in zip(turn, v, strict=True)) for turn in turns]
            u, pull_back = jax.vjp(lambda *at: tuple(self.control.to_coordinates(mechanism, at)), *q)
            gradient = pull_back(tuple(self.control.statics(mechanism, u, reached, load)[0]))
            drag = [damping + friction / jnp.sqrt(rate * rate + _SLIP * _SLIP) for rate in rates]
            force = [
                -g - b - sum(t[i] * c * rate for t, c, rate in zip(turns, drag, rates, strict=True))
                for i, (g, b) in enumerate(zip(gradient, bias, strict=True))
            ]
            matrix = [
                [mass[i][j] + h * sum(t[i] * t[j] * c for t, c in zip(turns, drag, strict=True)) for j in range(d)]
                for i in range(d)
            ]
            change, _, _ = solve_symmetric(tuple(tuple(row) for row in matrix), tuple(force))
            v = tuple(a + h * c for a, c in zip(v, change, strict=True))
            q = tuple(a + h * c for a, c in zip(q, v, strict=True))
            reached = tuple(c + (r - c) * left for c, r in zip(inputs, reached, strict=True))
            return (q, v, reached), None

        # Actuators without lag act at once; others from what they have reached.
        start = tuple(0.0 * state.time + a for a in (state.physics if constant else inputs))
        begun = (state.configuration, state.velocity, start)
        # Keeping what each time step computes takes longer than computing it again.
        (q, v, reached), _ = jax.lax.scan(jax.checkpoint(substep), begun, None, self.substeps)
        still = 0.0 * q[0]
        return Motion(q, v, reached, still, still)

    def _tip_mass(self, mechanism: Any, factor: Component) -> Component:
        payload = getattr(mechanism.design, "payload", None)
        return factor * self.dynamics.tip_mass if payload is None else payload

    def _moving(self, mechanism: Any, q: Components, v: Components) -> tuple[Nodes, list[Nodes], Nodes]:
        """Nodes, their derivatives in each angle, and their accelerations where the angles change evenly."""

        def at(*angles: Any) -> Nodes:
            return dict(mechanism.nodes(angles))

        units = [tuple(jnp.full_like(a, float(i == j)) for j, a in enumerate(q)) for i in range(len(q))]
        columns = [jax.jvp(at, q, unit)[1] for unit in units]
        swing = jax.jvp(lambda *angles: jax.jvp(at, angles, v)[1], q, v)[1]
        return at(*q), columns, swing

    def _turns(self, nodes: Nodes, columns: list[Nodes]) -> list[list[Component]]:
        """Derivatives of the hinges' angles in q."""
        turns = []
        for frame, parent in self._hinges:
            own = [_turn(nodes, column, frame) for column in columns]
            base = [_turn(nodes, column, parent) for column in columns] if parent else [0.0] * len(columns)
            turns.append([a - b for a, b in zip(own, base, strict=True)])
        return turns

    def _inertia(
        self, nodes: Nodes, columns: list[Nodes], swing: Nodes, factor: Component, tip_mass: Component
    ) -> tuple[list[list[Component]], list[Component]]:
        """Mass matrix, and the generalized forces of inertia that velocities alone make (Coriolis, centrifugal)."""
        moves: list[tuple[Component, list[Component], Component]] = []  # mass, derivatives in q, acceleration
        for body in self._bodies:
            centres = [body.centre(column) for column in columns]
            across = body.centre(swing)
            moves += [(factor * body.mass, [c[k] for c in centres], across[k]) for k in (0, 1)]
            turns = [_turn(nodes, column, body.frame) for column in columns]
            moves.append((factor * body.inertia, turns, _turn(nodes, swing, body.frame)))
        moves += [(tip_mass, [column["P"][k] for column in columns], swing["P"][k]) for k in (0, 1)]
        d = len(columns)
        mass: list[list[Component]] = [[0.0] * d for _ in range(d)]
        bias: list[Component] = [0.0] * d
        for m, rows, acceleration in moves:
            for i in range(d):
                bias[i] = bias[i] + m * rows[i] * acceleration
                for j in range(i + 1):
                    mass[i][j] = mass[i][j] + m * rows[i] * rows[j]
                    mass[j][i] = mass[i][j]
        return mass, bias


class _Rigid(NamedTuple):
    """A rigid body: its centre of mass is a + along (b - a) + across i (b - a) for its nodes a, b.

    Attributes:
        frame: a and b.
        along, across: see above [-].
        mass: [kg].
        inertia: about the centre of mass [kg m2].
    """

    frame: tuple[str, str]
    along: float
    across: float
    mass: float
    inertia: float

    @classmethod
    def of(cls, body: Any, linkage: Any, dynamics: Any, mechanism: Any) -> "_Rigid":
        """That of the bars of a body: cylinders, as in MuJoCo's model (`mujoco.building`)."""
        a, b = (linkage.reference[name] for name in body.frame)
        found: list[tuple[float, complex, float]] = []
        radius = usual_radius(mechanism.members, linkage.extent)
        for bar in body.bars:
            first, second = (linkage.reference[name] for name in bar.nodes)
            length, thickness = abs(second - first), bar.radius or radius
            mass = dynamics.bar_mass(bar, length)
            found.append((mass, (first + second) / 2, mass * (length**2 / 12 + thickness**2 / 4)))
        total = sum(mass for mass, _, _ in found)
        centre = sum(mass * place for mass, place, _ in found) / total
        inertia = sum(own + mass * abs(place - centre) ** 2 for mass, place, own in found)
        share = (centre - a) / (b - a)
        return cls(body.frame, share.real, share.imag, total, inertia)

    def centre(self, nodes: Nodes) -> tuple[Component, Component]:
        """The centre of mass, or how it moves where nodes are how these move."""
        (ax, ay), (bx, by) = (nodes[name] for name in self.frame)
        x, y = bx - ax, by - ay
        return ax + self.along * x - self.across * y, ay + self.along * y + self.across * x


def _turn(nodes: Nodes, change: Nodes, frame: tuple[str, str]) -> Component:
    """How fast a body turns where its nodes move by `change`; likewise its acceleration."""
    (ax, ay), (bx, by) = (nodes[name] for name in frame)
    (ux, uy), (vx, vy) = (change[name] for name in frame)
    x, y, dx, dy = bx - ax, by - ay, vx - ux, vy - uy
    return (x * dy - y * dx) / (x * x + y * y)
