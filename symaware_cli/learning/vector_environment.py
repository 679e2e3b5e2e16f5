"""Many rows of a scenario at once, for one learning agent in each: a vector environment of Gymnasium."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from symaware_cli.learning.row_arrays import Array, Truths
from symaware_cli.learning.vector_episodes import VectorEpisodes, VectorStep


class ScenarioVectorEnv(gymnasium.vector.VectorEnv[Array, Array, NDArray[Any]]):
    """A scenario in which one agent is controlled from outside, in many rows.

    Row i equals the environment of `single_env`, byte for byte.

    Attributes:
        agent: The id of the agent.
        episodes: The episodes of all rows.
        unbatched: The reason why rows are not batched, in one line; None if they are.
    """

    observation_space: Box
    action_space: Box

    def __init__(
        self,
        agent: str,
        episodes: VectorEpisodes,
        bounds: tuple[Array, Array],
        fps: float,
        unbatched: str | None,
    ) -> None:
        """Prepare.

        Args:
            agent: The id of the agent.
            episodes: The episodes of all rows, of one agent.
            bounds: The bounds of the actions, each of shape (nu,).
            fps: The steps per second of simulated time.
            unbatched: See the class.
        """
        self.agent, self.episodes, self.unbatched = agent, episodes, unbatched
        rows, _, width = episodes.source.arrays.observations.shape
        self.num_envs = rows
        self.metadata = {"autoreset_mode": episodes.mode, "render_modes": [], "render_fps": fps}
        low, high = (np.tile(each, (rows, 1)) for each in bounds)
        self.single_observation_space = Box(-np.inf, np.inf, (width,), np.float64)
        self.single_action_space = Box(*bounds, dtype=np.float64)
        self.observation_space = Box(-np.inf, np.inf, (rows, width), np.float64)
        self.action_space = Box(low, high, dtype=np.float64)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin the next episode of all rows, or of those of ``options["reset_mask"]``, shape (rows,).

        Args:
            seed: The seed of a series of episodes for each row, as in `ScenarioEnv.reset`; a number n gives row i the
                seed n + i. None for the next episode of each series.
            options: May have ``reset_mask``.

        Raises:
            ValueError: The seeds or the mask have another shape.
        """
        if isinstance(seed, int):
            super().reset(seed=seed)
        found = self.episodes.begin(*starts_of(self.num_envs, seed, options))
        return found.observations[:, 0], self._infos(found.present[:, 0], found.begun, found.begun)

    def step(self, actions: ArrayLike) -> tuple[Array, Array, Truths, Truths, dict[str, Any]]:
        """Make a step in all rows.

        Args:
            actions: The control inputs; shape (rows, nu). A row of NaN leaves an agent to its components.

        Raises:
            ValueError: The actions have another shape, or are not finite.
            RuntimeError: The episode of a row is over, and rows do not begin again by themselves.
            RunFailedError: A component or the world failed.
        """
        values = np.asarray(actions, float)
        found = self.episodes.step(values[:, None] if values.ndim == 2 else values)
        every = np.ones(self.num_envs, bool)
        infos = self._infos(found.present[:, 0], every, found.begun)
        if found.final is not None:
            infos |= self._final(found)
        return found.observations[:, 0], found.rewards[:, 0], found.terminated[:, 0], found.truncated[:, 0], infos

    def _infos(self, present: Truths, known: Truths, begun: Truths) -> dict[str, Any]:
        infos: dict[str, Any] = {"present": present & known, "_present": known.copy()}
        if begun.any():
            infos |= {"seed": np.where(begun, self.episodes.seeds, 0), "_seed": begun.copy()}
        return infos

    def _final(self, found: VectorStep) -> dict[str, Any]:
        assert found.final is not None
        assert found.final_present is not None
        last = np.full(self.num_envs, None, object)
        for row in np.flatnonzero(found.begun).tolist():
            last[row] = found.final[row, 0]
        final = {"present": found.final_present[:, 0] & found.begun, "_present": found.begun.copy()}
        mask: NDArray[np.bool_] = found.begun.copy()
        return {"final_obs": last, "_final_obs": mask, "final_info": final, "_final_info": mask.copy()}

    def close_extras(self, **kwargs: Any) -> None:
        """End all episodes."""
        self.episodes.close()


def starts_of(
    rows: int, seed: int | Sequence[int | None] | None, options: dict[str, Any] | None
) -> tuple[list[int | None], Truths]:
    """Return the seed of each row, and a mask of the rows that begin, from the arguments of `ScenarioVectorEnv.reset`.

    Raises:
        ValueError: The seeds or the mask have another shape.
    """
    if seed is None:
        seeds: list[int | None] = [None] * rows
    elif isinstance(seed, int | np.integer):
        seeds = [int(seed) + row for row in range(rows)]
    else:
        seeds = [None if each is None else int(each) for each in seed]
        if len(seeds) != rows:
            raise ValueError(f"{len(seeds)} seeds for {rows} rows")
    mask = (options or {}).get("reset_mask")
    if mask is None:
        return seeds, np.ones(rows, bool)
    chosen = np.asarray(mask)
    if chosen.dtype != bool or chosen.shape != (rows,) or not chosen.any():
        raise ValueError(f"`reset_mask` has a truth value for each of {rows} rows, at least one of them true")
    return seeds, chosen
