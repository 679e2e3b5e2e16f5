"""What agents expect of others: positions ahead with a covariance, or regions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.components.prediction import interpolated
from symaware_cli.components.risk.sampled_noise import SampledNoise
from symaware_cli.components.uncertainty_conformal import REGION
from symaware_cli.core import AgentGroup, Tracks

Array = NDArray[np.float64]


class OtherRegions(NamedTuple):
    """Where others are, with a probability.

    Attributes:
        radii: The radii around the expected positions at each instant [m]; infinite where there is no region; shape
            (K, m).
        misses: The probability that any other is elsewhere, for each agent; shape (n,).
    """

    radii: Array
    misses: Array


class OtherMotion(NamedTuple):
    """What agents expect of others.

    Attributes:
        tracks: Their tracks, of all agents of the group.
        places: The expected positions at each instant [m]; shape (K, m, d).
        spread: The root of the covariance of position and velocity, shape (m, 2d, 2d); None if they are known.
        noise: Samples of the deviations of each; None if they are known.
        regions: Where they are instead of at samples, if that is known.
    """

    tracks: Tracks
    places: Array
    spread: Array | None
    noise: SampledNoise | None
    regions: OtherRegions | None = None

    @classmethod
    def in_regions(cls, group: AgentGroup, tracks: Tracks, instants: Sequence[int]) -> OtherMotion:
        """Return others as the regions say that agents are aware of.

        Args:
            group: The group.
            tracks: Its tracks, m of them.
            instants: The instants of the prediction, K of them [ns].
        """
        ids = group.surroundings.environment.roster.ids
        places = np.repeat(tracks.positions[None], len(instants), axis=0)
        radii, misses = np.full(places.shape[:2], np.inf), np.zeros(len(group))
        for row, agent in enumerate(group.agents):
            regions = agent.awareness_database.held_part(REGION.name)
            for place in range(*tracks.pointers[row : row + 2].tolist()):
                region = regions.get(ids[tracks.others[place]])
                if region is None:
                    continue
                size = region.values.shape[1] - 2
                places[:, place, :size] = interpolated(region.times, region.values[None, :, :size], instants)[0]
                # A radius holds since the look-ahead before.
                numbers = np.searchsorted(region.times, instants)
                known = numbers < len(region)
                radii[known, place] = region.values[numbers[known], size]
                misses[row] = max(misses[row], 1.0 - float(region.values[0, size + 1]))
        return cls(tracks, places, None, None, OtherRegions(radii, misses))
