"""The document model of scenarios: the pydantic models that scenario files are validated against.

Editors show the descriptions, so each states its unit.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar

from pydantic import ConfigDict, Field, WithJsonSchema, create_model, model_validator

from symaware_cli.core import Entity
from symaware_cli.core.identifiers import Name
from symaware_cli.language.section import Identifier, Section, TriggerSection, Use

if TYPE_CHECKING:
    from symaware_cli.core import Obstacle
    from symaware_cli.engine import Fault
    from symaware_cli.geometry import Region
    from symaware_cli.language.fault_section import FaultUse
    from symaware_cli.language.presence_section import Presence
    from symaware_cli.language.scenario_section import ScenarioSection
    from symaware_cli.language.specification_section import SpecificationUse
    from symaware_cli.language.topology_section import TopologyUse
    from symaware_cli.world import Latency
else:
    # What few scenarios have is imported and built for these alone: see `_type_of`.
    FaultUse = Latency = Obstacle = Presence = Region = SpecificationUse = TopologyUse = Any

AnySection = TypeVar("AnySection", bound=Section)

#: The version of the format that this package reads.
FORMAT = 1


_PER_AGENT = (
    "One value for all agents; a list of values, one for each; or a seeded distribution: "
    "{uniform: [low, high]}, {normal: [mean, deviation]}, {choice: [...]}, {grid: {...}}, {circle: {...}}. "
    "{own: {2: VALUE}, rest: ...} "
    "gives some agents, by their numbers, values of their own."
)
PerAgent = Annotated[Any, WithJsonSchema({})]

#: The number of an agent of a group, as the key of a mapping.
AgentNumber = Annotated[str, Field(pattern=r"^(0|[1-9][0-9]{0,5})$")]


class ComponentUse(Use):
    """A component of every agent of the group."""

    own: dict[AgentNumber, dict[str, Any]] = Field(
        default_factory=dict,
        description="Parameters of single agents by their numbers, in place of those under `with`; null stands for the "
        "default.",
    )
    period: float | None = Field(
        None,
        ge=0,
        le=1e9,
        description="Time between two turns [s]; with 0, each turn begins as soon as the previous "
        "one ends. By default there is a turn at each step of the world or, with a trigger, only "
        "when triggered.",
    )
    offset: float = Field(0.0, ge=0, le=1e9, description="Time of the first turn [s].")
    jitter: float = Field(
        0.0, ge=0, le=1e9, description="Greatest delay of each turn, drawn uniformly [s]; less than the period."
    )
    trigger: TriggerSection | None = Field(None, description="An event that triggers a turn.")
    condition: str | None = Field(
        None,
        max_length=500,
        description="A condition on the agent, such as `risk > 0.2`; turns are skipped while it does not hold.",
    )
    when_off: Literal["hold", "clear"] = Field(
        "hold",
        description="Values of the parts of awareness and signals that it wrote, while its condition does not hold: "
        "the last ones, or empty.",
    )
    latency: Latency = Field(
        0.0,
        description="Duration of a computation [s], after which its update takes effect: a number, or a distribution "
        "such as {uniform: [0.02, 0.06]}.",
    )
    overrun: Literal["skip", "queue", "fail"] = Field(
        "skip",
        description="Handling of a turn that is due while the previous one is still computing: it is "
        "skipped, queued until that is over, or treated as a failure.",
    )
    on_failure: Literal["stop", "isolate", "restart"] = Field(
        "stop",
        description="Handling of a failure: the run stops; the agent takes no further part and "
        "coasts; or the component is restarted.",
    )
    tries: int = Field(3, ge=1, le=1_000_000, description="How often the component is restarted before the run stops.")
    coast: Literal["safe", "last"] = Field(
        "safe",
        description="The control input of an agent that coasts: one that stops it as far as its "
        "model can, or its last one.",
    )
    run_in: Literal["here", "process"] = Field(
        "here", description="Where to compute: in the process of the run, or in worker processes."
    )


class ModelUse(Use):
    """The dynamics of every agent of the group."""


class EnvironmentUse(Use):
    """The world."""

    entities: dict[Name, Obstacle] = Field(
        default_factory=dict, description="Bodies that are part of the world, by name."
    )


class RunSection(Section):
    """The duration, mode and limits of the run."""

    mode: Literal["synchronous", "asynchronous"] = Field(
        "synchronous",
        description="synchronous: turns are taken at the steps of the world, in declared order, then "
        "the world moves. asynchronous: turns may be at any time, and components may wait within "
        "their turns.",
    )
    duration: float = Field(
        gt=0, le=1e9, description="Simulated time [s]; the run ends with the first step that reaches it."
    )
    until: str | None = Field(
        None,
        max_length=500,
        description="Condition that ends the run at the first step after which it holds, such as `all(goals_reached)`.",
    )
    pace: float | None = Field(
        None,
        gt=0,
        le=1e6,
        description="Simulated time per second of wall time; 1.0 is real time. By default as fast as possible.",
    )
    turn_limit: float | None = Field(
        None,
        ge=0.01,
        le=1e6,
        description="Wall time after which an unfinished turn counts as a failure [s]. By default there is no limit.",
    )
    workers: int | None = Field(
        None,
        ge=1,
        le=256,
        description="Number of worker processes for components with `run_in: process`. By default one per core.",
    )


class GroupSection(Section):
    """A group: agents that share body, model and components."""

    count: int | None = Field(
        None,
        ge=1,
        le=100_000,
        description="Number of agents, called `<group>.0`, `<group>.1`, ... By default there is one, called `<group>`.",
    )
    entity: Entity = Field(default_factory=lambda: Entity(), description="The body of each agent.")
    model: ModelUse = Field(description="The dynamics of each agent.")
    state: PerAgent = Field(
        None, description=f"Initial state, in the model's order and units; zeros if left out. {_PER_AGENT}"
    )
    present: Presence | list[Presence] | None = Field(
        None,
        description="When each agent is in the world: one for all agents, or a list with one for "
        "each. By default always.",
    )
    knowledge: dict[Name, PerAgent] = Field(
        default_factory=dict,
        description=f"The knowledge of each agent, by name. {_PER_AGENT} {{each: [...]}} and {{all: "
        f"...}} distinguish lists of values from single ones.",
    )
    components: dict[Name, ComponentUse] = Field(
        default_factory=dict, description="The components by name; their order is the order of execution."
    )


class SubscriberUse(Section):
    """A function of a plugin that is called at events."""

    use: str = Field(min_length=1, max_length=200, description="Name of the function.")
    event: str = Field(
        "*", min_length=1, max_length=64, description="The event's name, such as `computed`; * matches anything."
    )
    of: str = Field(
        "*",
        min_length=1,
        max_length=200,
        description="The source of the event, a path such as `agents.robot.*`; * matches anything.",
    )


class Recording(Section):
    """The content of the log."""

    interval: float = Field(
        0.0, ge=0, le=1e9, description="Least simulated time between two records [s]; 0 to record every step."
    )
    events: Literal["all", "notable", "none"] = Field(
        "notable",
        description="Events to record: all, including those of every step, turn or message; only notable "
        "ones; or none except the one that ends the run.",
    )
    messages: Literal["all", "dropped", "none"] = Field(
        "all", description="Messages between agents to record: all, only dropped ones, or none."
    )
    omit: list[str] = Field(
        default_factory=list,
        description="Records to omit, for smaller logs: parts of awareness and signals of components by "
        "name, such as state, intent, uncertainty and risk; requested_control, applied_control, "
        "control for both of them; knowledge, awareness (of others), sensors, world.",
    )


class ScenarioDocument(Section):
    """A scenario for `symaware run`."""

    # Its `faults` have no kinds, and it has no sections of plugins: the model that `document_of` returns has those, and
    # is built instead.
    model_config = ConfigDict(defer_build=True)

    symaware: Literal[1] = Field(description="Version of the scenario format.")
    name: Name = Field(description="The name of the scenario, and of its log.")
    description: str = Field("", description="Its purpose, and effects to look for.")
    seed: int = Field(0, ge=0, lt=2**63, description="Seed of all random draws.")
    parameters: dict[str, Any] = Field(
        default_factory=dict, description="Values to refer to elsewhere as ${parameters.NAME}."
    )
    assets: tuple[str, ...] = Field(
        (),
        description="Further folders, relative to the scenario file, in which mesh and URDF files and the packages "
        "that these name are looked for after the scenario's own.",
    )
    plugins: tuple[str, ...] = Field(
        (),
        max_length=64,
        description="Files of Python below the scenario's folder, with components and other plugins of its own: "
        "`controllers.py` has those that `use: controllers.NAME` names. They are executed only if the person who runs "
        "the scenario trusts them.",
    )
    run: RunSection = Field(description="The duration, mode and limits of the run.")
    environment: EnvironmentUse = Field(description="The world.")
    agents: dict[Name, GroupSection] = Field(
        default_factory=dict, description="The groups of agents by name; without any, only the world is simulated."
    )
    topology: TopologyUse | None = Field(
        None,
        description="Which agents reach which others with messages. By default every agent "
        "reaches every other, at the next step.",
    )
    faults: dict[Name, FaultUse] = Field(default_factory=dict, description="Faults by name.")
    regions: dict[Identifier, Region] = Field(
        default_factory=dict, description="Sets of the workspace, by the names that formulas and conditions refer to."
    )
    specifications: dict[Name, SpecificationUse] = Field(
        default_factory=dict, description="Formulas that are to hold, by name."
    )
    subscribers: dict[Name, SubscriberUse] = Field(
        default_factory=dict, description="Functions of plugins that are called at events, by name."
    )
    recording: Recording = Field(default_factory=lambda: Recording(), description="The content of the log.")

    @model_validator(mode="after")
    def _is_about_something(self) -> Self:
        if not self.agents and not self.environment.entities:
            raise ValueError("there are no agents, and no entities in the world either")
        return self


def _type_of(field: str) -> Any:
    """Import the type of a field that few scenarios have."""
    match field:
        case "latency":
            from symaware_cli.world import Latency

            return Latency
        case "entities":
            from symaware_cli.core import Obstacle

            return dict[Name, Obstacle]
        case "present":
            from symaware_cli.language.presence_section import Presence

            return Presence | list[Presence] | None
        case "topology":
            from symaware_cli.language.topology_section import TopologyUse

            return TopologyUse | None
        case "faults":
            from symaware_cli.language.fault_section import FaultUse

            return dict[Name, FaultUse]
        case "regions":
            from symaware_cli.geometry import Region

            return dict[Identifier, Region]
        case "specifications":
            from symaware_cli.language.specification_section import SpecificationUse

            return dict[Name, SpecificationUse]
    raise ValueError(field)


#: The fields that `_type_of` has the types of, by the section that has them.
_OPTIONAL: Mapping[type[Section], Collection[str]] = {
    ComponentUse: ("latency",),
    EnvironmentUse: ("entities",),
    GroupSection: ("present",),
    ScenarioDocument: ("topology", "faults", "regions", "specifications"),
}


def _optional_fields(data: Mapping[str, Any] | None) -> frozenset[str]:
    """Return the optional fields that a document has anywhere; all without a document."""
    groups = _entries([data or {}], "agents")
    sections = {
        ComponentUse: _entries(groups, "components"),
        EnvironmentUse: [(data or {}).get("environment")],
        GroupSection: groups,
        ScenarioDocument: [data],
    }
    return frozenset(
        name
        for section, names in _OPTIONAL.items()
        for name in names
        if data is None or any(isinstance(each, Mapping) and name in each for each in sections[section])
    )


def _entries(sections: Iterable[Any], key: str) -> list[Any]:
    """Return the entries of a mapping that each of some sections may have."""
    found = (section.get(key) for section in sections if isinstance(section, Mapping))
    return [entry for each in found if isinstance(each, Mapping) for entry in each.values()]


def _changed(section: type[AnySection], types: Mapping[str, Any], **added: Any) -> type[AnySection]:
    """Return a section in which some fields have other types, and with further fields."""
    if not types and not added:
        return section
    fields: dict[str, Any] = {name: (form, section.model_fields[name]) for name, form in types.items()}
    return create_model(section.__name__, __base__=section, __doc__=section.__doc__, **fields, **added)


def document_of(
    faults: Mapping[str, type[Fault] | None],
    installed_faults: Collection[str],
    sections: Mapping[str, type[ScenarioSection] | None],
    data: Mapping[str, Any] | None = None,
) -> type[ScenarioDocument]:
    """Return the model of scenarios with faults of some kinds, and with sections that plugins add.

    Args:
        faults: See `use_of`.
        installed_faults: See `use_of`.
        sections: The classes of all sections that are installed, by key; None for one whose content is not checked.
        data: A document whose fields alone have their types in the model, which then is built faster, but is no model
            of other documents; None for all fields.
    """
    present = frozenset(key for key in sections if data is None or key in data)
    return _document_of(
        tuple(faults.items()), tuple(installed_faults), tuple(sections.items()), present, _optional_fields(data)
    )


@cache
def _document_of(
    faults: tuple[tuple[str, type[Fault] | None], ...],
    installed_faults: tuple[str, ...],
    sections: tuple[tuple[str, type[ScenarioSection] | None], ...],
    present: frozenset[str],
    optional: frozenset[str],
) -> type[ScenarioDocument]:
    types: dict[type[Section], dict[str, Any]] = {
        section: {name: _type_of(name) for name in names if name in optional} for section, names in _OPTIONAL.items()
    }
    if types[ComponentUse]:
        types[GroupSection]["components"] = dict[Name, _changed(ComponentUse, types[ComponentUse])]  # type: ignore[misc]
    if types[GroupSection]:
        types[ScenarioDocument]["agents"] = dict[Name, _changed(GroupSection, types[GroupSection])]  # type: ignore[misc]
    if types[EnvironmentUse]:
        types[ScenarioDocument]["environment"] = _changed(EnvironmentUse, types[EnvironmentUse])
    if faults:
        from symaware_cli.language.fault_section import use_of

        types[ScenarioDocument]["faults"] = dict[Name, use_of(dict(faults), installed_faults)]  # type: ignore[misc]
    added = {
        key: (Any, Field(None, description="A section that a plugin adds."))
        if section is None
        else (section.form if key in present else Any, section.field())
        for key, section in sections
    }
    return _changed(ScenarioDocument, types[ScenarioDocument], **added)
