"""The neighbours of an agent, as a lazy sequence of ids."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from symaware_cli.core.message import Indices


class Neighbours(Sequence[str]):
    """Ids that are looked up on access, as often only few of many are used."""

    def __init__(self, ids: Sequence[str], indices: Indices) -> None:
        self._ids = ids
        self._indices = indices

    def __getitem__(self, place: Any) -> Any:
        if isinstance(place, slice):
            return [self._ids[index] for index in self._indices[place].tolist()]
        return self._ids[self._indices[place]]

    def __len__(self) -> int:
        return len(self._indices)

    def __eq__(self, other: object) -> bool:
        return list(self) == other

    __hash__ = None  # type: ignore[assignment]
