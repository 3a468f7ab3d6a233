"""Episodes of arms of any number of X-joints that can be solved."""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from tensegrity_envs.compiler.namespace import Components
from tensegrity_envs.environments.two_x.sampling import Sampler
from tensegrity_envs.mechanics import NXDesign
from tensegrity_envs.mechanics.n_x import NX
from tensegrity_envs.mechanics.x_arms import XArm

_NODES = {2: 161, 3: 61}  # of the grid along each angle; more joints have no grid
_LOOKS = 64  # along a straight path
_PROBES = 4096  # configurations by which a set of more joints is found to be empty


class NXSampler(Sampler):
    """As `Sampler`; of more than three joints, the straight joint path from the start to the target is in the set.

    A grid of four or more angles would be too coarse to tell connected components apart. There the path itself, with 64
    looks along it, shows that the target can be reached; the other targets of the component are not drawn.
    """

    arm: ClassVar[type[Any]] = NX

    @property
    def nodes(self) -> int:
        """Along each angle of the grid."""
        return _NODES[self.joints]

    def _labelled(self) -> np.ndarray:
        if self.joints in _NODES:
            return super()._labelled()
        limit = self.design.joint_limit
        probes = tuple(np.random.default_rng(0).uniform(-limit, limit, (self.joints, _PROBES)))
        return np.stack([self._inside_under(np.full(_PROBES, level), probes) for level in self._levels])

    design: NXDesign

    def _component(self, payload: np.ndarray, q: Components) -> np.ndarray:
        if self.joints in _NODES:
            return super()._component(payload, q)
        return self._inside_under(payload, q).astype(int)

    def _inside_under(self, payload: np.ndarray, q: Components) -> np.ndarray:
        return self.inside(NX(replace(self.design, payload=payload)), q)

    def _joined(self, mechanism: XArm, payload: np.ndarray, start: Components, q: Components) -> np.ndarray:
        if self.joints in _NODES:
            return super()._joined(mechanism, payload, start, q)
        m = len(q[0])
        share = np.repeat(np.linspace(0.0, 1.0, _LOOKS + 1), m)
        along = tuple(
            np.tile(a, _LOOKS + 1) + share * np.tile(b - a, _LOOKS + 1) for a, b in zip(start, q, strict=True)
        )
        inside = self.inside(mechanism.take(np.tile(np.arange(m), _LOOKS + 1)), along)
        return np.asarray(inside.reshape(_LOOKS + 1, m).all(axis=0))
