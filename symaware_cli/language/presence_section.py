"""The sections of the presence of agents."""

from __future__ import annotations

from pydantic import Field

from symaware_cli.geometry import Length
from symaware_cli.language.section import Condition, Section, TriggerSection
from symaware_cli.world import Latency, Seconds

_MOMENT = "a time [s], a condition, or an event: {event: ..., of: ...}"


class PresenceSpan(Section):
    """The interval in which an agent is in the world."""

    from_: Latency | Condition | TriggerSection | None = Field(
        None,
        alias="from",
        description=f"When it enters, in its initial state: {_MOMENT}; or a distribution, from which the time of each "
        f"agent is drawn. Conditions are about the world, like `run.until`. By default it is there from the beginning.",
    )
    apart: Length | None = Field(
        None,
        description="Least distance of other agents when it enters, between positions [m]; it waits until they are "
        "that far away. By default it enters without regard to others.",
    )
    until: Seconds | Condition | TriggerSection | None = Field(
        None,
        description=f"When it leaves: {_MOMENT}. Conditions are about the agent, like "
        f"those of components: `position[0] > 10`. By default it stays.",
    )


class Presence(PresenceSpan):
    """When an agent is in the world; before and afterwards it is absent."""

    again: list[PresenceSpan] = Field(
        default_factory=list,
        max_length=1000,
        description="When it returns after it has left, one after the other, to where it left. By default never.",
    )
