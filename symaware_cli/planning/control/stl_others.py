"""Where `control.stl` expects other agents, for specifications about pairs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Agent, EntityGroup
from symaware_cli.geometry import Array
from symaware_cli.world import SECOND


class ExpectedPositions(NamedTuple):
    """The expected positions of another agent at some instants.

    Attributes:
        mean: Shape (N, d).
        covariance: Shape (N, d, d).
    """

    mean: Array
    covariance: Array


def expected_positions(agent: Agent, other: str, times: NDArray[np.int64]) -> ExpectedPositions | None:
    """Return where another agent is expected at some instants; None if nothing is known about it.

    It follows its intent, as far as one is known, and otherwise keeps its velocity. The uncertainty of its position
    grows by that of its velocity and by the noise of its model.

    Args:
        agent: The agent that expects it.
        other: The id of the other one.
        times: The instants, from now on [ns]; shape (N,).
    """
    environment, size = agent.surroundings.environment, len(agent.group.model.position)
    tracks = agent.group.others(np.inf)
    rows = slice(tracks.pointers[agent.row], tracks.pointers[agent.row + 1])
    found = np.flatnonzero(tracks.others[rows] == environment.roster.indices[other])
    if not len(found):
        return None
    row = rows.start + int(found[0])
    elapsed = ((times - tracks.time) / SECOND)[:, None]
    mean = tracks.positions[row, :size] + elapsed * tracks.velocities[row, :size]
    covariance = np.zeros((len(times), size, size))
    if tracks.covariances is not None:
        depth, believed = tracks.positions.shape[1], tracks.covariances[row]
        place, velocity = range(size), range(depth, depth + size)
        between = believed[np.ix_(place, velocity)]
        squared = elapsed[..., None] ** 2
        covariance += believed[np.ix_(place, place)] + squared * believed[np.ix_(velocity, velocity)]
        covariance += elapsed[..., None] * (between + between.T)
    group = next(each for each in environment.groups if other in each.ids)
    covariance += elapsed[..., None] * _diffusion(group, size, environment.time_step)
    return ExpectedPositions(_intended(agent, other, times, mean), covariance)


def _diffusion(group: EntityGroup, size: int, step: int) -> Array:
    """Return how fast the covariance of the position of agents grows by noise, per second; shape (d, d)."""
    noise = group.model.noise_covariance(step / SECOND)
    axes = list(group.model.position)[:size]
    return np.zeros((size, size)) if noise is None else noise[np.ix_(axes, axes)] / (step / SECOND)


def _intended(agent: Agent, other: str, times: NDArray[np.int64], straight: Array) -> Array:
    """Return positions by the intent of another agent; where it has none, straight on."""
    belief = agent.awareness_database.get(other)
    if belief is None or not len(belief.intent) or belief.intent.values.shape[1] < straight.shape[1]:
        return straight
    intent, places = belief.intent, straight.copy()
    covered = (times >= intent.times[0]) & (times <= intent.times[-1])
    if not covered.any():
        return straight
    for axis in range(straight.shape[1]):
        places[covered, axis] = np.interp(times[covered], intent.times, intent.values[:, axis])
    # After the end of its plan it stays.
    places[times > intent.times[-1]] = intent.values[-1, : straight.shape[1]]
    return places
