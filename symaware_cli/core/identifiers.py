"""Names that scenarios use: of entries, and of the agents and components that an entry is about."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

NAME = r"^[A-Za-z_][A-Za-z0-9_-]*$"

#: The name of an entry, such as a group or a fault.
Name = Annotated[str, Field(pattern=NAME, max_length=64)]

#: A text that names agents or components.
Target = Annotated[str, Field(min_length=1, max_length=200)]

#: What a `Target` of agents may be.
AGENTS = "Which agents: an id, a group or a pattern, such as `robot.2`, `robot` or `robot.*`."

#: What a `Target` of components may be.
COMPONENTS = "A component of some agents, such as `robot.2.steer`, `robot.steer` for the whole group, or `*.steer`."

AgentPattern = Annotated[Target, Field(description=AGENTS)]
ComponentPattern = Annotated[Target, Field(description=COMPONENTS)]
