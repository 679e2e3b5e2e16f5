"""The risk of going on at parts of a requested speed, over the whole rest of a run."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup
from symaware_cli.engine import state_covariance
from symaware_cli.geometry import Array, Indices
from symaware_cli.planning.risk.first_passage import FirstPassage
from symaware_cli.planning.risk.invariants import ExpectedMotion, InvariantWindows
from symaware_cli.planning.risk.pair_conditions import OtherPositions, OthersAhead
from symaware_cli.planning.risk.state_conditions import Tail, propagated
from symaware_cli.specification import PredictedAgentScope
from symaware_cli.world import SECOND, integrate, nanoseconds

#: The parts of the requested speed that are compared.
FACTORS: Array = np.linspace(0.0, 1.0, 21)

#: The longest run of a model that does not stay where it stops by itself, in steps: each is predicted at every turn.
MOST_STEPS = 2_000


class RiskOfSpeeds(NamedTuple):
    """The risk at each of the `FACTORS`, until the end of the run or of the windows of the specifications.

    Attributes:
        stopping: Bounds of the risk of going on for a step, and then stopping; shape (n, factors).
        holding: Of going on over the horizon, and then stopping; shape (n, factors).
        next: Of the next step alone; shape (n, factors).
        worst: Which invariant has the greatest risk of going on for a step and stopping; shape (n, factors).
        exceeds: The instant [ns] until which that risk exceeds what may be taken; shape (n, factors).
        remaining: How many steps to come count; shape (n,).
    """

    stopping: Array
    holding: Array
    next: Array
    worst: Indices
    exceeds: NDArray[np.int64]
    remaining: Indices


class SpeedRisk:
    """Predicts the agents of a group at parts of the speed that they request.

    Attributes:
        ahead: The horizon, in steps of the world.
        windows: The windows of the invariants of the specifications.
    """

    uncaptured: ClassVar[Collection[str]] = "*"  # no state between calls

    def __init__(self, group: AgentGroup, specifications: Sequence[str], horizon: float, tail: Tail) -> None:
        """Prepare.

        Args:
            group: The group; its model is linear.
            specifications: The names of the specifications to keep.
            horizon: The time for which speeds are expected to be held [s].
            tail: The assumption about the distribution of deviations.

        Raises:
            ValueError: The rest of the run cannot be predicted: its end is unknown, or it is too long.
        """
        environment = group.surroundings.environment
        self._group = group
        self._tail = tail
        self._step = environment.time_step
        self.ahead = max(1, round(nanoseconds(horizon) / self._step))
        self.windows = InvariantWindows(group, specifications, self._step)
        self._scope = PredictedAgentScope(group, environment, environment.groups, group.regions)
        self._noise = group.model.noise_covariance(self._step / SECOND)
        self._others = OthersAhead(group)
        self._rests = self._stays()
        #: The candidates: parts of the speed, and for how many steps they are held.
        self._factors = np.concatenate([FACTORS, FACTORS[1:]])
        self._held = np.concatenate([np.full(len(FACTORS), 1), np.full(len(FACTORS) - 1, self.ahead)])

    def of(self, requested: Array, now: int, allowed: Array) -> RiskOfSpeeds:
        """Return the risk of going on at each of the `FACTORS` of the requested speed, and stopping then.

        Args:
            requested: The control inputs that are requested; shape (n, nu).
            now: The present time [ns].
            allowed: The risk that may be taken; shape (n,).
        """
        group, count, choices = self._group, len(self._group), len(self._factors)
        end = group.surroundings.clock.end
        firsts, lasts = self.windows.spans(now, end)
        far = int(lasts.max(initial=now))
        steps = (far - now) // self._step
        dense = min(steps, self.ahead) if self._rests else steps
        if end is None:
            raise ValueError("`maximal_risk` is about the whole run, whose end is not known")
        if dense > MOST_STEPS:
            raise ValueError(
                f"the rest of the run has {dense:,} steps, more than the {MOST_STEPS:,} that are predicted"
            )
        times = now + self._step * np.arange(1, dense + 1)
        counting = self.windows.counting(times, now, end)
        agents, held = np.repeat(np.arange(count), choices), np.tile(self._held, count)
        states, requests = group.awareness.state[agents], requested[agents]
        chosen = np.tile(self._factors, count)
        size = states.shape[1]
        believed = state_covariance(group)
        covariance = np.zeros((len(agents), size, size)) if believed is None else believed[agents]
        others = [None if each is None else self._others.now(each) for each in self.windows.others]
        passages = [FirstPassage(self._tail) for _ in others]
        following = np.zeros(len(agents))
        summed, exceeds = np.zeros(len(agents)), np.full(len(agents), now + self._step)
        limit, inputs = allowed[agents], self._inputs(states, requests, chosen)

        def add(place: int, instants: Array, counts: Array, transition: Array) -> Array:
            each, other = self.windows.invariants[place], others[place]
            expected = ExpectedMotion(instants / SECOND, states, inputs, agents)
            if other is None:
                moments, moves = expected.moments(covariances, self._scope), transition
            else:
                seen = self._of_candidates(other, instants, held, count)
                moments = seen.moments(states, covariances, group.model.position)
                moves, counts = self._with_other(transition, seen), np.where(seen.known, counts, 0)
            sides = each.condition.half_spaces(moments)
            # s A, without a library whose sums depend on the number of rows.
            carried = np.stack(
                [(sides.slopes * moves[None, :, :, column]).sum(axis=2) for column in range(moves.shape[2])], axis=2
            )
            return each.weight * passages[place].add(sides, moments.mean, moments.covariance, carried, counts)

        for number, time in enumerate(times.tolist()):
            factors = np.where(number < held, chosen, 0.0)
            # The first control input is known; later ones answer to the state.
            applied = inputs if number == 0 else self._inputs(states, requests, factors)
            after = self._after(states, applied)
            transition = np.empty(covariance.shape)
            for column, unit in enumerate(np.eye(size)):
                moved = states + unit
                answer = applied if number == 0 else self._inputs(moved, requests, factors)
                transition[:, :, column] = self._after(moved, answer) - after
            states, covariance, inputs = after, propagated(covariance, transition), applied
            if self._noise is not None:
                covariance = covariance + self._noise
            covariances = covariance
            for place in range(len(passages)):
                if counting[place].any():
                    counts = counting[place, agents, number].astype(float)
                    summed = summed + add(place, np.full(len(agents), time), counts, transition)
            if number == 0:
                following = np.minimum(summed, 1.0)
            exceeds = np.where(summed <= limit, time + self._step, exceeds)
        if dense < steps:
            reached = now + self._step * dense
            for place in range(len(passages)):
                last = lasts[place, agents]
                counts = np.maximum((last - np.maximum(firsts[place, agents], reached)) // self._step, 0)
                counts = np.where(firsts[place, agents] > reached, counts + (last >= firsts[place, agents]), counts)
                if not counts.any():
                    continue
                covariances = covariance
                if self._noise is not None:
                    further = (np.maximum(last - reached, 0) // self._step).astype(float)
                    covariances = covariance + further[:, None, None] * self._noise
                identity = np.broadcast_to(np.eye(size), covariance.shape)
                add(place, np.maximum(last, reached), counts.astype(float), identity)
        exceeds = np.minimum(exceeds, far).reshape(count, choices)
        risks = [
            np.zeros(len(agents)) if each.is_empty else invariant.weight * each.risk
            for each, invariant in zip(passages, self.windows.invariants, strict=True)
        ]
        total = np.minimum(np.sum(risks, axis=0), 1.0).reshape(count, choices)
        alone, longer = slice(0, len(FACTORS)), slice(len(FACTORS), None)
        return RiskOfSpeeds(
            stopping=total[:, alone],
            holding=np.concatenate([total[:, :1], total[:, longer]], axis=1),
            next=following.reshape(count, choices)[:, alone],
            worst=np.argmax(risks, axis=0).reshape(count, choices)[:, alone],
            exceeds=exceeds[:, alone],
            remaining=((lasts.max(axis=0, initial=now) - now) // self._step).astype(np.intp),
        )

    def _of_candidates(
        self, other: Callable[[Array, int], OtherPositions], instants: Array, held: Array, count: int
    ) -> OtherPositions:
        """Return where the other of each candidate is expected: it moves as long as the candidate does."""
        rows = len(instants) // count
        # All candidates of an agent have the same instants.
        short, long = (
            other(instants[::rows], steps * self._step).take(np.repeat(np.arange(count), rows))
            for steps in (1, self.ahead)
        )
        return long.where(held > 1, short)

    def _with_other(self, transition: Array, seen: OtherPositions) -> Array:
        """Return transitions of the own state with the position of the other, NaN where that is none of its own."""
        rows, size = transition.shape[:2]
        width = seen.mean.shape[1]
        found = np.zeros((rows, size + width, size + width))
        found[:, :size, :size] = transition
        found[:, range(size, size + width), range(size, size + width)] = np.where(seen.is_drifting, np.nan, 1.0)[
            :, None
        ]
        return found

    def _stays(self) -> bool:
        """Return whether an agent that stops stays where it is, and so do all deviations."""
        model = self._group.model
        states = np.concatenate([np.zeros((1, len(model.state))), np.eye(len(model.state))])
        still = self._inputs(states, np.zeros((len(states), len(model.control_input))), np.zeros(len(states)))
        return bool(np.array_equal(self._after(states, still), states))

    def _inputs(self, states: Array, requested: Array, factors: Array) -> Array:
        model = self._group.model
        return model.limit(model.slowed(states, requested, factors))

    def _after(self, states: Array, inputs: Array) -> Array:
        return integrate(self._group.model, states, inputs, self._step / SECOND)
