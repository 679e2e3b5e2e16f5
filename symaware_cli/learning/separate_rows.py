"""Rows of a vector environment that cannot be batched: each has a separate simulation in this process."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from symaware_cli.learning.episodes import Episodes, TeamStep
from symaware_cli.learning.row_arrays import Array, RowArrays, Rows, Truths


class SeparateRows:
    """Computes the episodes of all rows one after the other.

    Attributes:
        arrays: See `EpisodeSource`.
    """

    def __init__(self, rows: int, episodes: Episodes, make: Callable[[], Episodes]) -> None:
        """Build the simulations.

        Args:
            rows: The number of rows.
            episodes: The episodes of the first row.
            make: Creates the episodes of a further row.
        """
        self._episodes = [episodes, *(make() for _ in range(rows - 1))]
        self.arrays = RowArrays(rows, sum(len(team.agents) for team in episodes.teams), episodes.widths[0])

    def begin(self, rows: Rows, seeds: Sequence[int]) -> None:
        """See `EpisodeSource`."""
        for row, seed in zip(rows.tolist(), seeds, strict=True):
            self._write(row, self._episodes[row].begin_with(seed))
        self.arrays.rewards[rows] = 0.0
        self.arrays.ended[rows] = self.arrays.complete[rows] = False

    def step(self, rows: Rows, actions: Array, given: Truths) -> None:
        """See `EpisodeSource`."""
        for row in rows.tolist():
            episodes = self._episodes[row]
            ids = [id for team in episodes.teams for id in team.agents]
            own = zip(ids, actions[row], given[row].tolist(), strict=True)
            self._write(row, episodes.step({id: action for id, action, is_given in own if is_given}))
            self.arrays.ended[row] = episodes.is_over
            self.arrays.complete[row] = episodes.is_over and episodes.is_complete

    def _write(self, row: int, steps: Sequence[TeamStep]) -> None:
        arrays, start = self.arrays, 0
        for each in steps:
            agents = slice(start, start + len(each.rewards))
            start += len(each.rewards)
            arrays.observations[row, agents] = each.observations
            arrays.rewards[row, agents] = each.rewards
            arrays.terminated[row, agents] = each.terminated
            arrays.present[row, agents] = each.present

    def close(self) -> None:
        """End all episodes."""
        for each in self._episodes:
            each.close()
