"""What `control.stl` plans for, and the plans that agents follow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from pydantic import Field, model_validator

from symaware_cli.core import Parameters
from symaware_cli.geometry import Array
from symaware_cli.planning.control.stl_chance import ChosenSides, RemainingRisk
from symaware_cli.planning.risk.state_conditions import Tail


class StlParameters(Parameters):
    """The specifications to plan for, and the settings of plans."""

    specifications: list[str] = Field(
        min_length=1, description="The specifications to satisfy: of the group's agents, and linear in the state."
    )
    horizon: float | None = Field(
        None,
        gt=0,
        description="How far ahead to plan [s]; what lies beyond counts as satisfied. If null, as far as the"
        " longest part of the specifications that has an end; to the end of the run if none has, or if a part"
        " without an end requires more than that something holds always.",
    )
    interval: float = Field(
        1.0, ge=0, description="Time between two searches [s], if the agent leaves its plan, or that is not whole."
    )
    hold: int = Field(1, ge=1, le=1000, description="For how many steps of the world a control input is held.")
    robustness: float = Field(
        0.001, ge=0, description="Least robustness of each specification, in the unit of its predicates."
    )
    robustness_weight: float = Field(
        1.0, ge=0, description="Reward for robustness beyond that, of the specification that has least of it."
    )
    effort_weight: float = Field(
        0.001, ge=0, description="Cost of the square of each element of the control input, in each step."
    )
    maximal_risk: float | None = Field(
        None,
        gt=0,
        lt=1,
        description="The greatest probability that one of the `specifications` is violated in the run.",
    )
    risk_bound: Tail = Field(
        "normal",
        description="With `maximal_risk`, what is assumed about noise: that it is normal, or nothing but its"
        " covariance.",
    )
    deviations: float = Field(
        0.0,
        ge=0,
        description="Standard deviations of the model's noise by which margins are reduced: the weight of risk.",
    )
    noise_horizon: float = Field(
        1.0, gt=0, description="The noise of this time adds up in `deviations`; what follows is corrected [s]."
    )
    bounds: dict[str, tuple[float, float]] = Field(
        default={}, description="Least and greatest value of elements of the state, by name."
    )
    nodes: int = Field(2_000, ge=1, description="Limit of a search: the nodes of its tree.")
    gap: float = Field(
        1e-3, ge=0, description="A plan is good enough if the best is better by at most this, in units of the cost."
    )
    fallback: Literal["last-plan", "slow-down"] = Field(
        "last-plan", description="What to do without a plan: follow the rest of the last one, or slow down at once."
    )

    @model_validator(mode="after")
    def _risk_of_the_run(self) -> Any:
        if self.maximal_risk is not None and self.horizon is not None:
            raise ValueError(
                "with `maximal_risk` plans lead to the end of the specifications or of the run, as the risk is one"
                " of the whole run; leave `horizon` out"
            )
        if self.maximal_risk is not None and self.deviations:
            raise ValueError("`maximal_risk` determines the margins; leave `deviations` out")
        return self


class FollowedPlan(NamedTuple):
    """The plan that an agent follows.

    Attributes:
        states: The states from `made` on, one at each step; shape (N + 1, nx).
        inputs: The control inputs; shape (N, nu).
        made: The instant at which it was made [ns].
        searched: The instant at which its alternatives were chosen [ns].
        aims: The specifications that it is to satisfy, with the instants that they are about.
        is_whole: Whether it leads to the last instant that the specifications are about.
        robustness: The least robustness of the specifications if the run ended with the plan.
        gap: A bound on the improvement of the best plan over it, in units of the cost.
        sides: The half spaces in which it is to keep the state, with `maximal_risk`.
        unassigned: The part of the greatest risk that was left when it was made.
        expected: The positions at which it expects other agents, by id; each of shape (N + 1, d).
    """

    states: Array
    inputs: Array
    made: int
    searched: int
    aims: tuple[tuple[str, int], ...]
    is_whole: bool
    robustness: float
    gap: float
    sides: ChosenSides | None = None
    unassigned: float = 0.0
    expected: Mapping[str, Array] = {}


class StlDecision(NamedTuple):
    """The result of a turn.

    Attributes:
        control_input: The control input to request; shape (nu,).
        plan: The plan to follow; None if there is none.
        status: The result of the search for a new plan: a status of a program, ``followed`` without a search, or
            ``done`` if nothing is left to be satisfied.
        gap: The gap of the search.
        conflict: The specifications that cannot be satisfied together, if a search ended just now for that reason.
        risk: The risk of the rest of the plan, with `maximal_risk`.
        allowed: The greatest risk that a search could take.
    """

    control_input: Array
    plan: FollowedPlan | None
    status: str
    gap: float = 0.0
    conflict: tuple[str, ...] = ()
    risk: RemainingRisk | None = None
    allowed: float = 1.0
