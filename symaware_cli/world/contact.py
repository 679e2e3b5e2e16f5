"""Contacts: events in which two bodies begin or cease to touch."""

from __future__ import annotations

from symaware_cli.world.records import record


@record
class Contact:
    """Two bodies that begin or cease to touch.

    Attributes:
        first: The id or name of one body; the first of the two in alphabetical order.
        second: The id or name of the other.
        point: The point of contact [m].
        depth: Depth of the overlap [m].
        impulse: The impulse in the step in which the contact begins, along its normal [N s]; 0 in worlds without
            forces, and at the end.
        begins: Whether the contact begins; False if it ends.
        resumes: Whether it begins so soon after its end that both belong to one episode.
    """

    first: str
    second: str
    point: tuple[float, ...]
    depth: float
    begins: bool = True
    impulse: float = 0.0
    resumes: bool = False
