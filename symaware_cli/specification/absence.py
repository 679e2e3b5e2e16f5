"""What expressions about the world mean for agents that are not in it.

Reasons: docs/decisions/0057-expressions-about-absent-agents.md
"""

from __future__ import annotations


class AbsentError(LookupError):
    """A value does not exist at present, because the agent that it belongs to is not in the world.

    A condition or predicate that needs the value does not hold: its robustness is minus infinity, and its negation
    holds. A metric leaves the instant out.
    """
