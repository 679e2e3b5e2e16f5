"""Base classes and types of the sections of a scenario: identifiers, plugin references, triggers."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

#: A name that can be used in an expression.
IDENTIFIER = r"^[A-Za-z_][A-Za-z0-9_]*$"
Identifier = Annotated[str, Field(pattern=IDENTIFIER, max_length=64)]
Condition = Annotated[str, Field(max_length=500)]


class Section(BaseModel):
    """Base of all sections of the document: no key but the ones described."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


class Use(Section):
    """A plugin, by the name it is registered under."""

    use: str = Field(description="Entry-point name of the plugin, such as `perception.self`.")
    with_: dict[str, Any] = Field(default_factory=dict, alias="with", description="The plugin's own parameters.")


class TriggerSection(Section):
    """An event on which a component takes a turn."""

    event: str = Field(min_length=1, max_length=64, description="The event's name, such as `goal-reached`.")
    of: str | None = Field(
        None,
        min_length=1,
        max_length=200,
        description="The source of the event: a component of the same agent, by its name; "
        "`environment`; or any path, in which * matches anything, such as `agents.leader.steer`. "
        "By default any component of the same agent.",
    )
