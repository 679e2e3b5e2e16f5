"""Risk as the probability that specifications fail, estimated by sampling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import AgentGroup, GroupComponent, Parameters, Quantity, Signal, Tracks
from symaware_cli.engine import REGION, interpolated, predicted_positions, state_covariance
from symaware_cli.geometry import Array, Indices, Mask
from symaware_cli.planning.risk.failure_bound import BoundedSpecification, bounded, failure_bounds, is_linear
from symaware_cli.planning.risk.sampled_motion import MotionPlan, OtherMotion, SampledMotion, SampledNoise, root
from symaware_cli.specification import (
    Forecast,
    PredictedAgentScope,
    PredictedPairScope,
    Scope,
    Specification,
    SpecificationMonitor,
    monitor_of,
)
from symaware_cli.specification.columns import Lookup
from symaware_cli.specification.formula import Formula, Not, Predicate, operands
from symaware_cli.specification.node import Comparison, Name, Node, walk
from symaware_cli.world import SECOND, combined, nanoseconds

#: The most rows of predicted states that are computed at a time; they fit into the processor's cache.
_ROWS = 30_000


class RiskEstimate(NamedTuple):
    """The result of a turn.

    Attributes:
        risk: The probability that a specification fails; shape (n,).
        error: Its standard error, 0 for bounds; shape (n,).
    """

    risk: Array
    error: Array


class _Prediction(NamedTuple):
    """The prediction of a specification for the rows of its scope.

    Attributes:
        forecast: The forecast.
        look_up: Returns the predicted values of names.
        ids: The ids of the agents that each row is about.
        agents: The row of the group that each row belongs to, ascending; shape (m,).
    """

    forecast: Forecast
    look_up: Lookup
    ids: Sequence[tuple[str, ...]]
    agents: Indices


class FailureProbability(GroupComponent):
    """Risk as the probability that a specification of an agent fails within a horizon, estimated by sampling.

    Each agent predicts its own motion many times, and that of the others that it is aware of, from its beliefs: it
    begins with a sample of its state (the uncertainty, if an estimator provides it), follows its intent or, without
    one, keeps its control input, and is disturbed by the process noise of its model. Others follow the intent that
    they told of, or keep their velocities; their positions and velocities are samples of the tracks. The monitors of
    the specifications continue on each prediction. The risk is the share of predictions on which one of them fails.

    Others who are known to stay in a set, as from a promise, are expected there, and the risk is increased by the
    declared probability that they leave it.

    The standard error is that of the share after two failures and two successes more (A. Agresti and B. A. Coull,
    "Approximate is better than 'exact' for interval estimation of binomial proportions", The American Statistician 52,
    1998), so that it does not vanish where no sample fails.
    """

    sees_world = True
    specifications = "specifications"
    signals = (Signal("standard_error", columns=[Quantity("standard_error", "1")], description="of the risk"),)

    class Parameters(Parameters):
        """What may fail, and how it is predicted."""

        specifications: list[str] = Field(
            min_length=1, description="The specifications of the group's agents, or of pairs of agents, that may fail."
        )
        method: Literal["sampling", "normal", "chebyshev"] = Field(
            "sampling",
            description="How the probability is found: by sampling; as a bound that is never below it, if the state is "
            "normal; or as a bound whatever its distribution is, by its mean and covariance.",
        )
        others: Literal["tracks", "regions"] = Field(
            "tracks",
            description="Where others are: at samples of the tracks, from which they are predicted; or anywhere in the "
            "regions that `uncertainty.conformal` writes, to whose nearest points they keep. The risk is then at least "
            "the probability that they leave these.",
        )
        horizon: float = Field(2.0, gt=0, description="How far ahead to look [s].")
        samples: int = Field(100, ge=1, le=100_000, description="How many predictions each agent makes, if it samples.")
        reach: float = Field(10.0, gt=0, description="Others farther away are not predicted [m].")
        follow_intents: bool = Field(
            True,
            description="Whether agents are expected to follow their intents, instead of keeping their velocities.",
        )
        correction: float = Field(
            0.0, ge=0, description="How strongly an agent corrects deviations from its intent, as a velocity [1/s]."
        )

    def check(self, group: AgentGroup) -> None:
        """Check that the model can follow an intent."""
        if self.parameters.follow_intents:
            group.model.follow_velocity(group.initial_state, np.zeros((len(group), len(group.model.position))))
        if self.parameters.method != "sampling" and not is_linear(group.model):
            raise ValueError("only `method: sampling` works with a model that is not linear")
        if self.parameters.others == "regions" and REGION.name not in group.awareness.parts:
            raise ValueError("`others: regions` takes the regions of an `uncertainty.conformal`, and there is none")

    def check_specification(self, specification: Specification, group: AgentGroup) -> None:
        """Check that each predicate has a bound or a worst case, if that is asked for."""
        if self.parameters.method != "sampling":
            bounded(specification, group)
        if self.parameters.others == "regions":
            check_worst_case(specification)

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare the risk as one number without a unit."""
        return {"risk": [Quantity("risk", "1")]}

    def initialise_component(self, group: AgentGroup) -> None:
        """Prepare the monitors for forecasts."""
        super().initialise_component(group)
        self._scope = PredictedAgentScope(group, self.environment, self.environment.groups, group.regions)
        self._monitors = [monitor_of(group, name) for name in self.parameters.specifications]
        for monitor in self._monitors:
            monitor.is_continued = True
        self._bounded = (
            []
            if self.parameters.method == "sampling"
            else [BoundedSpecification(each, bounded(each.specification, group)) for each in self._monitors]
        )
        self._rows = {
            monitor.specification.name: _rows(monitor.specification.scope)
            for monitor in self._monitors
            if monitor.specification.each is None
        }
        names = {
            node.name
            for monitor in self._monitors
            for node in walk(monitor.specification.formulation.tree)
            if isinstance(node, Name)
        }
        regions = [group.regions[name] for name in names if name in group.regions]
        self._needs_others = (
            "nearest" in names
            or any(region.around for region in regions)
            or any(monitor.specification.each is None for monitor in self._monitors)
        )

    def _compute(self) -> RiskEstimate:
        parameters, group, environment = self.parameters, self._group, self.environment
        samples, step, now = parameters.samples, environment.time_step, self.now
        first = -(-now // step) * step
        count = max(1, round(nanoseconds(parameters.horizon) / step)) + 1
        instants = [first + number * step for number in range(count)]
        intended, has_intent = self._intended([now, *instants])
        durations = np.diff([now, *instants]) / SECOND
        plan = MotionPlan(durations, self._spreads(durations), intended, has_intent, parameters.correction)
        covariance = state_covariance(group)
        if parameters.method != "sampling":
            motion = SampledMotion(group, slice(0, len(group)), 1, plan, None)
            limit = failure_bounds(self._bounded, group, motion, covariance, instants, self._scope, parameters.method)
            risk = limit if group.present is None else np.where(group.present, limit, 0.0)
            return RiskEstimate(risk, np.zeros(len(group)))
        spread = None if covariance is None else root(covariance)
        roster = environment.roster
        start = roster.start(group.name)
        numbers = roster.numbers[start : start + len(group)]
        seed, turn, path = self._surroundings.seed, self.turn, f"component {self.name}"
        width = len(group.model.state)
        noise = SampledNoise(seed, path, turn, numbers, count + 1, width, samples)
        others = self._others(instants, numbers) if self._needs_others else None
        chunk = max(1, _ROWS // samples)
        fails = np.zeros(len(group))
        for begin in range(0, len(group), chunk):
            agents = slice(begin, min(begin + chunk, len(group)))
            motion = SampledMotion(group, agents, samples, plan, spread, noise, others)
            fails[agents] = self._fails(motion, agents, instants, others)
        present = group.in_world
        fails[~present] = 0.0
        shrunk = (fails + 2.0) / (samples + 4.0)
        risk = fails / samples
        if others is not None and others.regions is not None:
            # Whatever happens where others leave their regions: Boole's inequality.
            risk = np.where(present, np.minimum(risk + others.regions.misses, 1.0), 0.0)
        elif others is not None:
            for confined in group.confined(others.tracks):
                risk = np.where(present, np.minimum(risk + confined.leave(others.tracks), 1.0), 0.0)
        return RiskEstimate(risk, np.sqrt(shrunk * (1.0 - shrunk) / (samples + 4.0)))

    def _update(self, value: RiskEstimate) -> None:
        self._group.awareness.risk.set(self.computed_at, value.risk)
        self.record(self.signals[0], value.error[:, None])

    def _fails(
        self, motion: SampledMotion, agents: slice, instants: Sequence[int], others: OtherMotion | None
    ) -> Array:
        """Return on how many predictions of each agent a specification fails; shape (agents,)."""
        group, samples = self._group, self.parameters.samples
        own = self._scope.of(motion)
        predictions = []
        for monitor in self._monitors:
            if monitor.specification.each is not None:
                rows, ids = np.arange(agents.start, agents.stop), [(id,) for id in group.ids[agents]]
                predictions.append(_Prediction(Forecast(monitor, rows, samples), own.look_up, ids, rows))
            elif others is not None:
                predictions.append(self._of_pairs(monitor, motion, agents, others.tracks))
        for instant in instants:
            motion.advance(instant / SECOND)
            for each in predictions:
                each.forecast.look(instant, each.look_up, each.ids)
        failing = np.zeros((agents.stop - agents.start, samples), bool)
        for each in predictions:
            violated, places = each.forecast.verdicts < 0, each.agents - agents.start
            starts = np.flatnonzero(np.diff(places, prepend=-1))
            if len(starts):
                failing[places[starts]] |= np.logical_or.reduceat(violated, starts, axis=0)
        counts: Array = failing.sum(axis=1).astype(float)
        return counts

    def _of_pairs(
        self, monitor: SpecificationMonitor, motion: SampledMotion, agents: slice, tracks: Tracks
    ) -> _Prediction:
        """Return the prediction of a specification of pairs."""
        roster, group = self.environment.roster, self._group
        of_pair = self._rows[monitor.specification.name]
        first, last = tracks.pointers[agents.start], tracks.pointers[agents.stop]
        observers, other = tracks.observers[first:last], tracks.others[first:last]
        ids = [(group.ids[one], roster.ids[two]) for one, two in zip(observers.tolist(), other.tolist(), strict=True)]
        found = [of_pair.get(pair, (-1, False)) for pair in ids]
        chosen = np.array([place for place, (row, _) in enumerate(found) if row >= 0], np.intp)
        rows = np.array([found[place][0] for place in chosen], np.intp)
        swapped = np.array([found[place][1] for place in chosen], bool)
        scope = PredictedPairScope(self.environment, group.regions, motion, chosen, swapped)
        forecast = Forecast(monitor, rows, self.parameters.samples)
        return _Prediction(forecast, scope.look_up, [ids[place] for place in chosen], observers[chosen])

    def _intended(self, instants: Sequence[int]) -> tuple[Array | None, Mask]:
        """Return the intended positions of the agents, (n, len(instants), d), and who has an intent."""
        group = self._group
        nobody = np.zeros(len(group), bool)
        if not self.parameters.follow_intents:
            return None, nobody
        dimensions = len(group.model.position)
        column = group.awareness.intent
        shared = column.shared
        if shared is not None:
            times, values = shared
            if not len(times) or values.shape[2] < dimensions:
                return None, nobody
            return interpolated(times, values[:, :, :dimensions], instants), ~nobody
        intended = np.zeros((len(group), len(instants), dimensions))
        for row in range(len(group)):
            series = column.row(row)
            if len(series) and series.values.shape[1] >= dimensions:
                intended[row] = interpolated(series.times, series.values[None, :, :dimensions], instants)[0]
                nobody[row] = True
        return (intended if nobody.any() else None), nobody

    def _spreads(self, durations: Array) -> list[Array | None]:
        """Return the roots of the covariances of the process noise over durations."""
        of_duration: dict[float, Array | None] = {}
        for duration in set(durations.tolist()):
            covariance = self._group.model.noise_covariance(duration) if duration else None
            of_duration[duration] = None if covariance is None else root(covariance[None])
        return [of_duration[duration] for duration in durations.tolist()]

    def _others(self, instants: Sequence[int], numbers: NDArray[np.uint64]) -> OtherMotion:
        """Return the motion of other agents as predicted by each agent."""
        group, parameters, roster = self._group, self.parameters, self.environment.roster
        tracks = group.others(parameters.reach)
        if parameters.others == "regions":
            return OtherMotion.in_regions(group, tracks, instants)
        places = predicted_positions(group, tracks, self.now, instants, parameters.follow_intents)
        spread, noise = None, None
        if tracks.covariances is not None and len(tracks):
            spread = root(tracks.covariances)
            keys = combined(numbers[tracks.observers], roster.numbers[tracks.others], 0)
            seed, turn, path = self._surroundings.seed, self.turn, f"component {self.name} others"
            noise = SampledNoise(seed, path, turn, keys, 1, spread.shape[1], parameters.samples)
        return OtherMotion(tracks, places, spread, noise)


def _rows(scope: Scope) -> Mapping[tuple[str, ...], tuple[int, bool]]:
    """Return the row of each pair of agents, and whether it is named the other way round."""
    pairs = [scope.agents(row) for row in range(scope.rows)]
    turned = {pair[::-1]: (row, True) for row, pair in enumerate(pairs)}
    return turned | {pair: (row, False) for row, pair in enumerate(pairs)}


#: The names that grow with the distance of others.
_DISTANCES = frozenset({"distance", "nearest"})

#: The names that depend on others in another way, in specifications of pairs.
_OF_PAIRS = frozenset({"closing_speed", "position", "speed", "velocity"})


def check_worst_case(specification: Specification) -> None:
    """Check that the worst place of another in its region is the nearest one.

    Raises:
        ValueError: A predicate depends on others otherwise than by their distance, or fails where they are far away.
    """
    if specification.automaton is not None:
        raise ValueError("with `others: regions`, it must not be in linear temporal logic")
    moving = {name for name, each in specification.scope.regions.items() if each.region.around is not None}
    dependent = _DISTANCES | moving | (_OF_PAIRS if specification.each is None else frozenset())
    atoms = specification.formulation.atoms
    for index, is_positive in sorted(_polarities(specification.formulation.formula, is_positive=True)):
        node = atoms[index].node
        if _names(node) & dependent and not _is_worst_nearby(node, is_positive, dependent):
            raise ValueError(
                f"with `others: regions`, `{atoms[index].text}` has no worst place of another: predicates about others "
                "are comparisons such as `distance > 0.6` or `nearest > 0.6`, which hold if they are far away"
            )


def _is_worst_nearby(node: Node, is_positive: bool, dependent: frozenset[str]) -> bool:
    match node:
        case Comparison(operators=(operator,), operands=(left, right)) if operator in ("<", "<=", ">", ">="):
            greater, less = (left, right) if operator in (">", ">=") else (right, left)
            far, near = (greater, less) if is_positive else (less, greater)
            return isinstance(far, Name) and far.name in _DISTANCES and not _names(near) & dependent
    return False


def _names(node: Node) -> set[str]:
    return {each.name for each in walk(node) if isinstance(each, Name)}


def _polarities(formula: Formula, *, is_positive: bool) -> set[tuple[int, bool]]:
    """Return each predicate with whether the formula can only gain from its truth, or only lose."""
    match formula:
        case Predicate(index):
            return {(index, is_positive)}
        case Not(operand):
            return _polarities(operand, is_positive=not is_positive)
    return {found for each in operands(formula) for found in _polarities(each, is_positive=is_positive)}
