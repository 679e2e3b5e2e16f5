"""What a scenario may say: the document that files are validated against.

Descriptions are shown by editors, so each states its unit.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema

from symaware_cli.core import Entity, Obstacle

#: The version of the format that this package reads.
FORMAT = 1

#: What `recording.omit` may name; the channels are described in docs/log-format.md.
Kind = Literal["state", "intent", "uncertainty", "risk", "control", "knowledge", "awareness", "world"]

_NAME = r"^[A-Za-z_][A-Za-z0-9_-]*$"
Name = Annotated[str, Field(pattern=_NAME, max_length=64)]

_PER_AGENT = (
    "One value for all agents; a list of values, one for each; or a seeded distribution: "
    "{uniform: [low, high]}, {normal: [mean, deviation]}, {grid: {...}}, {circle: {...}}."
)
PerAgent = Annotated[Any, WithJsonSchema({})]


class Part(BaseModel):
    """Base of all parts of the document: no key but the ones described."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Use(Part):
    """A plugin, by the name it is registered under."""

    use: str = Field(description="Entry-point name of the plugin, such as `perception.self`.")
    with_: dict[str, Any] = Field(default_factory=dict, alias="with", description="The plugin's own parameters.")


class ComponentUse(Use):
    """A component of every agent of the group."""


class ModelUse(Use):
    """The dynamics of every agent of the group."""


class EnvironmentUse(Use):
    """The world."""

    entities: dict[Name, Obstacle] = Field(
        default_factory=dict, description="Bodies that are part of the world, by name."
    )


class Run(Part):
    """How long, and in which way, the scenario runs."""

    mode: Literal["synchronous"] = Field(
        "synchronous", description="synchronous: at each step every component takes one turn, then the world moves."
    )
    duration: float = Field(
        gt=0, le=1e9, description="Simulated time [s]; the run ends with the first step that reaches it."
    )


class Agents(Part):
    """A group: agents that share body, model and components."""

    count: int | None = Field(
        None,
        ge=1,
        le=100_000,
        description="How many agents, called `<group>.0`, `<group>.1`, ... Without it there is one, called `<group>`.",
    )
    entity: Entity = Field(default_factory=lambda: Entity(), description="The body of each agent.")
    model: ModelUse = Field(description="The dynamics of each agent.")
    state: PerAgent = Field(
        None, description=f"Initial state, in the model's order and units; zeros if left out. {_PER_AGENT}"
    )
    knowledge: dict[Name, PerAgent] = Field(
        default_factory=dict,
        description=f"What each agent knows, by name. {_PER_AGENT} To say which: {{each: [...]}} or {{all: ...}}.",
    )
    components: dict[Name, ComponentUse] = Field(
        default_factory=dict, description="The components by name; their order is the order of execution."
    )


class Recording(Part):
    """What goes into the log."""

    interval: float = Field(
        0.0, ge=0, le=1e9, description="Least simulated time between two records [s]; 0 records every step."
    )
    omit: list[Kind] = Field(default_factory=list, description="What to leave out, for smaller logs.")


class Scenario(Part):
    """A scenario for `symaware run`."""

    symaware: Literal[1] = Field(description="Version of the scenario format.")
    name: Name = Field(description="What the scenario is called; names the log.")
    description: str = Field("", description="What it shows, and what to look for.")
    seed: int = Field(0, ge=0, lt=2**63, description="Seed of everything that is drawn by chance.")
    parameters: dict[str, Any] = Field(
        default_factory=dict, description="Values to refer to elsewhere as ${parameters.NAME}."
    )
    run: Run = Field(description="How long, and in which way, the scenario runs.")
    environment: EnvironmentUse = Field(description="The world.")
    agents: dict[Name, Agents] = Field(min_length=1, description="The groups of agents by name.")
    recording: Recording = Field(default_factory=lambda: Recording(), description="What goes into the log.")
