"""Rows of a vector environment as batches: all episodes that began at the same step are rows of one simulation.

Rows of a batch share a clock, so an episode that begins later than others needs a batch of its own. Rows that begin a
new episode leave their earlier batch, which still computes them although these results are no longer read. A batch that
no row uses is used again for new episodes.

Reasons: docs/decisions/0088-vector-environments.md
"""

from __future__ import annotations

import gc
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from symaware_cli.api import result_of
from symaware_cli.core import AgentGroup
from symaware_cli.engine import Observer, RequestFilter, Run, Simulation, StateMark, mark, return_to
from symaware_cli.learning.episodes import Episodes, StepActions, TeamStep, TeamTask
from symaware_cli.learning.given_inputs import Given
from symaware_cli.learning.row_arrays import Array, RowArrays, Rows, Truths
from symaware_cli.studies import BatchSimulation, batch_size, refusal

if TYPE_CHECKING:
    from symaware_cli.language.build import Built

#: Marks a place of a batch that belongs to no row of the environment.
_NONE = -1


def refusal_of_rows(episodes: Episodes, built: Built, *, mixes: bool) -> str | None:
    """Return a one-line reason why the rows of a vector environment cannot be batched; None if they can.

    Args:
        episodes: Episodes of the scenario.
        built: The scenario, built anew.
        mixes: Whether functions are written for one environment, as opposed to the rows of many.
    """
    if episodes.builder.composition is None:
        return "the files of the scenario are read for each episode"
    if mixes:
        given = [name for name, each in episodes.functions._asdict().items() if each is not None]
        if given:
            return f"the function `{given[0]}` does not declare that it computes the rows of many environments"
    if built.options.until is not None:
        return "`run.until` ends runs at different steps"
    for entry in built.simulation.entries:
        if isinstance(entry.components[0], RequestFilter):
            return f"`{entry.path}` compares whole columns of requests"
    return refusal(built)


class _Unobserved(Observer):
    """Collects no metrics: an environment has no summary."""

    def __init__(self, simulation: Simulation) -> None:
        super().__init__(simulation)

    def sample(self, now: int) -> None:
        """Do nothing."""


class _Batch:
    """Episodes that began at the same step.

    Attributes:
        size: The number of episodes that the batch computes.
        owners: The row of the environment that each episode belongs to, or -1; shape (size,).
    """

    def __init__(self, episodes: Episodes, template: Built, seeds: Sequence[int]) -> None:
        composition = episodes.builder.composition
        assert composition is not None
        self.size = len(seeds)
        self.owners: Rows = np.full(self.size, _NONE)
        self._batched = BatchSimulation(composition.copy(), template, seeds)
        simulation = self._batched.simulation
        self._actions = StepActions()
        simulation.overrides = self._actions
        self._stack = ExitStack()
        self._stack.enter_context(simulation.environment)
        options = replace(template.options, specifications=self._batched.specifications, may_exit=False)
        self._run = Run(simulation, template.steps, None, None, options, observer=_Unobserved(simulation))
        self._run.kernel.yields_within_steps = True
        self._advance(0)
        self._mark: StateMark | None = mark(self._run) if episodes.returns else None
        document, task = template.document, episodes.task
        names = {each.name: each for each in self._batched.specifications}
        teams = task.teams(simulation.groups, simulation.environment, document.regions, names)
        self._tasks = [TeamTask(task, team, episodes.functions) for team in teams]
        self._is_new = True

    def _advance(self, steps: int) -> None:
        self._run.advance(steps)
        if self._run.status is not None:
            result_of(self._run)

    def begin(self, owners: Rows, seeds: Sequence[int]) -> list[TeamStep]:
        """Begin episodes for some rows; there may be fewer than the batch computes."""
        self.owners[:] = _NONE
        self.owners[: len(owners)] = owners
        if not self._is_new:
            every = _filled(seeds, self.size)
            assert self._mark is not None
            return_to(self._run, self._mark, every)
            self._batched.take_seeds(every)
        self._is_new = False
        self._actions.given = {}
        self._advance(1)
        return [each.begin() for each in self._tasks]

    def step(self, actions: Array, given: Truths) -> list[TeamStep]:
        """Make a step.

        Args:
            actions: The control inputs; shape (size, n, nu).
            given: Whether each agent has control inputs in `actions`; shape (size, n).
        """
        controlled: dict[AgentGroup, Given] = {}
        start = 0
        for task in self._tasks:
            team = task.team
            count = len(team.rows) // self.size
            mask, values = given[:, start : start + count].reshape(-1), actions[:, start : start + count]
            values = values.reshape(len(mask), -1)
            start += count
            if not mask.any():
                continue
            if len(mask) != len(team.of):
                whole, every = np.zeros(len(team.of), bool), np.zeros((len(team.of), values.shape[1]))
                whole[team.rows], every[team.rows] = mask, values
                mask, values = whole, every
            controlled[team.of] = mask, values
        self._actions.given = controlled
        self._advance(1)
        return [each.step() for each in self._tasks]

    @property
    def is_over(self) -> bool:
        """Whether the runs of the batch are over, which all end with the same step."""
        return self._run.status is not None

    def close(self) -> None:
        """End the runs of the batch."""
        with self._stack:
            self._run.leave("ended between two steps")


