"""A controller that slows agents down by their risk, which it may predict for several speeds."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.components.control.steering import RequestFilter
from symaware_cli.components.risk.body_pairs import state_covariance
from symaware_cli.components.risk.failure_bound import is_linear
from symaware_cli.components.risk.invariants import ExpectedMotion, InvariantWindows, invariants
from symaware_cli.components.risk.state_conditions import Tail, propagated
from symaware_cli.core import AgentGroup, Level, Parameters, Quantity, Signal
from symaware_cli.geometry.vectors import Array, Indices
from symaware_cli.specification.predicted_scope import PredictedAgentScope
from symaware_cli.specification.specification import Specification
from symaware_cli.world.integration import integrate
from symaware_cli.world.time import SECOND, nanoseconds

#: The parts of the requested speed that are compared.
FACTORS: Array = np.linspace(0.0, 1.0, 21)


class RiskOfSpeeds(NamedTuple):
    """The risk at each of the `FACTORS`.

    Attributes:
        risks: Bounds of the probabilities that each invariant does not hold at each instant of the horizon; shape
            (invariants, instants, n, factors).
        share: The part of the remaining risk that the horizon may have; shape (n,).
    """

    risks: Array
    share: Array

    @property
    def total(self) -> Array:
        """Bounds of the risk over the horizon; shape (n, factors)."""
        total: Array = self.risks.sum(axis=(0, 1))
        return np.minimum(total, 1.0)

    @property
    def next(self) -> Array:
        """Bounds of the risk until the next instant; shape (n, factors)."""
        total: Array = self.risks[:, 0].sum(axis=0)
        return np.minimum(total, 1.0)


class SpeedRisk:
    """Predicts the agents of a group at parts of the speed that they request."""

    uncaptured: ClassVar[Collection[str]] = "*"  # no state between calls

    def __init__(self, group: AgentGroup, specifications: Sequence[str], horizon: float, tail: Tail) -> None:
        """Prepare.

        Args:
            group: The group; its model is linear.
            specifications: The names of the specifications to keep.
            horizon: How far ahead to look [s].
            tail: What is assumed about deviations.
        """
        environment = group.surroundings.environment
        self._group = group
        self._tail = tail
        self._step = environment.time_step
        self._steps = max(1, round(nanoseconds(horizon) / self._step))
        self._windows = InvariantWindows(group, specifications, self._step)
        self._scope = PredictedAgentScope(group, environment, environment.groups, group.regions)
        self._noise = group.model.noise_covariance(self._step / SECOND)

    def of(self, requested: Array, now: int) -> RiskOfSpeeds:
        """Return the risk of going on at each of the `FACTORS` of the requested speed over the horizon.

        Args:
            requested: The control inputs that are requested; shape (n, nu).
            now: The present time [ns].
        """
        group, count, choices = self._group, len(self._group), len(FACTORS)
        end = group.surroundings.clock.end
        times = now + self._step * np.arange(1, self._steps + 1)
        counting = self._windows.counting(times, now, end)
        remaining = self._windows.remaining(now, end)
        agents = np.repeat(np.arange(count), choices)
        states, requests = group.awareness.state[agents], requested[agents]
        factors = np.tile(FACTORS, count)
        size = states.shape[1]
        believed = state_covariance(group)
        covariance = np.zeros((len(agents), size, size)) if believed is None else believed[agents]
        applied = self._inputs(states, requests, factors)
        risks = np.zeros((len(self._windows.invariants), self._steps, count, choices))
        for number, time in enumerate(times.tolist()):
            # The first control input is known; later ones answer to the state.
            inputs = applied if number == 0 else self._inputs(states, requests, factors)
            after = self._after(states, inputs)
            transition = np.empty(covariance.shape)
            for column, unit in enumerate(np.eye(size)):
                moved = states + unit
                answer = applied if number == 0 else self._inputs(moved, requests, factors)
                transition[:, :, column] = self._after(moved, answer) - after
            states, covariance = after, propagated(covariance, transition)
            if self._noise is not None:
                covariance = covariance + self._noise
            instants = np.full(len(agents), time / SECOND)
            moments = ExpectedMotion(instants, states, inputs, agents).moments(covariance, self._scope)
            for place, each in enumerate(self._windows.invariants):
                counts = counting[place, :, number]
                if counts.any():
                    fails = each.condition.failure(moments, self._tail).reshape(count, choices)
                    risks[place, number] = np.where(counts[:, None], fails, 0.0)
        return RiskOfSpeeds(risks, np.minimum(1.0, self._steps / np.maximum(remaining, 1)))

    def unkept(self, risks: Array, allowed: float, now: int) -> tuple[str, float]:
        """Return the specification that is not kept, and the instant [s] from which on it is not.

        Args:
            risks: The risks of an agent at its speed; shape (invariants, instants).
            allowed: What their sum may be; it is more.
            now: The present time [ns].
        """
        total = np.cumsum(risks, axis=1)
        instant = int(np.flatnonzero(total.sum(axis=0) > allowed)[0])
        name = self._windows.invariants[int(total[:, instant].argmax())].specification
        return name, (now + (instant + 1) * self._step) / SECOND

    def _inputs(self, states: Array, requested: Array, factors: Array) -> Array:
        model = self._group.model
        return model.limit(model.slowed(states, requested, factors))

    def _after(self, states: Array, inputs: Array) -> Array:
        return integrate(self._group.model, states, inputs, self._step / SECOND)


class KeptRisk(NamedTuple):
    """The risk of violating specifications at the speed that is chosen.

    Attributes:
        of: The risk of all speeds.
        choice: Which of `FACTORS` is chosen; shape (n,).
        allowed: What the risk over the horizon may be; shape (n,).
        planned: What it is; shape (n,).
        next: The risk until the next step; shape (n,).
    """

    of: RiskOfSpeeds
    choice: Indices
    allowed: Array
    planned: Array
    next: Array


class RiskAware(RequestFilter):
    """Slows down the motion requested by the preceding controller where the risk is high.

    Declare it after a controller and a risk estimator. The speed is unchanged up to the risk ``caution``, decreases
    linearly to zero at ``bound``, and agents stand still above. It decreases at once but recovers at a limited rate: an
    agent that slows down is at less risk, and would otherwise alternate between starting and stopping at every step.
    The intent stays that of the controller: where the agent wants to go, not at which speed.

    With a ``maximal_risk`` it keeps the ``specifications`` of each agent instead, with a probability of a violation in
    the run of at most that, by the greatest of 21 parts of the requested speed at which the risk over the ``horizon``
    is small enough. It predicts the risk of each itself: the one that a risk estimator wrote is about a single speed.
    If it is too great at every speed, that with the least risk is chosen, and the event ``infeasible`` names the
    specification.
    """

    batchable = True
    specifications = "specifications"
    signals = (
        Signal(
            "risk_budget",
            columns=[Quantity("planned", "1"), Quantity("spent", "1")],
            description="the risk over the horizon, and that taken so far, of violating `specifications`",
        ),
    )

    events: ClassVar = {
        "slowed": "An agent began to go slower than it wants to, because of the risk.",
        "stopped": "An agent that was slowed stopped altogether, for the first time since.",
        "resumed": "An agent goes as fast as it wants to again.",
        "infeasible": "At no speed is the risk of `specification` small enough, from the instant `time` [s] on; once "
        "until it is.",
        "feasible": "There is such a speed again.",
    }

    class Parameters(Parameters):
        """Thresholds of the risk, and the rate of recovery."""

        caution: float = Field(0.3, ge=0, description="Risk above which to slow down.")
        bound: float = Field(0.7, gt=0, description="Risk from which on to stop.")
        recovery: float = Field(
            1.0, gt=0, description="Greatest rise of the part of the speed that is left, from 0 to 1 [1/s]."
        )
        specifications: list[str] = Field(
            default=[],
            description="The specifications of the agents to keep, each of which says `always` of linear predicates.",
        )
        maximal_risk: float | None = Field(
            None,
            gt=0,
            lt=1,
            description="The greatest probability that one of the `specifications` is violated in the run; then there"
            " is no `caution` and no `bound`.",
        )
        horizon: float = Field(1.0, gt=0, description="How far ahead to predict the risk of `specifications` [s].")
        risk_bound: Literal["normal", "chebyshev"] = Field(
            "normal",
            description="What is assumed about deviations: that they are normal, or nothing but their covariance.",
        )

        @model_validator(mode="after")
        def _caution_before_bound(self) -> RiskAware.Parameters:
            if self.caution >= self.bound:
                raise ValueError(f"caution ({self.caution:g}) must be less than bound ({self.bound:g})")
            return self

        @model_validator(mode="after")
        def _risk_of_something(self) -> RiskAware.Parameters:
            if (self.maximal_risk is None) != (not self.specifications):
                missing = "`specifications` to keep" if self.maximal_risk is not None else "a `maximal_risk`"
                raise ValueError(f"a chance constraint needs {missing} as well")
            if self.maximal_risk is not None and self.model_fields_set & {"caution", "bound"}:
                raise ValueError("`maximal_risk` replaces `caution` and `bound`")
            return self

    def __init__(self, parameters: Any = None) -> None:
        super().__init__(parameters)
        if self.parameters.maximal_risk is None:
            vars(self)["signals"] = ()  # nothing to record

    def check(self, group: AgentGroup) -> None:
        """Check that the model supports slowing down, and is linear where a risk is predicted."""
        if self.parameters.maximal_risk is not None and not is_linear(group.model):
            raise ValueError("`maximal_risk` works only with a model that is linear")
        state, count = group.initial_state, len(group)
        group.model.slowed(state, np.zeros((count, len(group.model.control_input))), np.full(count, 0.5))

    def check_specification(self, specification: Specification, group: AgentGroup) -> None:
        """Check that a specification can be kept."""
        invariants(specification, group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Start at full speed."""
        super().initialise_component(group)
        parameters = self.parameters
        self._speeds: SpeedRisk | None = None
        if parameters.maximal_risk is not None:
            self._speeds = SpeedRisk(group, parameters.specifications, parameters.horizon, parameters.risk_bound)
        #: The risk that each agent has taken so far, and whether it last kept the specifications.
        self._spent, self._keeps = np.zeros(len(group)), np.ones(len(group), bool)
        self._factor = np.ones(len(group))
        self._stopped = np.zeros(len(group), bool)
        self._last: int | None = None

    def _compute(self) -> tuple[Array, Array, Array, KeptRisk | None]:
        group, parameters = self._group, self.parameters
        elapsed = 0.0 if self._last is None else (self.now - self._last) / SECOND
        fastest = self._factor + parameters.recovery * elapsed
        requested = self._request()
        if self._speeds is None:
            kept, risk = None, self._risk()
            wanted = np.clip((parameters.bound - risk) / (parameters.bound - parameters.caution), 0.0, 1.0)
            factor = np.minimum(wanted, fastest)
        else:
            kept = self._kept(self._speeds, requested, fastest)
            factor = FACTORS[kept.choice]
        return requested, group.model.slowed(group.awareness.state, requested, factor), factor, kept

    def _kept(self, speeds: SpeedRisk, requested: Array, fastest: Array) -> KeptRisk:
        """Choose the greatest part of the speed with little enough risk, else that with the least."""
        step = self.environment.time_step
        if self._last is not None and self.now != self._last + step:
            raise ValueError("with `maximal_risk` it takes a turn at each step of the world, and it missed one")
        found = speeds.of(requested, self.now)
        total = found.total
        allowed = np.maximum(self.parameters.maximal_risk - self._spent, 0.0) * found.share
        reachable = fastest[:, None] + 1e-9 >= FACTORS
        small = reachable & (total <= allowed[:, None])
        greatest = len(FACTORS) - 1 - small[:, ::-1].argmax(axis=1)
        least = np.where(reachable, total, np.inf).argmin(axis=1)
        choice, rows = np.where(small.any(axis=1), greatest, least), np.arange(len(total))
        return KeptRisk(found, choice, allowed, total[rows, choice], found.next[rows, choice])

    def _update(self, value: tuple[Array, Array, Array, KeptRisk | None]) -> None:
        requested, slowed, factor, kept = value
        self._replace(requested, slowed)
        self._last = self.computed_at
        self._emit_changes(factor, None if kept is None else kept.of.total[:, -1])
        self._factor = factor
        if kept is not None:
            self._spent = self._spent + kept.next
            self.record(self.signals[0], np.stack([kept.planned, self._spent], axis=1))
            self._emit_feasibility(kept)

    def _emit_feasibility(self, kept: KeptRisk) -> None:
        """Emit events for agents that keep the specifications no longer, or again."""
        keeps, speeds = kept.planned <= kept.allowed, self._speeds
        assert speeds is not None
        for row in np.flatnonzero(keeps != self._keeps).tolist():
            risk, allowed = float(kept.planned[row]), float(kept.allowed[row])
            if keeps[row]:
                self.emit_for(row, "feasible", "goes at a speed with little enough risk again", risk=risk)
                continue
            name, time = speeds.unkept(kept.of.risks[:, :, row, kept.choice[row]], allowed, self.now)
            self.emit_for(
                row,
                "infeasible",
                f"at no speed is `{name}` kept from {time:g} s on: a risk of {risk:.2g}, of which {allowed:.2g} is "
                f"left; goes at {FACTORS[kept.choice[row]]:.0%} of its speed, which has the least",
                level=Level.WARNING,
                specification=name,
                time=time,
                risk=risk,
                allowed=allowed,
            )
        self._keeps = keeps

    def _emit_changes(self, factor: Array, risk: Array | None) -> None:
        """Emit events for agents that slow down, stop or resume, because of a risk; None for the estimated one."""
        before = self._factor
        stopped = (factor <= 0.0) & ~self._stopped
        changed = ((factor < 1.0) != (before < 1.0)) | stopped
        if not changed.any():
            return
        risk = self._risk() if risk is None else risk
        for row in np.flatnonzero(changed).tolist():
            if factor[row] < 1.0 <= before[row]:
                self.emit_for(row, "slowed", f"slowed down at a risk of {risk[row]:.2g}", risk=float(risk[row]))
            if stopped[row]:
                self.emit_for(row, "stopped", f"stopped at a risk of {risk[row]:.2g}", risk=float(risk[row]))
            if factor[row] >= 1.0:
                self.emit_for(row, "resumed", "goes at full speed again")
        self._stopped = (self._stopped | stopped) & (factor < 1.0)

    def _risk(self) -> Array:
        """Return the greatest risk in each agent's series; 0 if none is estimated; shape (n,)."""
        column = self._group.awareness.risk
        shared = column.shared
        if shared is not None:
            greatest: Array = shared[1].reshape(len(self._group), -1).max(axis=1)
            return greatest
        # A component of single agents wrote these, with Python objects for each agent anyway.
        series = [column.row(row).values for row in range(len(self._group))]
        return np.array([values.max() if values.size else 0.0 for values in series])
