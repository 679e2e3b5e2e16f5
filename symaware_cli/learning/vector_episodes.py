"""Episodes in the rows of a vector environment: their seeds, live agents, and the resets of rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from symaware_cli.learning.row_arrays import Array, EpisodeSource, Rows, Truths
from symaware_cli.studies import seeds_of


class VectorStep(NamedTuple):
    """The results of a step for the agents of all rows.

    Attributes:
        observations: The observations, zeros for agents that are absent or whose episode is over; shape (rows, n, k).
        rewards: The rewards; shape (rows, n).
        terminated: Whether the episode of the agent was terminated, in this step or before; shape (rows, n).
        truncated: Whether the duration is over; shape (rows, n).
        present: Whether the agent is in the world; shape (rows, n).
        live: Whether the episode of the agent went on until this step; shape (rows, n).
        begun: The rows whose episode began in this step; their observations are the first ones. Shape (rows,).
        final: The last observation of rows that ended and began again in this step; None if there are none.
        final_present: The value of `present` at these last observations.
    """

    observations: Array
    rewards: Array
    terminated: Truths
    truncated: Truths
    present: Truths
    live: Truths
    begun: Truths
    final: Array | None = None
    final_present: Truths | None = None


class VectorEpisodes:
    """Episodes in the rows of a vector environment.

    Attributes:
        seeds: The seed of the present episode of each row; shape (rows,).
        source: Makes the episodes.
        mode: When a row whose episode is over begins the next one.
    """

    def __init__(self, source: EpisodeSource, own_seed: int, inputs: int, mode: AutoresetMode) -> None:
        """Prepare.

        Args:
            source: Makes the episodes.
            own_seed: The seed of the scenario.
            inputs: The number of control inputs of an agent.
            mode: See the class.
        """
        self.source, self.mode = source, mode
        self._own_seed = own_seed
        rows, agents = source.arrays.rewards.shape
        self._shape = rows, agents, inputs
        self._roots: list[int | None] = [None] * rows
        self._indices = [0] * rows
        self.seeds: NDArray[np.int64] = np.zeros(rows, np.int64)
        self._live: Truths = np.zeros((rows, agents), bool)
        self._terminated: Truths = np.zeros((rows, agents), bool)
        self._over: Truths = np.ones(rows, bool)

    def begin(self, seeds: Sequence[int | None], chosen: Truths) -> VectorStep:
        """Begin the next episode of some rows.

        Args:
            seeds: For each row the seed of a series of episodes; None for the next episode of its series. By default
                the series of row i has the seed of the scenario plus i.
            chosen: A mask of the rows that begin; shape (rows,).
        """
        rows = np.flatnonzero(chosen)
        for row in rows.tolist():
            seed = seeds[row]
            if seed is not None or self._roots[row] is None:
                self._roots[row], self._indices[row] = self._own_seed + row if seed is None else int(seed), 0
            else:
                self._indices[row] += 1
        self._begin(rows)
        return self._step(self._live.copy(), chosen)

    def _begin(self, rows: Rows) -> None:
        own = seeds_of([self._roots[row] or 0 for row in rows.tolist()], [self._indices[row] for row in rows.tolist()])
        self.seeds[rows] = own
        self.source.begin(rows, own)
        self._live[rows], self._terminated[rows], self._over[rows] = True, False, False

    def _step(self, live: Truths, begun: Truths) -> VectorStep:
        arrays = self.source.arrays
        return VectorStep(
            np.where(live[..., None], arrays.observations, 0.0),
            np.where(live, arrays.rewards, 0.0),
            self._terminated.copy(),
            np.repeat(arrays.complete[:, None], live.shape[1], axis=1),
            arrays.present & live,
            live,
            begun,
        )

    def step(self, actions: ArrayLike) -> VectorStep:
        """Make a step in all rows.

        Args:
            actions: The control inputs; shape (rows, n, nu). A row of NaN leaves an agent to its components.

        Raises:
            ValueError: The actions have another shape, or are not finite.
            RuntimeError: An episode is over, and rows do not begin again by themselves.
            RunFailedError: A component or the world failed.
        """
        values, given = self._checked(actions)
        begins = np.zeros(len(self._over), bool)
        if self._over.any():
            if self.mode is not AutoresetMode.NEXT_STEP:
                row = int(np.flatnonzero(self._over)[0])
                raise RuntimeError(f"the episode of row {row} is over: reset it, with `reset_mask` for single rows")
            begins = self._over.copy()
        rows = np.flatnonzero(~begins)
        live = self._live.copy()
        if len(rows):
            self.source.step(rows, values, given & live)
        arrays = self.source.arrays
        early = arrays.ended & ~arrays.complete
        self._terminated |= live & (arrays.terminated | early[:, None])
        self._live = live & ~self._terminated & ~arrays.ended[:, None]
        self._over = np.asarray(~self._live.any(axis=1))
        if begins.any():
            again = np.flatnonzero(begins)
            self._advance(again)
            live[again] = True
        found = self._step(live, begins)
        if self.mode is AutoresetMode.SAME_STEP and self._over.any():
            over = self._over.copy()
            self._advance(np.flatnonzero(over))
            first = self._step(self._live.copy(), over)
            shown = over[:, None]
            found = found._replace(
                observations=np.where(shown[..., None], first.observations, found.observations),
                present=np.where(shown, first.present, found.present),
                begun=over,
                final=found.observations,
                final_present=found.present,
            )
        return found

    def _advance(self, rows: Rows) -> None:
        """Begin the next episode of the series of some rows."""
        for row in rows.tolist():
            self._indices[row] += 1
        self._begin(rows)

    def _checked(self, actions: ArrayLike) -> tuple[Array, Truths]:
        values = np.asarray(actions, float)
        if values.shape != self._shape:
            raise ValueError(f"the actions have shape {values.shape}, not {self._shape}")
        given = np.ones(self._shape[:2], bool)
        if not np.isfinite(values).all():
            given = ~np.isnan(values).all(axis=2)
            wrong = given & ~np.isfinite(values).all(axis=2)
            if wrong.any():
                row, agent = (int(each[0]) for each in np.nonzero(wrong))
                raise ValueError(f"the action of agent {agent} in row {row} is not finite: {values[row, agent]}")
            values = np.where(given[..., None], values, 0.0)
        return values, given

    def close(self) -> None:
        """End all episodes."""
        self.source.close()
