"""Many rows of a scenario at once, for several learning agents in each: arrays of shape (rows, agents, values)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike

from symaware_cli.learning.row_arrays import Array, Truths
from symaware_cli.learning.vector_environment import starts_of
from symaware_cli.learning.vector_episodes import VectorEpisodes


class ScenarioTeamVectorEnv:
    """A scenario in which several agents are controlled from outside, in many rows.

    Row i equals the environment of `env`, byte for byte. Gymnasium and PettingZoo have no such interface; the names
    here are those of Gymnasium's vector environments.

    Attributes:
        agents: The ids of the n agents, in the order of the second axis of all arrays.
        num_envs: The number of rows.
        episodes: The episodes of all rows.
        unbatched: The reason why rows are not batched, in one line; None if they are.
        single_observation_space: The observations of one agent; shape (k,).
        single_action_space: The actions of one agent; shape (nu,).
        observation_space: The observations of all agents of all rows; shape (rows, n, k).
        action_space: The actions of all agents of all rows; shape (rows, n, nu).
        metadata: The autoreset mode, and the steps per second of simulated time.
    """

    def __init__(
        self,
        agents: Sequence[str],
        episodes: VectorEpisodes,
        bounds: tuple[Array, Array],
        fps: float,
        unbatched: str | None,
    ) -> None:
        """Prepare.

        Args:
            agents: The ids of the agents.
            episodes: The episodes of all rows.
            bounds: The bounds of the actions of each agent, each of shape (n, nu).
            fps: The steps per second of simulated time.
            unbatched: See the class.
        """
        self.agents, self.episodes, self.unbatched = tuple(agents), episodes, unbatched
        shape = episodes.source.arrays.observations.shape
        self.num_envs = shape[0]
        self.metadata = {"autoreset_mode": episodes.mode, "render_fps": fps}
        low, high = bounds
        self.single_observation_space = Box(-np.inf, np.inf, shape[2:], np.float64)
        self.single_action_space = Box(low.min(axis=0), high.max(axis=0), dtype=np.float64)
        self.observation_space = Box(-np.inf, np.inf, shape, np.float64)
        rows = (self.num_envs, *low.shape)
        self.action_space = Box(np.broadcast_to(low, rows), np.broadcast_to(high, rows), dtype=np.float64)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin the next episode of all rows, or of some; see `ScenarioVectorEnv.reset`.

        Returns:
            The observations, shape (rows, n, k); and ``present``, shape (rows, n), and ``seed``, shape (rows,).
        """
        found = self.episodes.begin(*starts_of(self.num_envs, seed, options))
        return found.observations, self._infos(found.present, found.live, found.begun)

    def step(self, actions: ArrayLike) -> tuple[Array, Array, Truths, Truths, dict[str, Any]]:
        """Make a step in all rows.

        The episode of a row is over when the episodes of all its agents are. Agents whose episode ends earlier observe
        zeros, get no reward, and are driven by their components.

        Args:
            actions: The control inputs; shape (rows, n, nu). NaN in place of all inputs leaves an agent to its
                components.

        Returns:
            Observations, shape (rows, n, k), rewards, whether the episode of an agent was terminated, and whether the
            duration is over, each of shape (rows, n). The infos have ``present``, whether an agent is in the world;
            ``live``, whether its episode went on until this step, both of shape (rows, n); and the ``seed`` of the rows
            that began again, which the mask ``_seed`` marks. With `AutoresetMode.SAME_STEP`, the last observations of
            these rows are ``final_obs``, shape (rows, n, k).

        Raises:
            ValueError: The actions have another shape, or are not finite.
            RuntimeError: The episode of a row is over, and rows do not begin again by themselves.
            RunFailedError: A component or the world failed.
        """
        found = self.episodes.step(actions)
        infos = self._infos(found.present, found.live, found.begun)
        if found.final is not None:
            infos |= {"final_obs": found.final, "_final_obs": found.begun.copy()}
        return found.observations, found.rewards, found.terminated, found.truncated, infos

    def _infos(self, present: Truths, live: Truths, begun: Truths) -> dict[str, Any]:
        infos: dict[str, Any] = {"present": present, "live": live}
        if begun.any():
            infos |= {"seed": np.where(begun, self.episodes.seeds, 0), "_seed": begun.copy()}
        return infos

    def close(self) -> None:
        """End all episodes."""
        self.episodes.close()
