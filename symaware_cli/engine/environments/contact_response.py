"""What contacts do to bodies in a world without forces: they stop, or slide along each other.

Reasons: docs/decisions/0087-sensing.md
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from symaware_cli.core import EntityGroup, Scenery
from symaware_cli.geometry import Array, BodyOutlines, Indices, Mask, Proximity, Separation, separation

#: What happens to bodies that meet: they pass through each other, stop, slide along each other, or the run ends.
OnContact = Literal["pass", "stop", "slide", "end"]

#: How often bodies that slide are pushed apart in a step, before those that still overlap stop.
_PUSHES = 16

#: Overlaps that are less deep count as none, as their directions would be rounding errors [m]; bodies are pushed apart
#: by as much more.
_TOLERANCE = 1e-9


class Overlaps(NamedTuple):
    """Pairs of an agent and a body that it overlaps; two agents are two pairs.

    Attributes:
        agent: The agents, by index; shape (m,).
        other: The other body: an agent by index, or the number of agents plus the piece of the scenery; shape (m,).
        normal: The direction in which the shortest motion of the agent ends the overlap; shape (m, d).
        depth: How far that is [m]; shape (m,).
    """

    agent: Indices
    other: Indices
    normal: Array
    depth: Array


class ContactResponse:
    """Corrects a step of the world, so that no body moves into another one.

    A body that *stops* is where it was before the step. Of two agents, those stop that moved towards the other. A body
    that *slides* is pushed out along the shortest way, two agents by half of it each; those that still overlap after
    some rounds stop. A velocity in the state loses what leads into the other body, or all of it if the body stops;
    other elements of the state continue as the model says. Bodies that overlap already may part.

    Positions at the ends of steps count, not the motion between them.
    """

    def __init__(self, kind: OnContact, groups: Sequence[EntityGroup]) -> None:
        """Prepare for the bodies of a world.

        Args:
            kind: ``stop`` or ``slide``.
            groups: The groups in the roster's order.
        """
        counts = [len(group) for group in groups]
        shapes = [group.entity.shape for group in groups]
        self._slides = kind == "slide"
        self._models = [group.model for group in groups]
        self._bodies = BodyOutlines([shape.pieces[0] if shape else None for shape in shapes], counts)
        has_shape = np.repeat([shape is not None for shape in shapes], counts)
        #: Negative infinity for a body without a shape, so that nothing touches it.
        self._radii = np.where(has_shape, self._bodies.radii, -np.inf)
        self._reach = max(0.0, 2.0 * float(self._radii.max(initial=0.0)))
        self._ends = np.cumsum(counts)[:-1]
        self._proximity = Proximity()

    def corrected(
        self, before: Sequence[Array], after: Sequence[Array], scenery: Scenery, present: Mask | None
    ) -> list[Array]:
        """Return the states of all groups after a step, corrected.

        Args:
            before: The states of each group before the step; shape (n, nx).
            after: The states as the models say; shape (n, nx). All are finite.
            scenery: The obstacles after the step.
            present: Which agents are in the world, by index; None for all.
        """
        if not self._reach or not all(np.isfinite(state).all() for state in after):
            return list(after)  # a state that is not finite fails the run
        if present is not self._proximity.present:
            self._proximity.present = present
        start, start_headings = self._poses(before)
        position, headings = self._poses(after)
        found = self._overlaps(position, headings, scenery, present)
        if not len(found.agent):
            return list(after)
        wanted, wanted_headings, velocity = position, headings, self._velocities(after, position)
        if self._slides:
            position, velocity, found = self._pushed_apart(position, headings, velocity, found, scenery, present)
        known = self._overlaps(start, start_headings, scenery, present)
        depths = dict(zip(zip(known.agent.tolist(), known.other.tolist(), strict=True), known.depth, strict=True))
        stopped = np.zeros(len(position), bool)
        while True:
            new = self._entering(found, depths, start, position, start_headings != headings) & ~stopped
            if not new.any():
                break
            stopped |= new
            position = np.where(stopped[:, None], start, position)
            headings = np.where(stopped, start_headings, headings)
            found = self._overlaps(position, headings, scenery, present)
        velocity = np.where(stopped[:, None], 0.0, velocity)
        changed = stopped | (position != wanted).any(axis=1) | (headings != wanted_headings)
        return self._states(after, position, headings, velocity, changed)

    def _pushed_apart(
        self,
        position: Array,
        headings: Array,
        velocity: Array,
        found: Overlaps,
        scenery: Scenery,
        present: Mask | None,
    ) -> tuple[Array, Array, Overlaps]:
        """Push bodies out of each other, each out of the body that it is deepest in; return what still overlaps."""
        for _ in range(_PUSHES):
            if not len(found.agent):
                break
            # The deepest overlap of each agent comes first; of equally deep ones, that with the first body.
            order = np.lexsort((found.other, -found.depth, found.agent))
            chosen = order[np.diff(found.agent[order], prepend=-1) != 0]
            agent, normal = found.agent[chosen], found.normal[chosen]
            share = np.where(found.other[chosen] < len(position), 0.5, 1.0)
            position = position.copy()
            position[agent] += ((found.depth[chosen] + _TOLERANCE) * share)[:, None] * normal
            velocity = velocity.copy()
            inwards = np.minimum((velocity[agent] * normal).sum(axis=1), 0.0)
            velocity[agent] -= inwards[:, None] * normal
            found = self._overlaps(position, headings, scenery, present)
        return position, velocity, found

    def _entering(
        self,
        found: Overlaps,
        depths: dict[tuple[int, int], float],
        start: Array,
        position: Array,
        turned: Mask,
    ) -> Mask:
        """Return which agents moved into another body, deeper than they were before; shape (N,)."""
        before = [depths.get(pair, 0.0) for pair in zip(found.agent.tolist(), found.other.tolist(), strict=True)]
        deeper = found.depth > np.array(before, float) + _TOLERANCE
        moved = position[found.agent] - start[found.agent]
        towards = (moved * found.normal).sum(axis=1) < 0.0
        towards |= turned[found.agent] & self._bodies.cornered[found.agent]
        entering = np.zeros(len(position), bool)
        entering[found.agent[deeper & towards]] = True
        return entering

    def _overlaps(self, position: Array, headings: Array, scenery: Scenery, present: Mask | None) -> Overlaps:
        agents, pieces = self._among_agents(position, headings), self._with_pieces(position, headings, scenery, present)
        return Overlaps(*(np.concatenate(pair) for pair in zip(agents, pieces, strict=True)))

    def _among_agents(self, position: Array, headings: Array) -> Overlaps:
        pairs = self._proximity.pairs(position, self._reach)
        near = np.flatnonzero(pairs.distance < self._radii.take(pairs.first) + self._radii.take(pairs.second))
        first, second, distance = pairs.first.take(near), pairs.second.take(near), pairs.distance.take(near)
        depth = self._radii.take(first) + self._radii.take(second) - distance
        apart = position.take(first, 0) - position.take(second, 0)
        normal = apart / np.where(distance > 0.0, distance, 1.0)[:, None]
        normal[distance == 0.0, 0] = 1.0
        exact = np.flatnonzero(self._bodies.cornered.take(first) | self._bodies.cornered.take(second))
        if len(exact):
            one = self._bodies.placed(first[exact], position, headings)
            found = separation(one, self._bodies.placed(second[exact], position, headings))
            depth[exact] = -found.distance
            normal[exact] = 0.0
            normal[exact, :2] = _directions(found)
        kept = np.flatnonzero(depth > _TOLERANCE)
        first, second, depth, normal = first[kept], second[kept], depth[kept], normal[kept]
        return Overlaps(
            np.concatenate([first, second]),
            np.concatenate([second, first]),
            np.concatenate([normal, -normal]),
            np.concatenate([depth, depth]),
        )

    def _with_pieces(self, position: Array, headings: Array, scenery: Scenery, present: Mask | None) -> Overlaps:
        agent, piece = scenery.candidates(position, self._radii)
        if present is not None:
            here = present.take(agent)
            agent, piece = agent[here], piece[here]
        found = separation(self._bodies.placed(agent, position, headings), scenery.pieces.take(piece))
        kept = np.flatnonzero(found.distance < -_TOLERANCE)
        normal = np.zeros((len(kept), position.shape[1]))
        normal[:, :2] = _directions(found)[kept]
        return Overlaps(agent[kept], len(position) + piece[kept], normal, -found.distance[kept])

    def _poses(self, states: Sequence[Array]) -> tuple[Array, Array]:
        """Return positions (N, d), those of agents in the plane at height 0, and headings (N,)."""
        dimensions = max(len(model.position) for model in self._models)
        position = np.zeros((len(self._radii), dimensions))
        headings = np.zeros(len(self._radii))
        for model, state, place, heading in zip(
            self._models, states, np.split(position, self._ends), np.split(headings, self._ends), strict=True
        ):
            place[:, : len(model.position)] = model.positions(state)
            if model.heading is not None:
                heading[:] = state[:, model.heading]
        return position, headings

    def _velocities(self, states: Sequence[Array], like: Array) -> Array:
        """Return the velocities that states contain, 0 for others; shape (N, d)."""
        velocity = np.zeros_like(like)
        for model, state, values in zip(self._models, states, np.split(velocity, self._ends), strict=True):
            values[:, : len(model.velocities)] = state[:, list(model.velocities)]
        return velocity

    def _states(
        self, after: Sequence[Array], position: Array, headings: Array, velocity: Array, changed: Mask
    ) -> list[Array]:
        """Return the states with the poses and velocities of some agents."""
        corrected = []
        parts = (np.split(each, self._ends) for each in (position, headings, velocity, changed))
        for model, state, place, heading, rate, some in zip(self._models, after, *parts, strict=True):
            if some.any():
                state = state.copy()
                state[np.ix_(some, model.position)] = place[some, : len(model.position)]
                if model.heading is not None:
                    state[some, model.heading] = heading[some]
                if model.velocities:
                    state[np.ix_(some, model.velocities)] = rate[some, : len(model.velocities)]
            corrected.append(state)
        return corrected


def _directions(found: Separation) -> Array:
    """Return the unit vectors along which the first of overlapping pieces leave the second; shape (m, 2)."""
    way = found.second - found.first
    length = np.sqrt((way * way).sum(axis=1))
    directions: Array = way / np.where(length > 0.0, length, 1.0)[:, None]
    return directions
