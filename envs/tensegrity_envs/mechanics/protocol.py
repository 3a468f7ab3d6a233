"""What a mechanism is: the methods that environments, studies and laws may count on, each with one signature.

The signature is `(q, inputs, load)`. A configuration `q` holds the coordinates that move while the inputs are kept,
`inputs` are what is actuated, in the order of `input_names` (tensions [N], free lengths [m], or lengths of prismatic
actuators [m]), and `load` is a dead force at the tip in world axes [N]. Components are floats, NumPy arrays or Torch
tensors of any shapes that broadcast; results have the shape that they broadcast to.

Where a mechanism is driven by tensions or free lengths, its configuration alone places every node, and `inputs` may be
left out of `tip`, `nodes`, `jacobian` and `jacobian_determinant`. Where lengths are the inputs, `inputs` may be
required: the two angles of the 4-bar place its nodes only together with the lengths. The configuration of the spatial
prism holds position and orientation, so that its lengths follow and may be left out.

The laws of tests/mechanics/test_mechanism_laws.py check every mechanism that `tensegrity_envs.mechanics` exports.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

from tensegrity_envs.compiler.namespace import Component, Components
from tensegrity_envs.mechanics.design import Member
from tensegrity_envs.mechanics.equilibrium import Equilibrium

Vector = Sequence[Component]
Rows = Sequence[Sequence[Component]]


class Solution(Protocol):
    """A solution of the inverse kinematics; a mechanism adds labels, margins and residuals of its own."""

    @property
    def configuration(self) -> Vector:
        """Its components [rad or m]."""


class AnyEquilibrium(Solution, Protocol):
    """An equilibrium, stable or not."""

    @property
    def residual(self) -> Component:
        """Norm of the energy gradient there [N m or N]."""

    @property
    def is_stable(self) -> Component:
        """Whether the stiffness matrix is positive definite there."""


class Mechanism(Protocol):
    """A mechanism of one design, or of a batch of designs."""

    @property
    def design(self) -> object:
        """Its parameters, a frozen dataclass in SI units."""

    @property
    def input_names(self) -> Sequence[str]:
        """Of the inputs, in their order."""

    @property
    def reach(self) -> Component:
        """An upper bound of the distance of the tip from the origin or the base [m]."""

    @property
    def members(self) -> Sequence[Member]:
        """Bars, struts, springs, cables, prismatic actuators and torsional springs, between names of `nodes`."""

    def nodes(self, q: Vector, inputs: Vector, /) -> dict[str, Components]:
        """Positions of the nodes by name [m], (x, y) or (x, y, z)."""

    def tip(self, q: Vector, inputs: Vector, /) -> Vector:
        """Position of the tip [m], which is one of the nodes: (x, y) or (x, y, z)."""

    def jacobian(self, q: Vector, inputs: Sequence[Component], load: Vector, /) -> Rows:
        """How the tip moves: a row for each of its coordinates.

        By the configuration [m/rad] where that alone places the tip; by the inputs [-], through equilibria under a
        constant load, where the inputs are lengths.
        """

    def jacobian_determinant(self, q: Vector, inputs: Sequence[Component], load: Vector, /) -> Component:
        """Determinant of `jacobian`, zero (or not finite) at a singularity; the product of the singular values where
        the Jacobian is not square, [m2/rad2] or [-].
        """

    def potential_energy(self, q: Vector, inputs: Sequence[Component], load: Vector, /) -> Component:
        """Energy of springs, weights, tensions (tension times length), less the work of the load [J]."""

    def energy_gradient(self, q: Vector, inputs: Sequence[Component], load: Vector, /) -> Vector:
        """Gradient of the energy while the inputs are kept [N m]: zero in equilibrium.

        By the configuration; of the spatial prism by rotations about the world axes, its struts locked.
        """

    def stiffness_matrix(self, q: Vector, inputs: Sequence[Component], load: Vector, /) -> Rows:
        """Hessian of the energy while the inputs are kept [N m/rad], symmetric; positive definite where stable.

        By the configuration; of the spatial prism by rotations about the world axes, its struts locked.
        """

    def stability_margin(self, q: Vector, inputs: Sequence[Component], load: Vector, /) -> Component:
        """Smallest eigenvalue of `stiffness_matrix` over a stiffness of the design [-]: positive where stable."""

    def wrench_margin(self, q: Vector, inputs: Sequence[Component], load: Vector, /) -> Component:
        """How far forces, tensions or free lengths are from the bounds of what is feasible [-]: negative outside."""

    def equilibrium(self, inputs: Vector, start: Vector, load: Vector, /) -> Equilibrium:
        """The equilibrium that the mechanism reaches from a configuration `start`; it says whether there is one.

        Raises:
            ValueError: a number is not finite, or there are too few or too many of them.
        """

    def equilibria(self, inputs: Sequence[float], load: Sequence[float], /) -> Sequence[AnyEquilibrium]:
        """Every equilibrium under these inputs, of one design, sorted: each has `configuration`, `residual` [N m] and
        `is_stable`. The docstring of the method says whether the list is complete.

        Raises:
            ValueError: a number is not finite, or there are too few or too many of them.
        """

    @property
    def inverse_kinematics(self) -> Callable[..., Sequence[Solution]]:
        """The solutions that put the tip on a target, a list: empty where it is out of reach.

        A method of the target's coordinates as numbers [m], (x, y) or (x, y, z), and of what else the mechanism needs:
        the first angles of a redundant arm, or the load. Each solution has `configuration`.

        Raises:
            ValueError: a number is not finite, or the solutions form a continuum.
        """
