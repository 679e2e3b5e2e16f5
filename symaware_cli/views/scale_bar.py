"""Round lengths, for axes and for the bars that show the scale of a scene."""

from __future__ import annotations

import numpy as np

#: Round intervals, up to a power of ten.
_INTERVALS = (1.0, 2.0, 5.0, 10.0)


def round_interval(span: float, count: int = 8) -> float:
    """Choose a round interval that divides a span into about `count` parts."""
    if span <= 0:
        return 1.0
    scale = 10.0 ** np.floor(np.log10(span / count))
    return float(min((scale * each for each in _INTERVALS), key=lambda each: abs(span / each - count)))
