"""Windows of regions: when the specifications that are about a region count."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import ChannelInfo, specification_channels
from symaware_cli.views.scene.marks import ACTIVE, PAST, TO_COME

Window: TypeAlias = tuple[int, int | None]
"""First and last instant [ns]; None for the end of the run."""


def region_windows(channels: Mapping[str, ChannelInfo], regions: Collection[str]) -> dict[str, tuple[Window, ...]]:
    """Return the windows of the specifications whose predicates name a region, in order.

    A region that no specification names, or one that counts during the whole run, has none.

    Raises:
        ValueError: The metadata of a channel are invalid.
    """
    found: dict[str, set[Window]] = {}
    for info in specification_channels(channels).values():
        metadata = info.metadata
        window = int(metadata.get("start") or 0), int(metadata["end"]) if metadata.get("end") else None
        for name in {*re.findall(r"\w+", " ".join(json.loads(metadata.get("predicates", "[]"))))} & {*regions}:
            found.setdefault(name, set()).add(window)
    return {
        name: tuple(sorted(windows, key=lambda window: (window[0], window[1] is None, window[1] or 0)))
        for name, windows in sorted(found.items())
        if (0, None) not in windows
    }


def phases(windows: Collection[Window], times: NDArray[np.int64]) -> NDArray[np.int8]:
    """Return for each instant [ns] whether a window is active, or else whether one is to come or all are past; (k,)."""
    found = np.full(len(times), PAST, np.int8)
    for start, _ in windows:
        found[times < start] = TO_COME
    for start, end in windows:
        found[(times >= start) & (times <= (np.iinfo(np.int64).max if end is None else end))] = ACTIVE
    return found
