"""The panels of specifications: the greatest that the robustness can still turn out to be, and at last is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symaware_cli.recording.reader import Log
from symaware_cli.recording.specifications import LoggedSpecification
from symaware_cli.viewing.palette import AGENTS, hexadecimal
from symaware_cli.viewing.plotting.curves import PlottedCurves
from symaware_cli.viewing.plotting.motion import Chosen, LineStyle
from symaware_cli.viewing.plotting.request import Window


def specifications(log: Log, chosen: Chosen, window: Window) -> list[PlottedCurves]:
    """A panel for each specification that concerns chosen agents and whose intervals were recorded.

    Raises:
        LogError: The log cannot be read.
    """
    panels = (_panel(each, chosen, window) for each in log.specifications.values())
    return [panel for panel in panels if panel is not None]


def _panel(specification: LoggedSpecification, chosen: Chosen, window: Window) -> PlottedCurves | None:
    agents = {*chosen.agents}
    rows = [row for row, concerned in enumerate(specification.rows) if {*concerned} <= agents]
    some = (specification.times >= window.start) & (specification.times <= window.end)
    values = specification.upper[some][:, rows]
    if not np.isfinite(values).any():
        return None
    # The last value holds to the end of what is shown.
    times = np.append(specification.times[some], window.end)
    return PlottedCurves(
        name=f"specification {specification.name}",
        unit="",
        times=times,
        values=np.concatenate([values, values[-1:]]),
        lines=tuple(_lines(specification, rows, chosen)),
        stepwise=True,
        note="robustness at most",
        level=0.0,
    )


def _lines(specification: LoggedSpecification, rows: Sequence[int], chosen: Chosen) -> list[LineStyle]:
    """How each row is drawn: as its agent, if it is about one."""
    styles = {line.name: line for line in chosen.lines}
    found = []
    for number, row in enumerate(rows):
        concerned = specification.rows[row]
        if len(concerned) == 1:
            found.append(styles[concerned[0]])
        else:
            colour = hexadecimal(AGENTS[number % len(AGENTS)])
            found.append(LineStyle(" and ".join(concerned) or specification.name, colour, dashed=True))
    return found
