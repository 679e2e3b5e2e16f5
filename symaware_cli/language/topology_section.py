"""The section of the topology: which agents reach which others with messages, and over what channels."""

from __future__ import annotations

from pydantic import Field

from symaware_cli.core.identifiers import AGENTS, Target
from symaware_cli.engine import ChannelParameters
from symaware_cli.language.section import Section, Use


class LinkUse(Section):
    """Links with their own channel."""

    sender: Target = Field("*", description=AGENTS)
    receiver: Target = Field("*", description=AGENTS)
    channel: ChannelParameters = Field(description="The differences from the channel of all links.")


class TopologyChange(Use):
    """A topology that replaces the present one at some time."""

    at: float = Field(gt=0, le=1e9, description="When [s].")


class TopologyUse(Use):
    """The communication topology: which agents can send messages to which others, and over what channels."""

    channel: ChannelParameters = Field(default_factory=ChannelParameters, description="The channel of every link.")
    links: list[LinkUse] = Field(
        default_factory=list,
        max_length=10_000,
        description="Links with their own channel; if several apply to a link, the later one takes precedence.",
    )
    changes: list[TopologyChange] = Field(
        default_factory=list,
        max_length=10_000,
        description="Other topologies that replace this one later, in order of time.",
    )
    repeat: float | None = Field(
        None,
        gt=0,
        le=1e9,
        description="Period after which the sequence of topologies repeats [s]. By default it does not repeat.",
    )
    connected: bool = Field(
        False,
        description="Whether every agent must reach every other, directly or through others: a fixed "
        "topology that violates this is refused; for a changing one the log records violations.",
    )
