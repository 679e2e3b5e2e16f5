"""Body pairs: relative motion and uncertainty of an agent and another agent, or a convex piece of an obstacle."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from symaware_cli.core import AgentGroup, Confined, GroupComponent, Quantity, Tracks
from symaware_cli.engine.components.relative_motion import RelativeMotion, bounding_radii, own_velocity
from symaware_cli.engine.components.risk.outlines import Side
from symaware_cli.geometry import Array, BodyOutlines, Indices, Mask, Pieces, loosened


class Known:
    """The bodies of all agents, by index in the roster, and the believed poses of the agents of a group.

    The sizes of bodies are known to all agents; only positions are uncertain.
    """

    def __init__(self, group: AgentGroup) -> None:
        environment = group.surroundings.environment
        groups = environment.groups
        counts = [len(each) for each in groups]
        shapes = [each.entity.shape for each in groups]
        self.group = group
        self.start = environment.roster.start(group.name)
        self.radii = bounding_radii(environment)
        self.bodies = BodyOutlines([shape.pieces[0] if shape else None for shape in shapes], counts)
        #: Radii of their bounding balls in space.
        self.outer: Array = np.repeat([shape.outer_radius if shape else 0.0 for shape in shapes], counts)
        #: Whether headings follow from velocities: bodies move along them, and are symmetric in case they back up.
        ahead = [
            each.model.goes_ahead and (shape is None or _symmetric(shape.pieces[0][0]))
            for each, shape in zip(groups, shapes, strict=True)
        ]
        self.ahead: Mask = np.repeat(np.array(ahead, bool), counts)
        self.turns: Mask = np.repeat([each.model.heading is not None for each in groups], counts)

    def own_side(self, observers: Indices, covariance: Array | None) -> Side:
        """Return the own bodies of some rows of the group.

        Args:
            observers: The rows; shape (m,).
            covariance: The covariance of each agent's state, (n, nx, nx), if any.
        """
        group, model = self.group, self.group.model
        outlines, count = self.bodies.outlines(observers + self.start), len(observers)
        if model.heading is None or not self.bodies.any_cornered:
            return _known(outlines, np.zeros(count), np.zeros(count))
        state = group.awareness.state
        rates = model.turn_rate(state, model.limit(group.control_input))
        deviations = np.zeros(count)
        if covariance is not None:
            variance = covariance[:, model.heading, model.heading]
            deviations = np.sqrt(np.maximum(variance, 0.0)).take(observers)
        headings = np.ascontiguousarray(state[:, model.heading]).take(observers)
        return Side(outlines, headings, rates.take(observers), deviations, np.zeros(count, bool))

    def other_side(self, tracks: Tracks, rows: Indices) -> Side:
        """Return the bodies of others, for some rows of tracks."""
        others, count = tracks.others.take(rows), len(rows)
        outlines, world = self.bodies.outlines(others), self.group.awareness.world
        if not self.bodies.any_cornered:
            return _known(outlines, np.zeros(count), np.zeros(count))
        if self.group.awareness.tracks is None and world is not None:
            return _known(outlines, world.headings.take(others), world.turn_rates.take(others))
        velocity = tracks.velocities.take(rows, 0)[:, :2]
        speed = np.sqrt((velocity * velocity).sum(axis=1))
        deviations = np.zeros(count)
        if tracks.covariances is not None:
            first = tracks.covariances.shape[1] // 2
            block = tracks.covariances.take(rows, 0)[:, first : first + 2, first : first + 2]
            deviations = np.sqrt(np.maximum(np.trace(block, axis1=1, axis2=2), 0.0))
        ahead = self.ahead.take(others) & (speed > 0.0)
        # Other headings are not observed: a disc that contains the body holds for any heading.
        unknown = self.turns.take(others) & ~ahead
        headings = np.where(ahead, np.arctan2(velocity[:, 1], velocity[:, 0]), 0.0)
        deviations = np.where(ahead, deviations / np.where(speed > 0.0, speed, 1.0), 0.0)
        held = loosened(outlines, np.where(unknown, np.pi, 0.0))
        return Side(held, headings, np.zeros(count), deviations, np.ones(count, bool))


def _known(outlines: Pieces, headings: Array, rates: Array) -> Side:
    return Side(outlines, headings, rates, np.zeros(len(headings)), np.zeros(len(headings), bool))


def _symmetric(core: Sequence[Sequence[float]]) -> bool:
    """Return whether a core is unchanged by half a turn."""
    points = np.array(core, float)
    behind = np.linalg.norm(points[:, None] + points[None], axis=2).min(axis=1)
    return bool((behind <= 1e-9 * np.abs(points).max()).all())


class BodyPairs(ABC):
    """Pairs of bodies, ordered by agent.

    Attributes:
        observers: The agent of each pair, as a row of the group, ascending; shape (m,).
        apart: The vector from the agent to the other [m]; shape (d, m).
        closing: The velocity of the other minus the own one [m/s]; shape (d, m).
        radius: The sum of the radii of the bounding balls (seen from above, circles) of both [m]; shape (m,).
        round: Whether both fill these; shape (m,).
        covariance: Covariance of relative position and velocity, shape (m, 2d, 2d); None without uncertainty.
        heights: If heights of obstacles are known: the own height and its rate, and the least and greatest own height
            at which both may overlap; shape (4, m). None otherwise.
    """

    observers: Indices
    apart: Array
    closing: Array
    radius: Array
    round: Mask
    covariance: Array | None
    heights: Array | None = None

    @abstractmethod
    def sides(self, rows: Indices) -> tuple[Side, Side]:
        """Return the own bodies and the other bodies of some pairs."""

    def own_heights(self, rows: Indices) -> Array:
        """Return the covariance of the own height and its rate; shape (m, 2, 2)."""
        raise NotImplementedError

    def over_all(self, reduction: np.ufunc, values: Array, alone: Array) -> Array:
        """Reduce the values of each agent's pairs, starting with its value without any pairs.

        Args:
            reduction: The reduction, such as ``np.minimum``.
            values: The value of each pair; shape (m,).
            alone: The value of each agent without pairs; shape (n,).
        """
        observers = self.observers
        if not len(observers):
            return alone
        starts = np.flatnonzero(np.concatenate([[True], observers[1:] != observers[:-1]]))
        some, reduced = observers.take(starts), alone.copy()
        reduced[some] = reduction(alone.take(some), reduction.reduceat(values, starts))
        return reduced


class WithOthers(BodyPairs):
    """Pairs of each agent and each other agent that it is aware of within reach."""

    def __init__(self, known: Known, reach: float, own: OwnUncertainty) -> None:
        relative = RelativeMotion(known.group, reach, known.radii, own_velocity(known.group))
        self._known, self._own, self._tracks = known, own, relative.tracks
        others = relative.tracks.others
        self.observers = relative.observers
        self.apart, self.closing = relative.apart, relative.closing
        self.radius, self.round = relative.radius, np.ones(len(others), bool)
        bodies, start = known.bodies, known.start
        if len(self.apart) == 3 and (known.outer != known.radii).any():
            self.radius = known.outer.take(self.observers + start) + known.outer.take(others)
            self.round = self.radius == relative.radius
        if bodies.any_cornered:
            self.round = self.round & ~(bodies.cornered.take(self.observers + start) | bodies.cornered.take(others))
        self.covariance = own.with_others(relative.tracks.covariances, self.observers, len(self.apart))

    def confined(self) -> Iterator[tuple[Confined, WithSets]]:
        """Yield the sets in which agents know others to stay, and the pairs with these sets, from each source."""
        for confined in self._known.group.confined(self._tracks):
            yield confined, WithSets(self._known, self._tracks, confined, self._own)

    def sides(self, rows: Indices) -> tuple[Side, Side]:
        """See `BodyPairs`."""
        own = self._known.own_side(self.observers.take(rows), self._own.state)
        return own, self._known.other_side(self._tracks, rows)


class WithObstacles(BodyPairs):
    """Pairs of each agent and each convex piece of an obstacle within reach; agents know the obstacles."""

    def __init__(self, known: Known, reach: float, own: OwnUncertainty) -> None:
        group = known.group
        environment, model = group.surroundings.environment, group.model
        scenery = environment.scenery
        position, velocity = model.positions(group.awareness.state), own_velocity(group)
        self._known, self._own = known, own
        row, piece = scenery.candidates(position, reach)
        course = scenery.course(scenery.owner.take(piece))
        around = scenery.pieces.take(piece).placed(-course.positions, np.zeros(len(row)))
        radius = np.sqrt((around.vertices**2).sum(axis=2)).max(axis=1, initial=0.0) + around.rounding
        level = self._levels(known, position)
        if level is not None:
            # Leave out obstacles that the agent stands on or passes below.
            outer = known.outer[known.start]
            beside = (course.heights[:, 1] > level[row]) & (course.heights[:, 0] < level[row] + outer)
            row, piece, radius = row[beside], piece[beside], radius[beside]
            course = type(course)(*(each[beside] for each in course))
            around = around.take(np.flatnonzero(beside))
        self._turn_rates, self._pieces, self.observers = course.turn_rates, around, row
        self.apart = np.ascontiguousarray((course.positions - position[:, :2].take(row, 0)).T)
        self.closing = np.ascontiguousarray((course.velocities - velocity[:, :2].take(row, 0)).T)
        self.radius = radius + known.radii[known.start]
        # A rounded point at its own position is a disc.
        disc = ~known.bodies.cornered[known.start] & (np.abs(around.vertices).max(axis=(1, 2), initial=0.0) == 0.0)
        self.round = np.broadcast_to(disc, row.shape).copy()
        self.covariance = own.with_others(None, row, 2)
        if position.shape[1] == 3 and np.isfinite(course.heights).any():
            low, high = course.heights.T
            outer = known.outer[known.start]
            self.heights = np.stack([position[:, 2].take(row), velocity[:, 2].take(row), low - outer, high + outer])

    def _levels(self, known: Known, position: Array) -> Array | None:
        """Return the heights of planar agents if the world has heights of obstacles; None otherwise."""
        environment = known.group.surroundings.environment
        if position.shape[1] == 3 or not environment.scenery.has_heights:
            return None
        return environment.body_positions(known.group.ids)[:, 2]

    def sides(self, rows: Indices) -> tuple[Side, Side]:
        """See `BodyPairs`."""
        own = self._known.own_side(self.observers.take(rows), self._own.state)
        return own, _known(self._pieces.take(rows), np.zeros(len(rows)), self._turn_rates.take(rows))

    def own_heights(self, rows: Indices) -> Array:
        """See `BodyPairs`."""
        joint = self._own.joint
        if joint is None:
            return np.zeros((len(rows), 2, 2))
        return joint[self.observers.take(rows)][:, [2, 5]][:, :, [2, 5]]


class WithSets(BodyPairs):
    """Pairs of each agent and each set in which another is known to stay, as a body that stands still.

    While the other is within its set, the agent touches it only where it touches the set, enlarged by the other's body.
    In space, sets are columns of any height.
    """

    def __init__(self, known: Known, tracks: Tracks, confined: Confined, own: OwnUncertainty) -> None:
        group = known.group
        self._known, self._own = known, own
        self.observers = tracks.observers.take(confined.rows)
        position = group.model.positions(group.awareness.state)[:, :2].take(self.observers, 0)
        velocity = own_velocity(group)[:, :2].take(self.observers, 0)
        corners = confined.sets.vertices
        centre = 0.5 * (corners.min(axis=1) + corners.max(axis=1))
        around = confined.sets.placed(-centre, np.zeros(len(centre)))
        rounding = around.rounding + known.radii.take(tracks.others.take(confined.rows))
        self._pieces = Pieces(around.vertices, around.normals, around.offsets, rounding)
        self.apart = np.ascontiguousarray((centre - position).T)
        self.closing = np.ascontiguousarray(-velocity.T)
        widest = np.sqrt((around.vertices * around.vertices).sum(axis=2)).max(axis=1, initial=0.0)
        self.radius = widest + rounding + known.radii[known.start]
        # A rounded point at its own position is a disc.
        flat = np.abs(around.vertices).max(axis=(1, 2), initial=0.0) == 0.0
        self.round = flat & (not known.bodies.cornered[known.start])
        self.covariance = own.with_others(None, self.observers, 2)

    def sides(self, rows: Indices) -> tuple[Side, Side]:
        """See `BodyPairs`."""
        own = self._known.own_side(self.observers.take(rows), self._own.state)
        return own, _known(self._pieces.take(rows), np.zeros(len(rows)), np.zeros(len(rows)))


class OwnUncertainty:
    """The uncertainty of the agents of a group about their own states.

    Attributes:
        state: The covariance of each agent's state, shape (n, nx, nx); None if not estimated.
        joint: The covariance of its position and velocity, shape (n, 2d, 2d), propagated from the state, as the
            velocity depends on it, for example on the heading.
    """

    def __init__(self, group: AgentGroup, counts: bool = True) -> None:
        self.state = state_covariance(group) if counts else None
        self.joint: Array | None = None
        if self.state is not None:
            model, state = group.model, group.awareness.state
            jacobian = model.jacobian(state, model.limit(group.control_input))
            places = list(model.position)
            picks = np.broadcast_to(np.eye(len(model.state))[places], (len(group), len(places), len(model.state)))
            by_state = np.concatenate([picks, jacobian[:, places]], axis=1)
            self.joint = by_state @ self.state @ np.swapaxes(by_state, 1, 2)

    def with_others(self, believed: Array | None, observers: Indices, dimensions: int) -> Array | None:
        """Return the covariance of relative positions and velocities; errors of both are assumed independent.

        Args:
            believed: The covariance of those of the others, (m, 2d, 2d); None if these are known.
            observers: The agent of each row; shape (m,).
            dimensions: The dimensions d of the rows; planar agents are at height 0.
        """
        if self.joint is None:
            return believed
        size, own = self.joint.shape[1] // 2, self.joint[observers]
        kept = min(size, dimensions)
        picks = [*range(kept), *range(size, size + kept)]
        places = [*range(kept), *range(dimensions, dimensions + kept)]
        covariance = np.zeros((len(observers), 2 * dimensions, 2 * dimensions))
        if believed is not None:
            covariance += believed
        covariance[np.ix_(range(len(observers)), places, places)] += own[:, picks][:, :, picks]
        return covariance


def state_covariance(group: AgentGroup) -> Array | None:
    """Return the covariance of each agent's own state now, shape (n, nx, nx); None if not estimated.

    Raises:
        ValueError: The uncertainty is not such a matrix, row by row.
    """
    size = len(group.model.state)
    shared = group.awareness.uncertainty.shared
    if shared is not None:
        first = shared[1][:, 0]
    else:
        # A component of single agents wrote these, with Python objects for each agent anyway.
        series = [group.awareness.uncertainty.row(row) for row in range(len(group))]
        if not any(len(each) for each in series):
            return None
        first = np.array([each.values[0] if len(each) else np.zeros(size * size) for each in series])
    if first.shape[1] != size * size:
        raise ValueError(f"the uncertainty of `{group.name}` has {first.shape[1]} elements, not {size} x {size}")
    return first.reshape(-1, size, size)


class PairRisk(GroupComponent):
    """Base class of risks that result from an agent's pairs with others and obstacles."""

    sees_world = True
    #: Whether the agents' uncertainty about themselves counts.
    uses_uncertainty = True

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare the risk as one number without a unit."""
        return {"risk": [Quantity("risk", "1")]}

    def initialise_component(self, group: AgentGroup) -> None:
        """Look up the bodies of all agents."""
        super().initialise_component(group)
        self._known = Known(group)

    def _pairs(self) -> Iterator[BodyPairs]:
        """Yield the pairs with agents and obstacles within the parameter ``reach`` [m]."""
        own, reach = OwnUncertainty(self._group, self.uses_uncertainty), self.parameters.reach
        yield WithOthers(self._known, reach, own)
        if self.parameters.obstacles and len(self.environment.scenery):
            yield WithObstacles(self._known, reach, own)

    def _update(self, value: Array) -> None:
        self._group.awareness.risk.set(self.computed_at, value)
