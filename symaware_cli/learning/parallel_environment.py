"""A scenario as a parallel environment of PettingZoo: all learning agents act at each step."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray
from pettingzoo import ParallelEnv

from symaware_cli.learning.episodes import Episodes

Array = NDArray[np.float64]


class ScenarioParallelEnv(ParallelEnv):  # type: ignore[misc]  # PettingZoo has no types
    """A scenario whose learning agents are controlled from outside; components drive all other agents.

    Agents that enter later or return are among `agents` meanwhile, with observations of zeros and ``info["present"]``
    false, because an agent cannot be added later. An agent that leaves the world for good is terminated.

    Attributes:
        possible_agents: The ids of the learning agents.
        agents: The ids of the learning agents whose episode is not over.
        episodes: The episodes.
    """

    def __init__(self, episodes: Episodes, render_mode: str | None = None) -> None:
        """Prepare.

        Args:
            episodes: The episodes of the scenario.
            render_mode: ``rgb_array`` to draw frames with `render`; ``human`` if the episodes are shown in a viewer.
        """
        self.episodes = episodes
        self.render_mode = render_mode
        self.metadata = {
            "name": "symaware",
            "render_modes": ["rgb_array", "human"],
            "is_parallelizable": True,
            "render_fps": 1.0 / episodes.time_step,
        }
        self.possible_agents = [id for team in episodes.teams for id in team.agents]
        self.agents: list[str] = []
        self.observation_spaces: dict[str, Box] = {}
        self.action_spaces: dict[str, Box] = {}
        for team, (low, high), width in zip(episodes.teams, episodes.spaces, episodes.widths, strict=True):
            for id in team.agents:
                self.observation_spaces[id] = Box(-np.inf, np.inf, (width,), np.float64)
                self.action_spaces[id] = Box(low, high, dtype=np.float64)

    def observation_space(self, agent: str) -> Box:
        """The space of the observations of an agent; always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """The space of the control inputs of an agent, within the limits of its model; always the same object."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Begin the next episode.

        Args:
            seed: The seed of a series of episodes: episode k is run k of a sweep with that seed. None for the next
                episode of the series, which begins with the scenario's seed if none was given.
            options: Not used.

        Returns:
            The observation and the info of each agent; with ``info["seed"]`` as its seed, `symaware run` makes this
            run.
        """
        steps = self.episodes.begin(seed)
        self.agents = list(self.possible_agents)
        observations, infos = {}, {}
        for team, found in zip(self.episodes.teams, steps, strict=True):
            for row, id in enumerate(team.agents):
                observations[id] = found.observations[row]
                infos[id] = {"present": bool(found.present[row]), "seed": self.episodes.seed}
        return observations, infos

    def step(
        self, actions: Mapping[str, ArrayLike]
    ) -> tuple[dict[str, Array], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Make a step; see `Episodes.step`.

        An agent is terminated if its condition holds, if it leaves, or if the run ends before its duration, because
        `run.until` holds or a specification is violated. All agents are truncated at the end of the duration.
        """
        live = self.agents
        gone = {*self.possible_agents} - {*live} if len(live) < len(self.possible_agents) else ()
        if gone:
            actions = {id: each for id, each in actions.items() if id not in gone}
        steps = self.episodes.step(actions)
        over = self.episodes.is_over
        complete = over and self.episodes.is_complete
        observations: dict[str, Array] = {}
        rewards: dict[str, float] = {}
        terminations: dict[str, bool] = {}
        infos: dict[str, dict[str, Any]] = {}
        # Columns are converted to lists, whose elements are several times faster to read than those of arrays.
        for team, found in zip(self.episodes.teams, steps, strict=True):
            ended = found.terminated | True if over and not complete else found.terminated
            ids = team.agents
            observations.update(zip(ids, found.observations, strict=True))
            rewards.update(zip(ids, found.rewards.tolist(), strict=True))
            terminations.update(zip(ids, ended.tolist(), strict=True))
            infos.update({id: {"present": here} for id, here in zip(ids, found.present.tolist(), strict=True)})
        for id in gone:
            del observations[id], rewards[id], terminations[id], infos[id]
        if over:
            self.agents = []
        elif any(terminations.values()):
            self.agents = [id for id in live if not terminations[id]]
        return observations, rewards, terminations, dict.fromkeys(live, complete), infos

    def record(self, output: str | os.PathLike[str] | None = None) -> Path:
        """Write the log of the present episode; see `Episodes.record`."""
        return self.episodes.record(output)

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the world from above; None without the render mode ``rgb_array``, also where a viewer shows it.

        Returns:
            Red, green and blue; shape (480, 480, 3).
        """
        return self.episodes.draw() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the simulation."""
        self.episodes.close()
