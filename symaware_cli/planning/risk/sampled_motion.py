"""Sampled motion: many possible futures of the agents of a group, and of the others that they are aware of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Tracks
from symaware_cli.engine import REGION, interpolated
from symaware_cli.geometry import Array, Indices, Mask, lengths
from symaware_cli.world import Turn, generator, integrate, key_of, philox

Numbers = NDArray[np.uint64]

#: The number of tables of samples; each agent uses one of them.
_TABLES = 16


class SampledNoise:
    """Independent standard normal samples for each agent, for several draws in one turn.

    There are a few tables of random numbers. Each agent uses one of them, and for each draw begins at a place of its
    own in it. So the samples and draws of an agent are independent of each other; samples of different agents may
    coincide, but not in all draws. Agents and tables are keyed by seed, purpose, turn and the number of the agent:
    samples do not depend on which other agents there are.
    """

    def __init__(
        self, seed: int, purpose: str, turn: Turn, numbers: Numbers, draws: int, width: int, samples: int
    ) -> None:
        """Draw the tables.

        Args:
            seed: The seed of the run.
            purpose: The purpose of the samples, part of the key of the random numbers.
            turn: The turn in which they are drawn.
            numbers: A number for each agent that depends on its id alone; shape (n,).
            draws: The number of draws.
            width: The number of elements of each sample.
            samples: The number of samples of each agent in a draw.
        """
        tables = (numbers % np.uint64(_TABLES)).astype(np.intp)
        used = np.unique(tables)
        self._table = np.searchsorted(used, tables)
        drawn = np.empty((draws, width, len(used), 3 * samples))
        for place, table in enumerate(used.tolist()):
            own = generator(seed, f"{purpose}\0{table}", turn)
            drawn[:, :, place, : 2 * samples] = own.standard_normal((draws, width, 2 * samples))
        drawn[..., 2 * samples :] = drawn[..., :samples]
        self._windows = sliding_window_view(drawn, samples, axis=-1)
        counters = np.repeat(numbers, draws)
        words, _ = philox(
            counters, np.tile(np.arange(draws, dtype=np.uint64), len(numbers)), key_of(seed, purpose, *turn)
        )
        self._offsets = (words[0] % np.uint32(2 * samples)).astype(np.intp).reshape(-1, draws)

    def draw(self, number: int, agents: slice) -> Array:
        """Return the samples of a draw.

        Args:
            number: The number of the draw.
            agents: Which agents.

        Returns:
            Shape (width, agents, samples).
        """
        tables, offsets = self._table[agents], self._offsets[agents, number]
        drawn: Array = self._windows[number][:, tables, offsets]
        return drawn


class OtherRegions(NamedTuple):
    """Where others are, with a probability.

    Attributes:
        radii: The radii around the expected positions at each instant [m]; infinite where there is no region; shape
            (K, m).
        misses: The probability that any other is elsewhere, for each agent; shape (n,).
    """

    radii: Array
    misses: Array


class OtherMotion(NamedTuple):
    """What agents expect of others.

    Attributes:
        tracks: Their tracks, of all agents of the group.
        places: The expected positions at each instant [m]; shape (K, m, d).
        spread: The root of the covariance of position and velocity, shape (m, 2d, 2d); None if they are known.
        noise: Samples of the deviations of each; None if they are known.
        regions: Where they are instead of at samples, if that is known.
    """

    tracks: Tracks
    places: Array
    spread: Array | None
    noise: SampledNoise | None
    regions: OtherRegions | None = None

    @classmethod
    def in_regions(cls, group: AgentGroup, tracks: Tracks, instants: Sequence[int]) -> OtherMotion:
        """Return others as the regions say that agents are aware of.

        Args:
            group: The group.
            tracks: Its tracks, m of them.
            instants: The instants of the prediction, K of them [ns].
        """
        ids = group.surroundings.environment.roster.ids
        places = np.repeat(tracks.positions[None], len(instants), axis=0)
        radii, misses = np.full(places.shape[:2], np.inf), np.zeros(len(group))
        for row, agent in enumerate(group.agents):
            regions = agent.awareness_database.held_part(REGION.name)
            for place in range(*tracks.pointers[row : row + 2].tolist()):
                region = regions.get(ids[tracks.others[place]])
                if region is None:
                    continue
                size = region.values.shape[1] - 2
                places[:, place, :size] = interpolated(region.times, region.values[None, :, :size], instants)[0]
                # A radius holds since the look-ahead before.
                numbers = np.searchsorted(region.times, instants)
                known = numbers < len(region)
                radii[known, place] = region.values[numbers[known], size]
                misses[row] = max(misses[row], 1.0 - float(region.values[0, size + 1]))
        return cls(tracks, places, None, None, OtherRegions(radii, misses))


class MotionPlan(NamedTuple):
    """The expected motion of agents, at instants from now on.

    Attributes:
        durations: The time from the previous instant to each instant [s]; shape (K,). The first counts from now.
        spreads: The root of the covariance of the process noise until each instant, shape (1, nx, nx); None without
            noise.
        intended: The intended positions [m], shape (n, K + 1, d), now and at each instant; None without intents.
        has_intent: Whether each agent has an intent; shape (n,).
        correction: The gain by which deviations from the intent are corrected [1/s].
    """

    durations: Array
    spreads: Sequence[Array | None]
    intended: Array | None
    has_intent: Mask
    correction: float


class SampledMotion:
    """Samples of the motion of some adjacent agents of a group; see `specification.predicted_scope.PredictedMotion`.

    An agent begins at a sample of its belief. It follows its intent or, without one, keeps its control input; the
    process noise of its model disturbs it. Others begin at samples of their tracks, and follow the intents that they
    told of or keep their velocities.

    The rows are agents times samples, the samples of an agent adjacent.
    """

    def __init__(
        self,
        group: AgentGroup,
        agents: slice,
        samples: int,
        plan: MotionPlan,
        spread: Array | None,
        noise: SampledNoise | None = None,
        others: OtherMotion | None = None,
    ) -> None:
        """Sample the present states.

        Args:
            group: The group.
            agents: The rows of the agents.
            samples: The number of samples of each.
            plan: Their expected motion.
            spread: The root of the covariance of the states, shape (n, nx, nx); None if they are known.
            noise: Samples for the states, then for each instant; None for the expected motion.
            others: The expected motion of other agents; None if nothing asks for it.
        """
        self.time = 0.0
        self._group = group
        self._model = group.model
        self._agents = agents
        self._samples = samples
        self._plan = plan
        self._noise = noise
        self._others = others
        self._instant = -1
        states = group.awareness.state[agents]
        self.states: Array = repeated(states, samples)
        if spread is not None and noise is not None:
            self._disturb(spread[agents], noise.draw(0, agents))
        self._held = repeated(self._model.limit(group.control_input[agents]), samples)
        self.inputs: Array = self._held
        self._first = 0 if others is None else int(others.tracks.pointers[agents.start])

    def advance(self, time: float) -> None:
        """Advance to the next instant.

        Args:
            time: The instant [s].
        """
        self.time = time
        self._instant += 1
        if self.duration > 0.0:
            self.states, self.inputs = self.expected(self.states)
            spread = self._plan.spreads[self._instant]
            if spread is not None and self._noise is not None:
                self._disturb(spread, self._noise.draw(self._instant + 1, self._agents))
        self._places: tuple[Array, Array] | None = None
        self._pairs: tuple[tuple[Array, Array], tuple[Array, Array]] | None = None

    def expected(self, states: Array) -> tuple[Array, Array]:
        """Return the states at the present instant, without noise, and the control inputs until then.

        Args:
            states: The states at the previous instant; shape (R, nx).
        """
        inputs = self._inputs(states, self.duration)
        return integrate(self._model, states, inputs, self.duration), inputs

    @property
    def duration(self) -> float:
        """The time from the previous instant, or from now, to the present instant [s]."""
        return float(self._plan.durations[self._instant])

    def nearest(self) -> Array:
        """Return the distance to the nearest other [m]; infinite if there is none."""
        own, (places, _) = self._own_places(), self._other_places()
        pointers, radii = self._pointers(), self._radii()
        least = np.full((len(pointers) - 1, self._samples), np.inf)
        rows = np.repeat(np.arange(len(least)), np.diff(pointers))
        if len(rows):
            squared = np.zeros((len(rows), self._samples))
            for axis in range(places.shape[2]):
                apart = places[:, :, axis] - own[rows, :, axis] if axis < own.shape[2] else places[:, :, axis]
                squared += apart * apart
            if radii is not None:
                squared = np.square(np.maximum(np.sqrt(squared) - radii, 0.0))
            some = np.flatnonzero(np.diff(pointers))
            least[some] = np.minimum.reduceat(squared, pointers[some] - pointers[0], axis=0)
        distances: Array = np.sqrt(least).ravel()
        return distances

    def pose(self, id: str) -> tuple[Array, Array | None]:
        """Return the positions of an agent, NaN where it is not known; and its headings, if its model has one.

        The headings of others are the directions of their velocities.
        """
        group, environment = self._group, self._group.surroundings.environment
        roster, own = environment.roster, self._own_places()
        found, headings = np.full(own.shape, np.nan), np.zeros(own.shape[:2])
        if self._others is not None:
            tracks = self._others.tracks
            rows = np.arange(self._first, int(tracks.pointers[self._agents.stop]))
            chosen = rows[tracks.others[rows] == roster.indices[id]]
            places, moving = self._other_places()
            agents = tracks.observers[chosen] - self._agents.start
            found[agents] = places[chosen - self._first, :, : own.shape[2]]
            ahead = moving[chosen - self._first]
            headings[agents] = np.arctan2(ahead[:, :, 1], ahead[:, :, 0])
        for agent in [row for row, own_id in enumerate(group.ids[self._agents]) if own_id == id]:
            found[agent] = own[agent]
            if group.model.heading is not None:
                headings[agent] = self.states[:, group.model.heading].reshape(headings.shape)[agent]
        turns = any(id in each.ids and each.model.heading is not None for each in environment.groups)
        return found.reshape(-1, own.shape[-1]), headings.ravel() if turns else None

    def repeated(self, values: Array) -> Array:
        """Repeat values of the agents of the group for each of their rows."""
        own = values[self._agents] if len(values) == len(self._group) else values
        return repeated(own, self._samples) if own.ndim == 2 else np.repeat(own, self._samples, axis=0)

    def pairs(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Return positions and velocities of each agent and of each other that it knows; (tracks, samples, d)."""
        if self._pairs is None:
            self._pairs = self._related()
        return self._pairs

    def _related(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        places, moving = self._other_places()
        rows = np.repeat(np.arange(len(self._pointers()) - 1), np.diff(self._pointers()))
        own = np.zeros(places.shape)
        velocity = np.zeros(places.shape)
        positions = self._own_places()
        own[:, :, : positions.shape[2]] = positions[rows]
        radii = self._radii()
        if radii is not None:
            # The nearest point of each region.
            apart = places - own
            distance = lengths(apart.reshape(-1, apart.shape[2])).reshape(apart.shape[:2])
            left = np.maximum(distance - radii, 0.0)
            share = np.divide(left, distance, out=np.zeros(left.shape), where=distance > 0.0)
            places = own + share[:, :, None] * apart
        rates = self._model.velocity(self.states, self.inputs).reshape(positions.shape)
        velocity[:, :, : positions.shape[2]] = rates[rows]
        return (own, places), (velocity, moving)

    def _radii(self) -> Array | None:
        """Return the radii of the regions of others [m], shape (tracks, 1); None without regions."""
        if self._others is None or self._others.regions is None:
            return None
        pointers = self._pointers()
        return self._others.regions.radii[self._instant, int(pointers[0]) : int(pointers[-1]), None]

    def _pointers(self) -> Indices:
        assert self._others is not None
        return self._others.tracks.pointers[self._agents.start : self._agents.stop + 1]

    def _own_places(self) -> Array:
        """Return the positions of the agents [m]; shape (agents, samples, d)."""
        positions = self._model.positions(self.states)
        return positions.reshape(-1, self._samples, positions.shape[1])

    def _other_places(self) -> tuple[Array, Array]:
        """Return the positions and velocities of others; each of shape (tracks, samples, d)."""
        if self._places is None:
            assert self._others is not None
            pointers, others = self._pointers(), self._others
            rows = slice(int(pointers[0]), int(pointers[-1]))
            tracks, size = others.tracks, others.places.shape[2]
            shape = (rows.stop - rows.start, self._samples, size)
            places = np.broadcast_to(others.places[self._instant, rows, None], shape)
            moving = np.broadcast_to(tracks.velocities[rows, None], shape)
            if others.noise is not None and others.spread is not None:
                drawn = others.noise.draw(0, rows)
                passed = float(self._plan.durations[: self._instant + 1].sum())
                deviation = np.zeros((2 * size, *shape[:2]))
                for row in range(2 * size):
                    for column in range(row + 1):
                        deviation[row] += others.spread[rows, row, column, None] * drawn[column]
                off = deviation[:size] + passed * deviation[size:]
                places = places + np.moveaxis(off, 0, 2)
                moving = moving + np.moveaxis(deviation[size:], 0, 2)
            self._places = places, moving
        return self._places

    def _inputs(self, states: Array, duration: float) -> Array:
        """Return the control inputs until the present instant; shape (R, nu)."""
        plan, now = self._plan, self._instant
        if plan.intended is None:
            return self._held
        here, there = plan.intended[self._agents, now], plan.intended[self._agents, now + 1]
        velocity = repeated((there - here) / duration, self._samples)
        if plan.correction:
            off = repeated(here, self._samples) - self._model.positions(states)
            velocity += plan.correction * off
        followed = self._model.limit(self._model.follow_velocity(states, velocity))
        if plan.has_intent[self._agents].all():
            return followed
        return np.where(np.repeat(plan.has_intent[self._agents], self._samples)[:, None], followed, self._held)

    def _disturb(self, spread: Array, drawn: Array) -> None:
        """Add deviations to the states, by the roots of covariances (1 or n, nx, nx) and samples (nx, n, samples)."""
        elements = self.states.T.reshape(-1, *drawn.shape[1:])
        moved = np.empty(elements.shape)
        for row, (element, total) in enumerate(zip(elements, moved, strict=True)):
            columns = [column for column in range(row + 1) if spread[:, row, column].any()]
            if not columns:
                total[...] = element
            for column in columns:
                if column == columns[0]:
                    np.multiply(spread[:, row, column, None], drawn[column], out=total)
                    total += element
                else:
                    total += spread[:, row, column, None] * drawn[column]
        self.states = moved.reshape(len(moved), -1).T


def repeated(values: Array, samples: int) -> Array:
    """Repeat the rows of values, (n, k) to (n * samples, k); each column is contiguous, which is twice as fast."""
    return np.repeat(values.T, samples, axis=1).T


def root(covariance: Array) -> Array:
    """Return lower triangular roots of covariances, which may be singular; (n, k, k) to (n, k, k).

    This is the Cholesky decomposition, element by element: its bits depend on no library for linear algebra.
    """
    size = covariance.shape[1]
    found = np.zeros(covariance.shape)
    for column in range(size):
        pivot = covariance[:, column, column].copy()
        for before in range(column):
            pivot -= found[:, column, before] * found[:, column, before]
        pivot = np.sqrt(np.maximum(pivot, 0.0))
        found[:, column, column] = pivot
        for row in range(column + 1, size):
            rest = covariance[:, row, column].copy()
            for before in range(column):
                rest -= found[:, row, before] * found[:, column, before]
            found[:, row, column] = np.divide(rest, pivot, out=np.zeros(len(rest)), where=pivot > 0.0)
    return found
