"""Numbers that share a whole, such as probabilities, over time: one panel for each agent, filled from below."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import seconds
from symaware_cli.recording.reader import Log
from symaware_cli.viewing.plotting.motion import Chosen, held, instants, series_of
from symaware_cli.viewing.plotting.request import Window

Array = NDArray[np.float64]

#: More agents have a curve each instead, in a panel for each column.
_MOST_AGENTS = 4


@dataclass(frozen=True)
class Shares:
    """A part of one agent's awareness that is drawn as bars.

    Attributes:
        part: Its name.
        agent: Whose.
        names: What each column is.
        times: (k,) simulated time [ns].
        values: (k, columns); NaN where it is not known.
    """

    part: str
    agent: str
    names: tuple[str, ...]
    times: NDArray[np.int64]
    values: Array

    @property
    def name(self) -> str:
        """What the panel is called."""
        return f"{self.part} of {self.agent}"

    def facts(self) -> dict[str, Any]:
        """Return what there is to say in numbers: of each column the mean, and its greatest value."""
        known = ~np.isnan(self.values).any(axis=1)
        values, times = self.values[known], self.times[known]
        told = {
            name: {
                "mean": float(column.mean()),
                "maximum": float(column.max()),
                "time": seconds(int(times[column.argmax()])),
            }
            for name, column in zip(self.names, values.T, strict=True)
        }
        return {"panel": self.name, "shares": told}


def shares(log: Log, chosen: Chosen, field: str, window: Window) -> list[Shares]:
    """Read a part of awareness that is drawn as bars: a panel for each agent.

    Nothing where it is drawn otherwise, where there are too many agents, or where a number is negative.

    Raises:
        LogError: The log cannot be read, or not understood.
    """
    if len(chosen.lines) > _MOST_AGENTS:
        return []
    found = []
    for name, rows, lines in chosen.groupwise:
        signal = log.signals(name).get(field)
        if signal is None or signal.drawn != "bars":
            continue
        series = series_of(log, name, field, log.series_topic(name, field))
        if series is None or series.times[0] > window.end:
            continue
        edges = np.array([max(window.start, int(series.times[0])), window.end], np.int64)
        times = instants([series.times, edges], window)
        values = held(series.times, series.values, times)
        names = series.columns or tuple(str(number) for number in range(values.shape[2]))
        for row, line in zip(rows, lines, strict=True):
            own = values[:, row]
            if not np.isnan(own).any(axis=1).all():
                found.append(Shares(field, line.name, names, times, own))
    return [] if any((each.values < 0).any() for each in found) else found