class BatchedRows:
    """Makes the episodes of all rows in batches.

    Attributes:
        arrays: See `EpisodeSource`.
        built: The number of batches that were built.
    """

    def __init__(self, rows: int, agents: int, episodes: Episodes, template: Built) -> None:
        """Prepare.

        Args:
            rows: The number of rows.
            agents: The number of learning agents in each row.
            episodes: Episodes of the scenario.
            template: The scenario, built for any seed; it is not run.
        """
        self.arrays = RowArrays(rows, agents, episodes.widths[0])
        self._count = rows
        self._episodes = episodes
        self._template = template
        self._most = batch_size(template)
        self.built = 0
        self._batches: list[_Batch] = []
        self._idle: dict[int, list[_Batch]] = {}

    def begin(self, rows: Rows, seeds: Sequence[int]) -> None:
        """See `EpisodeSource`."""
        begin = np.zeros(self._count + 1, bool)  # the last one is for -1
        begin[rows] = True
        for batch in self._batches:
            batch.owners[begin[batch.owners]] = _NONE
        used = [each for each in self._batches if (each.owners != _NONE).any()]
        for batch in self._batches:
            if batch not in used:
                self._set_aside(batch)
        self._batches = used
        for first in range(0, len(rows), self._most):
            part = slice(first, first + self._most)
            owners, own = rows[part], tuple(seeds[part])
            batch = self._free(own)
            self._batches.append(batch)
            self._write(batch, batch.begin(owners, own), owners)
        self.arrays.rewards[rows] = 0.0
        self.arrays.ended[rows] = self.arrays.complete[rows] = False

    def _set_aside(self, batch: _Batch) -> None:
        if self._episodes.returns:
            self._idle.setdefault(batch.size, []).append(batch)
        else:
            batch.close()

    def _free(self, seeds: tuple[int, ...]) -> _Batch:
        """Return a batch for some episodes: an idle one if there is any, else a new one; it may be larger."""
        size = len(seeds)
        if self._episodes.returns:
            size = min(1 << (size - 1).bit_length(), self._most, self._count)
            idle = self._idle.get(size)
            if idle:
                return idle.pop()
        every = _filled(seeds, size)
        self.built += 1
        # Thousands of objects are created, none of which is garbage; garbage collections would take most of the time.
        enabled = gc.isenabled()
        gc.disable()
        try:
            return _Batch(self._episodes, self._template, every)
        finally:
            if enabled:
                gc.enable()

    def step(self, rows: Rows, actions: Array, given: Truths) -> None:
        """See `EpisodeSource`."""
        chosen = np.zeros(self._count + 1, bool)  # the last one is for -1
        chosen[rows] = True
        for batch in self._batches:
            owners = batch.owners
            stepping = chosen[owners]
            if not stepping.any():
                continue
            found = batch.step(actions[owners], given[owners] & stepping[:, None])
            own = owners[stepping]
            self._write(batch, found, own, None if stepping.all() else stepping)
            if batch.is_over:
                self.arrays.ended[own] = self.arrays.complete[own] = True

    def _write(
        self, batch: _Batch, steps: Sequence[TeamStep], owners: Rows, chosen: NDArray[np.bool_] | None = None
    ) -> None:
        """Copy the results of a batch to the rows that own them."""
        arrays, start, size = self.arrays, 0, batch.size
        for each in steps:
            count = len(each.rewards) // size
            agents = slice(start, start + count)
            start += count
            for all_rows, values in (
                (arrays.observations, each.observations),
                (arrays.rewards, each.rewards),
                (arrays.terminated, each.terminated),
                (arrays.present, each.present),
            ):
                own = values.reshape(size, count, *values.shape[1:])
                all_rows[owners, agents] = own[: len(owners)] if chosen is None else own[chosen]

    def close(self) -> None:
        """End all episodes."""
        for each in [*self._batches, *(batch for idle in self._idle.values() for batch in idle)]:
            each.close()
        self._batches, self._idle = [], {}


def _filled(seeds: Sequence[int], size: int) -> tuple[int, ...]:
    """Return seeds for all episodes of a batch; places without a row get the first seed."""
    return (*seeds, *((seeds[0],) * (size - len(seeds))))
