"""The search method `random`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symaware_cli.evidence.search_method import Look, SearchMethod
from symaware_cli.studies import independent

#: The number of points of a batch.
_DRAWN = 256


class RandomDraws(SearchMethod):
    """Independent draws."""

    is_independent = True

    def minimise(self, look: Look, names: Sequence[str], most: int, seed: int) -> None:
        """Evaluate independent points."""
        for begin in range(0, most, _DRAWN):
            look(independent(seed, names, np.arange(begin, begin + _DRAWN)))
