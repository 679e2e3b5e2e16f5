"""Base classes and types of the sections of a scenario: names, times, plugin references, triggers."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

_NAME = r"^[A-Za-z_][A-Za-z0-9_-]*$"
Name = Annotated[str, Field(pattern=_NAME, max_length=64)]
#: A name that can be used in an expression.
_IDENTIFIER = r"^[A-Za-z_][A-Za-z0-9_]*$"
Identifier = Annotated[str, Field(pattern=_IDENTIFIER, max_length=64)]
Seconds = Annotated[float, Field(ge=0, le=1e9)]
Condition = Annotated[str, Field(max_length=500)]
Target = Annotated[str, Field(min_length=1, max_length=200)]

#: What a `Target` of agents may be.
AGENTS = "Which agents: an id, a group or a pattern, such as `robot.2`, `robot` or `robot.*`."


class Section(BaseModel):
    """Base of all sections of the document: no key but the ones described."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


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


class Drawn(Section):
    """A random duration, drawn each time."""

    uniform: tuple[Seconds, Seconds] | None = Field(None, description="Uniform distribution: [least, greatest] [s].")
    normal: tuple[Seconds, Seconds] | None = Field(
        None, description="Normal distribution: [mean, standard deviation], truncated at 0 [s]."
    )

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if (self.uniform is None) == (self.normal is None):
            raise ValueError("say either `uniform` or `normal`")
        if self.uniform is not None and self.uniform[0] > self.uniform[1]:
            raise ValueError("the least time comes first")
        return self
