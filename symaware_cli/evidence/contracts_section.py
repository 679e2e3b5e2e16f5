"""The section `contracts` of scenarios: requirements on the awareness of agents.

Reasons: docs/decisions/0091-awareness-contracts.md
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from symaware_cli.core.identifiers import Name, Target
from symaware_cli.language import Additions, Identifier, ScenarioSection, Section, SectionContext, SpecificationUse
from symaware_cli.world import Seconds


class ContractUse(Section):
    """A formula about the beliefs of agents and the truth."""

    formula: str = Field(
        max_length=2000,
        description="Requirement on the awareness of one agent, `self`, of another, `other`, such as "
        "`always norm(belief(other) - truth(other)) < 0.5`.",
    )
    of: Target | list[Target] | None = Field(
        None,
        description="The agents whose awareness it is: a group, or a list of ids and groups. All agents if left out.",
    )
    about: Target | list[Target] | None = Field(
        None, description="The agents it is about: a group, or a list of ids and groups. All others if left out."
    )
    where: dict[Identifier, str] = Field(
        default_factory=dict, description="Named formulas, which later ones and the formula itself may refer to."
    )
    from_: Seconds = Field(0.0, alias="from", description="When the formula is to hold [s].")
    to: Seconds | None = Field(None, description="The last instant that counts [s]; the end of the run if left out.")
    on_violation: Literal["continue", "end", "event"] = Field(
        "continue", description="The effect of a breach: the run continues; ends; or continues with a warning."
    )


def _of_text(written: object) -> object:
    """Return the contract of a formula that is given alone."""
    return {"formula": written} if isinstance(written, str) else written


class ContractsSection(ScenarioSection):
    """Contracts by name, monitored like specifications."""

    form: ClassVar[Any] = dict[
        Name, Annotated[ContractUse, BeforeValidator(_of_text, json_schema_input_type=str | ContractUse)]
    ]
    description: ClassVar[str] = (
        "Awareness contracts by name: formulas over beliefs of agents and true values. They are monitored like "
        "`specifications`, and may be claimed beside them: `P(sees) > 0.99; P(safe | sees) > 0.999`."
    )

    def additions(self, written: Any, context: SectionContext) -> Additions:
        """Return a specification for each contract."""
        groups = sorted(context.document.agents)  # so that their order in a file has no effect
        return Additions(
            specifications={name: _stated(each, groups) for name, each in context.document.contracts.items()}
        )

    def build(self, written: Any, context: SectionContext) -> Mapping[str, ContractUse]:
        """Return the contracts."""
        return {} if context.document is None else context.document.contracts


def _stated(contract: ContractUse, groups: list[str]) -> SpecificationUse:
    """Return the specification of a contract, which is about each ordered pair of the agents that it names."""
    whose, whom = ([each] if isinstance(each, str) else each or groups for each in (contract.of, contract.about))
    return SpecificationUse.model_validate(
        {
            "formula": contract.formula,
            "pairs": [(one, other) for one in whose for other in whom],
            "of": "awareness",
            "where": contract.where,
            "from": contract.from_,
            "to": contract.to,
            "on_violation": contract.on_violation,
        }
    )
