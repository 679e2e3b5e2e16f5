"""Parts of awareness: the quantities that agents are aware of, of themselves and of others, declared as data.

Reasons: docs/decisions/0021-parts-of-awareness.md
"""

from __future__ import annotations

from typing import ClassVar, Literal, get_args

from symaware_cli.awareness.signal import Signal
from symaware_cli.world import record

Merge = Literal["latest", "seen-first"]


@record
class Part(Signal):
    """A part of awareness: unlike a signal, it belongs to the agent, can be sent to others, and is known to conditions.

    Its name is used in the topic ``/agents/<group>/<name>`` and in expressions. It is a vector or a series. The columns
    of a series may be defined by components (`BaseComponent.series_quantities`).

    Attributes:
        merge: Which of two sources is used for another agent's part: the ``latest``, or with ``seen-first`` the values
            that an agent's own components wrote, and received values only if there are none.
    """

    what: ClassVar = "part"

    merge: Merge = "seen-first"

    def __post_init__(self) -> None:
        Signal.__post_init__(self)
        if self.merge not in get_args(Merge):
            listed = ", ".join(get_args(Merge))
            raise ValueError(f"`merge` of the part `{self.name}` is one of {listed}, not {self.merge!r}")
        if self.kind == "table":
            raise ValueError(f"the part `{self.name}` is a table, and only a signal can be one")


STATE = Part("state", "vector", merge="latest", description="as believed")
INTENT = Part("intent", "series", drawn="path", description="what the agent means to do at that time")
UNCERTAINTY = Part(
    "uncertainty", "series", merge="latest", drawn="ellipse", description="what the agent is not sure of at that time"
)
RISK = Part("risk", "series", description="how much at risk the agent deems itself at that time")

#: The parts that every group has.
PARTS = (STATE, INTENT, UNCERTAINTY, RISK)
