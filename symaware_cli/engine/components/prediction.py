"""Predicted positions of others: along the intents that they told of, or straight on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Tracks
from symaware_cli.geometry import Array
from symaware_cli.world import SECOND


def predicted_positions(
    group: AgentGroup, tracks: Tracks, now: int, instants: Sequence[int], follow_intents: bool
) -> Array:
    """Return where the agents of a group expect others at later instants [m]; shape (len(instants), m, d).

    Others who are known to stay in a set, such as from a promise, are expected at the nearest place of it.

    Args:
        group: The group.
        tracks: Its beliefs about others; m rows.
        now: The instant that these refer to [ns].
        instants: In nanoseconds.
        follow_intents: Whether those who told of an intent are expected to follow it, from where they are; all others
            keep their velocities.
    """
    passed = np.array([(instant - now) / SECOND for instant in instants])
    places = tracks.positions + passed[:, None, None] * tracks.velocities
    if not follow_intents:
        return confined_to(group, tracks, places)
    ids = group.surroundings.environment.roster.ids
    size = places.shape[2]
    for row, agent in enumerate(group.agents):
        told = agent.awareness_database.held_part("intent")
        for place in range(*tracks.pointers[row : row + 2].tolist()) if told else ():
            series = told.get(ids[tracks.others[place]])
            if series is not None and len(series) and series.values.shape[1] >= size:
                expected = interpolated(series.times, series.values[None, :, :size], [now, *instants])[0]
                places[:, place] = tracks.positions[place] + expected[1:] - expected[0]
    return confined_to(group, tracks, places)


def confined_to(group: AgentGroup, tracks: Tracks, places: Array) -> Array:
    """Return predicted places, moved to where their agents are known to stay (`Confined.nearest`).

    Args:
        group: The group that predicts.
        tracks: Its beliefs about others; m rows.
        places: Places of each row [m]; shape (..., m, d).
    """
    for confined in group.confined(tracks):
        places = confined.nearest(places)
    return places


def interpolated(times: NDArray[np.int64], values: Array, instants: Sequence[int]) -> Array:
    """Return the values of series with common times at instants; straight on after the last, the first before it.

    Args:
        times: The times [ns], ascending; shape (h,).
        values: Shape (n, h, d).
        instants: The instants [ns].

    Returns:
        Shape (n, len(instants), d).
    """
    found = np.empty((len(values), len(instants), values.shape[2]))
    for place, instant in enumerate(instants):
        if len(times) == 1 or instant <= times[0]:
            found[:, place] = values[:, 0]
            continue
        after = min(int(np.searchsorted(times, instant)), len(times) - 1)
        share = (instant - int(times[after - 1])) / (int(times[after]) - int(times[after - 1]))
        found[:, place] = values[:, after - 1] + share * (values[:, after] - values[:, after - 1])
    return found
