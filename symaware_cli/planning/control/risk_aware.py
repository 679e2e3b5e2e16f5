"""A controller that slows agents down by their risk, which it may predict for several speeds."""

from __future__ import annotations

from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.core import AgentGroup, Level, Parameters, Quantity, ScenarioView, Signal
from symaware_cli.engine import RequestFilter, require_known_states
from symaware_cli.geometry import Array, Indices
from symaware_cli.planning.control.speed_risk import FACTORS, RiskOfSpeeds, SpeedRisk
from symaware_cli.planning.risk.failure_bound import is_linear
from symaware_cli.planning.risk.invariants import invariants
from symaware_cli.planning.risk.risk_budget import RiskBudget
from symaware_cli.specification import Specification
from symaware_cli.world import SECOND


class KeptRisk(NamedTuple):
    """The risk of violating specifications at the speed that is chosen.

    Attributes:
        of: The risk of all speeds.
        choice: The index in `FACTORS` of the chosen speed; shape (n,).
        allowed: The maximum risk of the rest of the run; shape (n,).
        planned: The risk of the rest of the run at the chosen speed; shape (n,).
        budget: The account after the turn.
    """

    of: RiskOfSpeeds
    choice: Indices
    allowed: Array
    planned: Array
    budget: RiskBudget


class RiskAware(RequestFilter):
    """Slows down the motion requested by the preceding controller where the risk is high.

    Declare it after a controller and a risk estimator. The speed is unchanged up to the risk ``caution``, decreases
    linearly to zero at ``bound``, and agents stand still above. It decreases at once but recovers at a limited rate: an
    agent that slows down is at less risk, and would otherwise alternate between starting and stopping at every step.
    The intent stays that of the controller: where the agent wants to go, not at which speed.

    With a ``maximal_risk`` it keeps the ``specifications`` of each agent instead, with a probability of a violation in
    the run of at most that, by the greatest of 21 fractions of the requested speed that it can afford. It can afford a
    speed if the risk of driving on at it, of then stopping, and of standing until the end of the run is small enough:
    so it can always afford to stop. It predicts the risk of each speed itself: the risk from a risk estimator is about
    a single speed. If even stopping is too risky at the beginning, the speed with the least risk is chosen, and the
    event ``infeasible`` names the specification and the spent risk.

    Specifications may be about pairs, such as ``always distance > 1``. Others are expected to keep their velocities as
    long as the agent, and to stop then; each of the two may take half of the risk.
    """

    batchable = True
    specifications = "specifications"
    signals = (
        Signal(
            "risk_budget",
            columns=[Quantity("planned", "1"), Quantity("spent", "1")],
            description="the risk of violating `specifications` in the rest of the run if it stops next, and that taken"
            " so far",
        ),
    )

    events: ClassVar = {
        "slowed": "An agent began to go slower than it wants to, because of the risk.",
        "stopped": "An agent that was slowed stopped altogether, for the first time since.",
        "resumed": "An agent goes as fast as it wants to again.",
        "infeasible": "At no speed is the risk of `specification` small enough, from the instant `time` [s] on: it is "
        "`risk`, where `allowed` is left and `spent` was taken; once until it is.",
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
            description="The specifications of the agents to keep, each of which says `always` of linear predicates, or"
            " of `distance` of pairs.",
        )
        maximal_risk: float | None = Field(
            None,
            gt=0,
            lt=1,
            description="The greatest probability that one of the `specifications` is violated in the run; then there"
            " is no `caution` and no `bound`.",
        )
        horizon: float = Field(
            1.0, gt=0, description="How long a speed must be affordable if it is held, before the agent stops [s]."
        )
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

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that states are known, which a maximal risk requires."""
        require_known_states(view)

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
        #: The risk of each agent, and whether it last kept the specifications.
        self._budget = RiskBudget.whole(parameters.maximal_risk or 0.0, len(group))
        self._keeps = np.ones(len(group), bool)
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
        found = speeds.of(requested, self.now, self._budget.unused)
        rest = found.stopping[:, 0]
        allowed = self._budget.allowed(rest)
        paced = self._budget.paced(rest, speeds.ahead, found.remaining)
        reachable = fastest[:, None] + 1e-9 >= FACTORS
        small = reachable & (np.maximum(found.stopping, found.holding) <= paced[:, None])
        greatest = len(FACTORS) - 1 - small[:, ::-1].argmax(axis=1)
        least = np.where(reachable, found.stopping, np.inf).argmin(axis=1)
        choice, rows = np.where(small.any(axis=1), greatest, least), np.arange(len(rest))
        planned = found.stopping[rows, choice]
        budget = self._budget.after(rest, planned, found.next[rows, choice], np.ones(len(rest), bool))
        return KeptRisk(found, choice, allowed, planned, budget)

    def _update(self, value: tuple[Array, Array, Array, KeptRisk | None]) -> None:
        requested, slowed, factor, kept = value
        self._replace(requested, slowed)
        self._last = self.computed_at
        self._emit_changes(factor, None if kept is None else kept.of.stopping[:, -1])
        self._factor = factor
        if kept is not None:
            self._budget = kept.budget
            self.record(self.signals[0], np.stack([kept.planned, kept.budget.spent], axis=1))
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
            choice, spent = kept.choice[row], float(kept.budget.spent[row])
            name = speeds.windows.invariants[kept.of.worst[row, choice]].specification
            time = float(kept.of.exceeds[row, choice]) / SECOND
            self.emit_for(
                row,
                "infeasible",
                f"at no speed is `{name}` kept from {time:g} s on: a risk of {risk:.2g}, of which {allowed:.2g} is "
                f"left and {spent:.2g} spent; goes at {FACTORS[choice]:.0%} of its speed, which has the least",
                level=Level.WARNING,
                specification=name,
                time=time,
                risk=risk,
                allowed=allowed,
                spent=spent,
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
