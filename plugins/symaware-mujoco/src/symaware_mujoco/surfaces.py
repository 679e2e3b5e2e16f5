"""Contacts with the products of both bodies' frictions and elasticities, which the engine would combine differently.

Reasons: docs/decisions/0079-mujoco.md
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from symaware_mujoco.bounce import solref
from symaware_mujoco.scene import BODY, Surface

#: [m] The torsional and rolling friction of contacts, the same for all surfaces.
_TURNING, _ROLLING = 0.005, 0.0001


class Surfaces:
    """The surfaces of the geometries of a model, and the contact parameters of each pair.

    Attributes:
        frictions: The friction of each geometry, which may be changed before `apply`.
        is_uniform: Whether the engine computes the right contact parameters by itself.
    """

    def __init__(self, surfaces: Sequence[Surface], step: float) -> None:
        """Store the surfaces.

        Args:
            surfaces: The surface of each geometry.
            step: The physics step [s].
        """
        self.frictions = np.array([each.friction for each in surfaces])
        self._elasticities, self._step = np.array([each.elasticity for each in surfaces]), step
        self.is_uniform = True
        #: The kind of surface of each geometry, and the contact parameters of two kinds: friction, and the engine's
        #: reference.
        self._kinds: NDArray[np.intp] = np.zeros(len(surfaces), np.intp)
        self._pair_frictions, self._pair_solrefs = np.zeros((1, 1)), np.zeros((1, 1, 2))

    def apply(self, model: Any, types: NDArray[np.int32]) -> None:
        """Set the parameters of surfaces in the engine.

        Args:
            model: The engine's model.
            types: The collision types (bits) of each geometry, as if all agents were present.
        """
        surfaces = list(zip(self.frictions.tolist(), self._elasticities.tolist(), strict=True))
        kinds = sorted(set(surfaces))
        frictions, elasticities = np.array(kinds).T.reshape(2, -1)
        self._kinds = np.array([kinds.index(each) for each in surfaces], np.intp)
        self._pair_frictions = np.maximum(np.multiply.outer(frictions, frictions), 1e-5)
        self._pair_solrefs = np.array(
            [[solref(one * other, self._step) for other in elasticities.tolist()] for one in elasticities.tolist()]
        ).reshape(len(kinds), len(kinds), 2)
        # If all bodies that forces move have one surface, a contact is between this surface and another: the engine
        # takes the parameters of the geometry with the greater priority, and fixed bodies and those on paths meet no
        # other bodies.
        moving = (types & BODY) != 0
        of_moving = sorted(set(self._kinds[moving].tolist()))
        self.is_uniform = len(of_moving) <= 1
        other = of_moving[0] if of_moving else 0
        model.geom_priority[:] = np.where(moving, 0, 1)
        for number, kind in enumerate(self._kinds.tolist()):
            model.geom_friction[number] = (self._pair_frictions[kind, other], _TURNING, _ROLLING)
            model.geom_solref[number] = self._pair_solrefs[kind, other]

    def correct(self, model: Any, data: Any) -> None:
        """Set contact parameters and constraints by both surfaces, between the two halves of a physics step."""
        contacts = data.contact
        one, other = self._kinds[contacts.geom.T]
        contacts.friction[:, :2] = self._pair_frictions[one, other][:, None]
        contacts.solref[:] = self._pair_solrefs[one, other]
        mujoco.mj_makeConstraint(model, data)
        mujoco.mj_island(model, data)
        mujoco.mj_projectConstraint(model, data)
        mujoco.mj_fwdVelocity(model, data)
