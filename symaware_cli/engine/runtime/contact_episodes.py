"""Contact episodes: contacts that are interrupted for less than the debounce of their world count as one.

Reasons: docs/decisions/0064-contact-episodes.md
"""

from __future__ import annotations

from dataclasses import replace

from symaware_cli.core import Contact


class ContactEpisodes:
    """Decides which contacts belong together.

    An episode begins when two bodies touch, and ends once they have been apart for the debounce: physics engines push
    pressed bodies apart for single steps, and a bouncing ball comes to rest in ever shorter leaps.
    """

    def __init__(self, debounce: int) -> None:
        """Initialise without contacts.

        Args:
            debounce: How long two bodies must be apart until their episode has ended [ns]; 0 if it ends at once.
        """
        self._debounce = debounce
        #: Of the pairs whose episode may go on: since when they have been apart [ns], and the point of contact.
        self._apart: dict[tuple[str, str], tuple[int, tuple[float, ...]]] = {}

    def follow(self, contact: Contact, now: int) -> tuple[Contact, bool]:
        """Follow two bodies that begin or cease to touch.

        Args:
            contact: The contact.
            now: The instant [ns]; not before that of earlier calls.

        Returns:
            The contact, which knows whether it resumes an episode; and whether an episode begins or ends with it.
        """
        if not self._debounce:
            return contact, True
        pair = contact.first, contact.second
        if not contact.begins:
            self._apart[pair] = now, contact.point
            return contact, False
        if self._apart.pop(pair, None) is None:
            return contact, True
        return replace(contact, resumes=True), False

    def ended(self, now: int) -> list[Contact]:
        """Return and forget the episodes that have ended by an instant [ns], sorted by the names of the bodies."""
        if not self._apart:
            return []
        pairs = sorted(pair for pair, (since, _) in self._apart.items() if now - since >= self._debounce)
        return [Contact(*pair, self._apart.pop(pair)[1], 0.0, begins=False) for pair in pairs]
