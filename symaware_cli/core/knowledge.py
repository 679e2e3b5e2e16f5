"""Knowledge: what an agent knows besides its situational awareness, such as its goal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self


class KnowledgeDatabase(dict[str, Any]):
    """The knowledge of one agent by name, which remembers that it changed.

    Attributes:
        changed: An entry was set or removed since this was last set to False.
    """

    __slots__ = ("_news", "_row", "changed")

    def __init__(self, entries: Mapping[str, Any] | None = None, row: int = 0, news: set[int] | None = None) -> None:
        """Know some things from the start.

        Args:
            entries: What is known.
            row: Whose knowledge it is, as a row of a group.
            news: Where to put the row on every change, so that nobody need look through a whole group for changes.
        """
        super().__init__(entries or {})
        self._row = row
        self._news: set[int] = set() if news is None else news
        self._touch()

    def _touch(self) -> None:
        self.changed = True
        self._news.add(self._row)

    def __setitem__(self, name: str, value: Any) -> None:
        super().__setitem__(name, value)
        self._touch()

    def __delitem__(self, name: str) -> None:
        super().__delitem__(name)
        self._touch()

    def __ior__(self, other: Any) -> Self:  # type: ignore[override, misc]
        self.update(other)
        return self

    def __missing__(self, name: str) -> Any:
        known = ", ".join(sorted(self)) or "nothing"
        raise KeyError(f"the agent does not know `{name}`; it knows {known}")

    def update(self, *args: Any, **kwargs: Any) -> None:
        """Set several entries at once."""
        super().update(*args, **kwargs)
        self._touch()

    def pop(self, name: str, *default: Any) -> Any:
        """Remove an entry and return it."""
        self._touch()
        return super().pop(name, *default)

    def popitem(self) -> tuple[str, Any]:
        """Remove the entry that was set last and return it with its name."""
        self._touch()
        return super().popitem()

    def clear(self) -> None:
        """Forget everything."""
        super().clear()
        self._touch()

    def setdefault(self, name: str, default: Any = None) -> Any:
        """Return an entry, set to the default if there was none."""
        self._touch()
        return super().setdefault(name, default)
