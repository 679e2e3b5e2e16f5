"""The search method `cma-es`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symaware_cli.evidence.search_method import Look, SearchMethod, number_of
from symaware_cli.studies import independent

#: The initial standard deviation of coordinates between 0 and 1.
_DEVIATION = 0.3


class CovarianceAdaptation(SearchMethod):
    """Covariance matrix adaptation, a generation at a time.

    Where it has converged, it begins again at another point, with twice the points in a generation.

    Sources: N. Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772, 2016; A. Auger, N. Hansen, "A
    Restart CMA Evolution Strategy with Increasing Population Size", IEEE Congress on Evolutionary Computation 2005.
    """

    module = "cmaes"
    install = "pip install 'symaware-cli[falsify]'"

    def minimise(self, look: Look, names: Sequence[str], most: int, seed: int) -> None:
        """Evaluate the points of each generation."""
        from cmaes import CMA

        square = np.tile([0.0, 1.0], (len(names), 1))
        size: int | None = None
        for attempt in range(most):
            (first,) = independent(seed, names, np.arange(attempt, attempt + 1))
            found = CMA(
                mean=first, sigma=_DEVIATION, bounds=square, seed=number_of(seed, attempt), population_size=size
            )
            while not found.should_stop():
                points = [found.ask() for _ in range(found.population_size)]
                found.tell(list(zip(points, look(np.array(points)).tolist(), strict=True)))
            size = 2 * found.population_size
