"""Validation of manifest, outcome and recovery records of a log."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, JsonValue, model_validator

from symaware_cli.geometry import Number, Position, Region, Shape


def _as_name(text: str) -> str:
    if not text.isprintable() or "/" in text:
        raise ValueError("a name that can be printed, without a slash")
    return text


Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_as_name)]
Quantity = tuple[str, str]
Time = Annotated[int, Field(ge=0, lt=2**63)]


class _Entry(BaseModel):
    """A part of the manifest, as known to this version; later versions may add entries."""

    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False, defer_build=True)


class _Model(_Entry):
    use: str = ""
    state: list[Quantity] = []
    control_input: list[Quantity] = []
    position: list[Annotated[int, Field(ge=0)]] = []
    heading: Annotated[int, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _fits(self) -> _Model:
        if max([*self.position, -1 if self.heading is None else self.heading], default=-1) >= len(self.state):
            raise ValueError("a position or heading that is not in the state")
        if len(self.position) not in (0, 2, 3):
            raise ValueError("a position in a plane or in space has 2 or 3 elements")
        return self


class _Body(_Entry):
    shape: Shape | None = None
    mass: Number | None = None


class _Obstacle(_Body):
    position: Position | None = None
    heading: Number = 0.0


class _ManifestGroup(_Entry):
    agents: list[Name] = []
    indexed: bool = False
    model: _Model = _Model()
    entity: _Body = _Body()
    components: dict[str, str] = {}
    absent: list[Name] = []


class _Part(_Entry):
    name: str
    host: bool
    agents: list[Name]


class Manifest(_Entry):
    """A valid manifest; every entry except the format may be missing."""

    format: Annotated[int, Field(ge=0)]
    name: str | None = None
    seed: int | None = None
    mode: str | None = None
    time_step: Time | None = None
    steps: Time | None = None
    groups: dict[Name, _ManifestGroup] = {}
    entities: dict[Name, _Obstacle] = {}
    roster: list[Name] = []
    regions: dict[Name, Region] = {}
    repeatable_to: dict[str, Annotated[float, Field(gt=0)]] = {}
    part: _Part = None  # type: ignore[assignment] # missing, but not null
    parts: list[JsonValue] = []

    @model_validator(mode="after")
    def _names_each_once(self) -> Manifest:
        agents = [agent for group in self.groups.values() for agent in group.agents]
        names = [*agents, *self.entities]
        if len(set(names)) < len(names) or len(set(self.roster)) < len(self.roster):
            raise ValueError("a name that is used twice")
        if not set(self.roster) <= set(names):
            raise ValueError("a name in the roster that no agent or entity has")
        return self


class _SpecificationOutcome(_Entry):
    name: str
    formula: str
    verdict: Literal["violated", "undecided", "satisfied", "rejected"]
    counts: dict[Literal["violated", "undecided", "satisfied"], Annotated[int, Field(ge=0)]]
    robustness: Number | None
    is_exact: bool
    agents: list[Name]
    time: Number | None
    reason: str
    presumably: Literal["violated", "satisfied"] | None = None

    @model_validator(mode="after")
    def _is_whole(self) -> _SpecificationOutcome:
        if len(self.counts) < 3:
            raise ValueError("the number of agents with each verdict")
        return self


class RunOutcome(_Entry):
    """The outcome of a run; see `Manifest`."""

    status: str | None = None
    steps: Time | None = None
    time: Time | None = None
    evaluated: Time | None = None
    complete: bool | None = None
    specifications: list[_SpecificationOutcome] = []


class Recovered(_Entry):
    """The loss of a damaged log before its recovery; see `Manifest`."""

    log: str | None = None
    text: str | None = None
    lost: bool | None = None
    earlier: Recovered | None = None
