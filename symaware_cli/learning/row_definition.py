"""The definition of the rows of a vector environment, from which any process can create them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from symaware_cli.api import Scenario
from symaware_cli.learning.episodes import Episodes, Functions
from symaware_cli.learning.row_arrays import EpisodeSource
from symaware_cli.learning.team import LearningError


class RowDefinition(NamedTuple):
    """The scenario, changes and functions from which rows are created.

    Attributes:
        scenario: The scenario.
        changes: Values that replace those of its file, by their paths.
        functions: The functions that replace entries of the section `learning`.
        batched: Whether rows have to be computed as arrays; None if they are where possible.
        mixes: Whether the functions are written for one environment, as opposed to the rows of many.
    """

    scenario: Scenario
    changes: Mapping[str, Any]
    functions: Functions
    batched: bool | None
    mixes: bool

    def episodes(self) -> Episodes:
        """Return the episodes of one environment.

        Raises:
            ScenarioError: The scenario has problems.
            LearningError: The learning agents are not specified, or a function returns a value of another shape.
        """
        return Episodes(self.scenario, self.changes, self.functions)

    def rows(self, count: int, episodes: Episodes) -> tuple[EpisodeSource, str | None]:
        """Return the source of the episodes of some rows, and the reason why rows are not batched; None if they are.

        Args:
            count: The number of rows.
            episodes: The episodes of one environment, which are used or closed.

        Raises:
            LearningError: Rows have to be batched, but cannot be.
        """
        from symaware_cli.learning.batched_rows import BatchedRows, refusal_of_rows
        from symaware_cli.learning.separate_rows import SeparateRows

        template = episodes.builder(None)
        reason = "it was asked for" if self.batched is False else refusal_of_rows(episodes, template, mixes=self.mixes)
        if self.batched and reason is not None:
            episodes.close()
            raise LearningError(f"the rows cannot be batched: {reason}")
        if reason is not None:
            return SeparateRows(count, episodes, self.episodes), reason
        agents = sum(len(team.agents) for team in episodes.teams)
        episodes.close()
        return BatchedRows(count, agents, episodes, template), None
