"""Names that sections of a scenario add to the conditions of components.

Reasons: docs/decisions/0100-confinement.md
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from symaware_cli.specification.parser import Names

if TYPE_CHECKING:
    from symaware_cli.core import AgentGroup


class FurtherNames(ABC):
    """Adds names to the conditions of agents. A section builds it, so that it is in `AgentGroup.sections`."""

    @abstractmethod
    def names(self, group: AgentGroup) -> Names:
        """Return the names that conditions of a group may refer to, with the keys that must follow them."""

    @abstractmethod
    def look_up(self, group: AgentGroup, row: int, name: str) -> Any:
        """Return the value of one of the names for one agent of the group."""
