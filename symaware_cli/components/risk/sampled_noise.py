"""Standard normal samples for many agents at once, at a fraction of the cost of drawing all of them."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from symaware_cli.world.chance import Turn, generator, key_of, philox

Array = NDArray[np.float64]
Numbers = NDArray[np.uint64]

#: The number of tables of samples; each agent uses one of them.
_TABLES = 16


class SampledNoise:
    """Independent standard normal samples for each agent, for several draws in one turn.

    There are a few tables of random numbers. Each agent uses one of them, and for each draw begins at a place of its
    own in it. So the samples and draws of an agent are independent of each other; samples of different agents may
    coincide, but not in all draws. Agents and tables are keyed by seed, purpose, turn and the number of the agent:
    samples do not depend on which other agents there are.
    """

    def __init__(
        self, seed: int, purpose: str, turn: Turn, numbers: Numbers, draws: int, width: int, samples: int
    ) -> None:
        """Draw the tables.

        Args:
            seed: The seed of the run.
            purpose: What the samples are for.
            turn: The turn in which they are drawn.
            numbers: A number for each agent that depends on its id alone; shape (n,).
            draws: The number of draws.
            width: The number of elements of each sample.
            samples: The number of samples of each agent in a draw.
        """
        tables = (numbers % np.uint64(_TABLES)).astype(np.intp)
        used = np.unique(tables)
        self._table = np.searchsorted(used, tables)
        drawn = np.empty((draws, width, len(used), 3 * samples))
        for place, table in enumerate(used.tolist()):
            own = generator(seed, f"{purpose}\0{table}", turn)
            drawn[:, :, place, : 2 * samples] = own.standard_normal((draws, width, 2 * samples))
        drawn[..., 2 * samples :] = drawn[..., :samples]
        self._windows = sliding_window_view(drawn, samples, axis=-1)
        counters = np.repeat(numbers, draws)
        words, _ = philox(
            counters, np.tile(np.arange(draws, dtype=np.uint64), len(numbers)), key_of(seed, purpose, *turn)
        )
        self._offsets = (words[0] % np.uint32(2 * samples)).astype(np.intp).reshape(-1, draws)

    def draw(self, number: int, agents: slice) -> Array:
        """Return the samples of a draw.

        Args:
            number: The number of the draw.
            agents: Which agents.

        Returns:
            Shape (width, agents, samples).
        """
        tables, offsets = self._table[agents], self._offsets[agents, number]
        drawn: Array = self._windows[number][:, tables, offsets]
        return drawn
