"""The sections of specifications and of their offers."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field, model_validator

from symaware_cli.core.identifiers import Name, Target
from symaware_cli.language.section import Identifier, Section, TriggerSection
from symaware_cli.world import Seconds


class OfferSection(Section):
    """How a specification is offered to agents during the run."""

    at: Seconds | TriggerSection = Field(
        description="When it is offered [s]; or an event: then it is offered at the next step after the event has "
        "fired for the first time."
    )
    open_for: float | None = Field(
        None,
        gt=0,
        le=1e9,
        description="Time to accept it, from the offer and from each time at which it becomes open again "
        "[s]. Then it is rejected. The rest of the run if left out.",
    )
    epsilon: float | None = Field(
        None, gt=0, le=1, description="The probability with which the agent that accepts it may fail it."
    )
    to: Target | list[Target] | None = Field(
        None,
        description="Agents that get it in the knowledge `offers`: a group, or a list of ids and groups. By default "
        "the agents of `each`. Others learn of it by messages.",
    )
    knowledge: dict[Name, Any] = Field(
        default_factory=dict, description="Data of the offer, as plain values by name, such as `goal: [3, 4]`."
    )


class SpecificationUse(Section):
    """A formula that is monitored during the run."""

    formula: str = Field(
        max_length=2000,
        description="Formula to hold, such as `always (inside(position, arena) and nearest > 0.6)`. Operators: always, "
        "eventually, until, once, historically and since, each with a window in seconds such as [0, 5] if it is to be "
        "limited; next, and, or, not, implies.",
    )
    each: Name | None = Field(None, description="The group whose agents each have a verdict.")
    pairs: Target | list[tuple[Target, Target]] | None = Field(
        None,
        description="The pairs of agents that each have a verdict: a group, for all pairs in it, or a list of "
        "pairs [first, second] of ids or groups. Without `each` and `pairs` the formula is about the world.",
    )
    of: Literal["truth", "belief", "awareness"] = Field(
        "truth",
        description="truth: the formula is about true values; belief: about the beliefs of each agent; awareness: "
        "about beliefs of the first agent of each pair about the second, and true values.",
    )
    logic: Literal["stl", "ltl"] = Field(
        "stl",
        description="stl: signal temporal logic, with windows and robustness. ltl: linear temporal logic, without "
        "both; what is undecided is presumed to be satisfied or violated.",
    )
    where: dict[Identifier, str] = Field(
        default_factory=dict, description="Named formulas, which later ones and the formula itself may refer to."
    )
    from_: Seconds | TriggerSection = Field(
        0.0,
        alias="from",
        description="When the formula is to hold [s]; or an event: then it is to hold from each time the event fires.",
    )
    to: Seconds | None = Field(None, description="The last instant that counts [s]; the end of the run if left out.")
    offer: OfferSection | None = Field(
        None,
        description="It is not in force by itself, but offered during the run: it is about the one agent of "
        "`each` that accepts it. It is to hold from `from`, by default from when it was first offered, whenever that "
        "agent accepts.",
    )
    on_violation: Literal["continue", "end", "event"] = Field(
        "continue",
        description="The effect of a violation: the run continues; ends; or continues with a warning. In every "
        "case an event `violated` fires, on which components can take turns.",
    )
    interval: bool = Field(
        True,
        description="Whether to compute, before the verdict, the interval that the robustness lies in. Leaving it out "
        "saves time.",
    )

    @model_validator(mode="after")
    def _is_of_one_scope(self) -> Self:
        if self.each is not None and self.pairs is not None:
            raise ValueError("give either `each` or `pairs`")
        if self.of == "belief" and self.each is None:
            raise ValueError("beliefs are those of agents: name their group with `each`")
        if self.of == "awareness" and self.pairs is None:
            raise ValueError("awareness is of one agent about another: name them with `pairs`")
        if self.to is not None and not isinstance(self.from_, TriggerSection) and self.to < self.from_:
            raise ValueError("`to` comes before `from`")
        if self.offer is not None:
            self._check_offer(self.offer)
        return self

    def _check_offer(self, offer: OfferSection) -> None:
        if self.each is None:
            raise ValueError("an offered specification is accepted by an agent: name its group with `each`")
        if isinstance(self.from_, TriggerSection):
            raise ValueError("an offered specification begins with the offer or at a time: make the event `offer.at`")
        if isinstance(offer.at, TriggerSection):
            return
        if "from_" in self.model_fields_set and self.from_ < offer.at:
            raise ValueError("`from` comes before `offer.at`")
        if self.to is not None and self.to < offer.at:
            raise ValueError("`to` comes before `offer.at`")
