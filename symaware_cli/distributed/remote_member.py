"""What the host stores for each connected member."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery
from symaware_cli.core.message import Indices


@dataclass(slots=True)
class RemoteMember:
    """A member that takes part in the run.

    Attributes:
        peer: Its number at the port.
        name: Its name.
        agents: The ids of its agents, in the order of the roster.
        is_here: For each agent of the roster, whether this member runs it.
        rank: The roster index of its first agent; members are served in this order.
        reported: The last step for which it sent a report.
        arrived: Messages for its agents that have not been sent to it yet.
    """

    peer: int
    name: str
    agents: tuple[str, ...]
    is_here: NDArray[np.bool_]
    rank: int
    reported: int
    arrived: list[Delivery] = field(default_factory=list)

    def owns(self, indices: Indices, numbers: Indices, count: int) -> bool:
        """Whether received numbers are in range, and this member runs all agents that they denote.

        Args:
            indices: The roster indices of these agents.
            numbers: The received numbers.
            count: The number of valid values.
        """
        return bool(((numbers >= 0) & (numbers < count)).all() and self.is_here[indices].all())
