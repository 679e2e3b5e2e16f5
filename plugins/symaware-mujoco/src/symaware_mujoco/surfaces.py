"""Contacts with the product of both bodies' frictions and of both elasticities, which the engine would mix otherwise.

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

#: [m] What a contact resists turning and rolling by; two bodies of any surface have the same.
_TURNING, _ROLLING = 0.005, 0.0001


class Surfaces:
    """The surfaces of the geometries of a model, and what each two of them make.

    Attributes:
        frictions: The friction of each geometry, which may be changed before `apply`.
        is_uniform: Whether the engine finds the right contacts by itself.
    """

    def __init__(self, surfaces: Sequence[Surface], step: float) -> None:
        """Store the surfaces.

        Args:
            surfaces: That of each geometry.
            step: The physics step [s].
        """
        self.frictions = np.array([each.friction for each in surfaces])
        self._elasticities, self._step = np.array([each.elasticity for each in surfaces]), step
        self.is_uniform = True
        #: The kind of surface of each geometry, and what two kinds make: friction, and the engine's reference.
        self._kinds: NDArray[np.intp] = np.zeros(len(surfaces), np.intp)
        self._pair_frictions, self._pair_solrefs = np.zeros((1, 1)), np.zeros((1, 1, 2))

    def apply(self, model: Any, types: NDArray[np.int32]) -> None:
        """Tell the engine what the surfaces are like.

        Args:
            model: The engine's model.
            types: The bits of each geometry that say what it is, as if all agents were present.
        """
        surfaces = list(zip(self.frictions.tolist(), self._elasticities.tolist(), strict=True))
        kinds = sorted(set(surfaces))
        frictions, elasticities = np.array(kinds).T.reshape(2, -1)
        self._kinds = np.array([kinds.index(each) for each in surfaces], np.intp)
        self._pair_frictions = np.maximum(np.multiply.outer(frictions, frictions), 1e-5)
        self._pair_solrefs = np.array(
            [[solref(one * other, self._step) for other in elasticities.tolist()] for one in elasticities.tolist()]
        ).reshape(len(kinds), len(kinds), 2)
        # Where all that moves by forces has one surface, contacts are those of it and of what it meets: the engine
        # takes the parameters of the geometry with the greater priority, and what is fixed or on a path meets nothing
        # else.
        moving = (types & BODY) != 0
        of_moving = sorted(set(self._kinds[moving].tolist()))
        self.is_uniform = len(of_moving) <= 1
        other = of_moving[0] if of_moving else 0
        model.geom_priority[:] = np.where(moving, 0, 1)
        for number, kind in enumerate(self._kinds.tolist()):
            model.geom_friction[number] = (self._pair_frictions[kind, other], _TURNING, _ROLLING)
            model.geom_solref[number] = self._pair_solrefs[kind, other]

    def correct(self, model: Any, data: Any) -> None:
        """Give the contacts between the two halves of a physics step what both surfaces make, and their constraints."""
        contacts = data.contact
        one, other = self._kinds[contacts.geom.T]
        contacts.friction[:, :2] = self._pair_frictions[one, other][:, None]
        contacts.solref[:] = self._pair_solrefs[one, other]
        mujoco.mj_makeConstraint(model, data)
        mujoco.mj_island(model, data)
        mujoco.mj_projectConstraint(model, data)
        mujoco.mj_fwdVelocity(model, data)
