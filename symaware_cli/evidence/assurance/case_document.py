"""The document of an assurance case: goals, strategies, context, assumptions and solutions (GSN)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from symaware_cli.language import Problem, ScenarioError, Section, nearest, read, validate
from symaware_cli.language.compose import Composition
from symaware_cli.studies import Claim

#: The version of the format that this package reads.
FORMAT = 1

Identifier = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9._-]*$", max_length=32)]
Text = Annotated[str, Field(min_length=1, max_length=1000)]
EvidencePath = Annotated[str, Field(min_length=1, max_length=500)]


class Argument(Section):
    """An element that is supported by others, within a context."""

    text: Text = Field(description="Text of the statement.")
    context: list[Identifier] = Field(
        default_factory=list, description="The context, the assumptions and the justifications that it refers to."
    )


class GoalUse(Argument):
    """A claim of the case."""

    by: list[Identifier] = Field(
        default_factory=list, description="Strategies, goals and solutions that support it. Undeveloped without any."
    )


class StrategyUse(Argument):
    """The argument by which goals follow from others."""

    by: list[Identifier] = Field(min_length=1, description="Goals that the strategy leads to.")


class SolutionUse(Section):
    """Evidence, by its file; paths are relative to the folder of the case."""

    text: Text | None = Field(None, description="Description of the evidence; by default its claim or specification.")
    certificate: EvidencePath | None = Field(None, description="A certificate in the folder of its sweep.")
    claim: str | None = Field(None, max_length=500, description="Claim that the certificate must establish at least.")
    falsification: EvidencePath | None = Field(
        None, description="A search without a finding: the output of `symaware falsify --json`."
    )
    log: EvidencePath | None = Field(None, description="The log of a run, which is repeated.")
    budget: EvidencePath | None = Field(None, description="The `budget.json` of a budget.")
    explanation: EvidencePath | None = Field(
        None, description="The explanation of a violation: the output of `symaware explain --json`."
    )
    cause: str | None = Field(
        None,
        min_length=1,
        max_length=500,
        description="The cause that the explanation must name, as it prints it; `none` if it must have found none.",
    )
    study: EvidencePath | None = Field(
        None, description="The `sweep.yaml` in the folder of a sweep with paired variants, such as an awareness study."
    )
    variant: str | None = Field(None, max_length=64, description="The variant that is compared with the first one.")
    column: str | None = Field(None, max_length=200, description="The column of the table in which they are compared.")
    difference: Literal["less", "greater"] | None = Field(
        None, description="Whether the values of the variant must be less or greater than those of the first one."
    )
    at_least: Any = Field(None, description="The level up to which the budget must be certified.")
    specification: str | None = Field(
        None,
        max_length=64,
        description="The specification that was searched for violations, or that the run satisfies.",
    )
    scenario: EvidencePath | None = Field(
        None, description="The scenario that the evidence must be about; by default that of the case."
    )

    @model_validator(mode="after")
    def _has_one_kind(self) -> Self:
        kinds = [each for each in KINDS if getattr(self, each) is not None]
        if len(kinds) != 1:
            raise ValueError(f"a solution names one of {', '.join(KINDS)}")
        needs = KINDS[kinds[0]]
        for name in dict.fromkeys(each for entries in KINDS.values() for each in entries):
            if (getattr(self, name) is not None) != (name in needs):
                word = "needs" if name in needs else "does not take"
                raise ValueError(f"a solution by a {kinds[0]} {word} `{name}`")
        if self.claim is not None:
            Claim.parse(self.claim)
        return self

    @property
    def kind(self) -> str:
        """The kind of evidence, one of `KINDS`."""
        return next(each for each in KINDS if getattr(self, each) is not None)

    @property
    def path(self) -> str:
        """The file of the evidence."""
        return str(getattr(self, self.kind))

    @property
    def shown(self) -> str:
        """The text of the evidence in pictures and tables."""
        match self.kind:
            case "budget":
                said = f"certified up to {self.at_least}"
            case "explanation":
                said = f"cause of {self.specification}: {self.cause}"
            case "study":
                said = f"{self.column} {self.difference} with {self.variant}"
            case _:
                said = self.claim or str(self.specification)
        return self.text or said


#: The kinds of evidence, each with the entries that a solution of this kind needs.
KINDS: Mapping[str, tuple[str, ...]] = {
    "certificate": ("claim",),
    "falsification": ("specification",),
    "log": ("specification",),
    "budget": ("at_least",),
    "explanation": ("specification", "cause"),
    "study": ("variant", "column", "difference"),
}


class CaseDocument(Section):
    """An assurance case for `symaware assure`, in the terms of the Goal Structuring Notation."""

    symaware_case: Literal[1] = Field(alias="symaware-case", description="Version of the format of assurance cases.")
    name: str = Field(min_length=1, max_length=200, description="Subject of the case.")
    scenario: EvidencePath | None = Field(None, description="The scenario that all evidence must be about.")
    goals: dict[Identifier, GoalUse] = Field(
        min_length=1, description="Goals by identifier; the first is the top goal."
    )
    strategies: dict[Identifier, StrategyUse] = Field(default_factory=dict, description="Strategies by identifier.")
    solutions: dict[Identifier, SolutionUse] = Field(default_factory=dict, description="Solutions by identifier.")
    context: dict[Identifier, Text] = Field(default_factory=dict, description="Context by identifier.")
    assumptions: dict[Identifier, Text] = Field(default_factory=dict, description="Assumptions by identifier.")
    justifications: dict[Identifier, Text] = Field(default_factory=dict, description="Justifications by identifier.")

    @property
    def top(self) -> str:
        """The top goal."""
        return next(iter(self.goals))

    @property
    def stated(self) -> Mapping[str, str]:
        """The texts of context, assumptions and justifications."""
        return {**self.context, **self.assumptions, **self.justifications}

    @property
    def arguments(self) -> Mapping[str, GoalUse | StrategyUse]:
        """Goals and strategies."""
        return {**self.goals, **self.strategies}


def read_case(path: Path) -> CaseDocument:
    """Read an assurance case.

    Raises:
        ScenarioError: The case is invalid; contains every problem with its place.
    """
    source = read(path, str(path))
    if source.problems or source.root is None:
        raise ScenarioError(source.problems)
    composition = Composition(source.name, source.root, {}, {source.name: source})
    document = validate(CaseDocument, composition.data, composition, ())
    if isinstance(document, list):
        raise ScenarioError(document)
    if problems := list(_faults(document, composition)):
        raise ScenarioError(problems)
    return document


def _faults(document: CaseDocument, composition: Composition) -> Iterator[Problem]:
    """Yield identifiers that are used twice, unknown or unsuitable, circular arguments, and unreferenced elements."""
    sections = ("goals", "strategies", "solutions", "context", "assumptions", "justifications")
    owners: dict[str, str] = {}
    for section in sections:
        for name in getattr(document, section):
            if name in owners:
                said = f"`{name}` is in `{owners[name]}` already"
                yield composition.problem("invalid-value", said, (section, name), key=True)
            owners.setdefault(name, section)
    supports = {"goals": ("strategies", "goals", "solutions"), "strategies": ("goals",)}
    used = {document.top}
    for section, allowed in supports.items():
        for name, each in getattr(document, section).items():
            named = [("by", place, other, allowed) for place, other in enumerate(each.by)]
            named += [("context", place, other, sections[3:]) for place, other in enumerate(each.context)]
            for key, place, other, kinds in named:
                used.add(other)
                path = (section, name, key, place)
                known = [one for one, owner in owners.items() if owner in kinds]
                if other not in owners:
                    expected = f"one of {', '.join(known)}" if known else None
                    said = f"nothing is called `{other}`"
                    yield composition.problem(
                        "unknown-name", said, path, expected=expected, suggestion=nearest(other, known)
                    )
                elif owners[other] not in kinds:
                    said = f"`{other}` is in `{owners[other]}`, which is not allowed here"
                    yield composition.problem("unsuitable", said, path, expected=f"one of {', '.join(kinds)}")
    for name in _in_circles(document):
        section = "goals" if name in document.goals else "strategies"
        yield composition.problem("unsuitable", f"`{name}` supports itself", (section, name, "by"), key=True)
    for name, section in owners.items():
        if name not in used:
            yield composition.problem("unsuitable", f"nothing refers to `{name}`", (section, name), key=True)


def _in_circles(document: CaseDocument) -> Iterator[str]:
    """Yield the goals and strategies that support themselves, directly or indirectly."""
    arguments = document.arguments
    for name in arguments:
        reached: set[str] = set()
        ahead = [*arguments[name].by]
        while ahead:
            other = ahead.pop()
            if other in arguments and other not in reached:
                reached.add(other)
                ahead += arguments[other].by
        if name in reached:
            yield name
