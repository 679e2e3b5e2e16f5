"""A scenario with one learning agent as an environment of Gymnasium."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from symaware_cli.learning.episodes import Episodes

Array = NDArray[np.float64]


class ScenarioEnv(gymnasium.Env[Array, Array]):
    """A scenario in which one agent is controlled from outside; components drive all other agents.

    Attributes:
        agent: The id of the agent.
        episodes: The episodes.
    """

    def __init__(self, episodes: Episodes, render_mode: str | None = None) -> None:
        """Prepare.

        Args:
            episodes: The episodes of the scenario, with one learning agent.
            render_mode: ``rgb_array`` to draw frames with `render`; ``human`` if the episodes are shown in a viewer.
        """
        ((team,), ((low, high),), (width,)) = episodes.teams, episodes.spaces, episodes.widths
        (self.agent,) = team.agents
        self.episodes = episodes
        self.render_mode = render_mode
        self.metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 1.0 / episodes.time_step}
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (width,), np.float64)
        self.action_space = gymnasium.spaces.Box(low, high, dtype=np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin the next episode; see `ScenarioParallelEnv.reset`."""
        super().reset(seed=seed)
        (found,) = self.episodes.begin(seed)
        return found.observations[0], {"present": bool(found.present[0]), "seed": self.episodes.seed}

    def step(self, action: Array | None) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Make a step; see `ScenarioParallelEnv.step`. Without an action the components drive the agent."""
        (found,) = self.episodes.step({} if action is None else {self.agent: action})
        over = self.episodes.is_over
        complete = over and self.episodes.is_complete
        terminated = bool(found.terminated[0]) or (over and not complete)
        return found.observations[0], float(found.rewards[0]), terminated, complete, {"present": bool(found.present[0])}

    def record(self, output: str | os.PathLike[str] | None = None) -> Path:
        """Write the log of the present episode; see `Episodes.record`."""
        return self.episodes.record(output)

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the world from above; see `ScenarioParallelEnv.render`."""
        return self.episodes.draw() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the simulation."""
        self.episodes.close()
