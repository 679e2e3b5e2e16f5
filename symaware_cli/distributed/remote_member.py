"""A member, as the host knows it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery
from symaware_cli.core.message import Indices


@dataclass(slots=True)
class RemoteMember:
    """A process that takes part.

    Attributes:
        peer: Its number at the port.
        name: What it is called.
        agents: Those that it runs, in the order of the roster.
        is_here: For everybody in the roster, whether it runs them.
        rank: The place of the first of them in the roster, by which members are served.
        reported: The last step that it reported on.
        arrived: What arrived for its agents and was not told yet.
    """

    peer: int
    name: str
    agents: tuple[str, ...]
    is_here: NDArray[np.bool_]
    rank: int
    reported: int
    arrived: list[Delivery] = field(default_factory=list)

    def owns(self, indices: Indices, numbers: Indices, count: int) -> bool:
        """Whether numbers that came from outside are below a count, and it runs the agents that they mean.

        Args:
            indices: The places of these agents in the roster.
            numbers: What was told.
            count: How many there are of what was told.
        """
        return bool(((numbers >= 0) & (numbers < count)).all() and self.is_here[indices].all())
