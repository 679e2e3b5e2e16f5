"""The search method `differential-evolution`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from symaware_cli.evidence.search_method import Look, SearchMethod
from symaware_cli.studies import independent

#: The minimum number of points in a generation, and the number per coordinate.
_LEAST, _EACH = 8, 5


class DifferentialEvolution(SearchMethod):
    """Differential evolution, a generation at a time; it begins again where it has converged.

    Source: R. Storn, K. Price, "Differential Evolution: A Simple and Efficient Heuristic for Global Optimization over
    Continuous Spaces", Journal of Global Optimization 11, 1997; as in `scipy.optimize.differential_evolution`.
    """

    def minimise(self, look: Look, names: Sequence[str], most: int, seed: int) -> None:
        """Evaluate the points of each generation."""
        from scipy.optimize import Bounds, differential_evolution

        size = max(_LEAST, _EACH * len(names))
        bounds = Bounds(np.zeros(len(names)), np.ones(len(names)))

        def of_columns(points: Any) -> Any:  # a generation of points (d, n), which SciPy's type stubs do not cover
            return look(points.T)

        for attempt in range(-(-most // size)):
            differential_evolution(
                of_columns,
                bounds,
                init=independent(seed, names, np.arange(attempt * size, (attempt + 1) * size)),
                seed=np.random.default_rng((seed, attempt)),
                polish=False,
                tol=1e-6,
                maxiter=most,
                updating="deferred",
                vectorized=True,
            )
