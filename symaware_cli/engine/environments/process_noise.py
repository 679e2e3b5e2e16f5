"""Process noise: random changes that worlds add to the states of agents in each step."""

from __future__ import annotations

import numpy as np

from symaware_cli.core import EntityGroup
from symaware_cli.geometry import Array
from symaware_cli.world import GroupChance, Turn


class ProcessNoise:
    """Draws the noise that a group's model adds to the states of its agents in each step.

    An agent's draws are keyed by its id and the step, so they do not depend on other agents.
    """

    def __init__(self, group: EntityGroup, covariance: Array, seed: int) -> None:
        self._chance = GroupChance(group.seeds or seed, "environment", group.numbers)
        self._deviation = np.sqrt(np.diag(covariance))
        self._factor = None if _is_diagonal(covariance) else cholesky(covariance)

    def draw(self, time: int) -> Array:
        """Return the noise of one step; shape (n, nx).

        Args:
            time: When the step begins, in nanoseconds.
        """
        numbers = self._chance.at(Turn(time)).standard_normal(len(self._deviation))
        if self._factor is None:
            return numbers * self._deviation
        noise = np.zeros_like(numbers)
        for row, column in zip(*np.nonzero(self._factor), strict=True):
            noise[:, row] += self._factor[row, column] * numbers[:, column]
        return noise


def process_noise(group: EntityGroup, step: float, seed: int) -> ProcessNoise | None:
    """Return the process noise of a group over steps [s]; None if its model has none."""
    covariance = group.model.noise_covariance(step)
    return None if covariance is None else ProcessNoise(group, covariance, seed)


def cholesky(covariance: Array) -> Array:
    """Return the lower triangular L with L L' = covariance; unlike NumPy's, also for singular matrices.

    Source: G. H. Golub and C. F. Van Loan, Matrix Computations, section 4.2.8: a zero pivot gives a column of zeros.
    """
    count = len(covariance)
    factor = np.zeros((count, count))
    for column in range(count):
        rest = covariance[column:, column] - factor[column:, :column] @ factor[column, :column]
        if rest[0] > 1e-12 * covariance[column, column]:
            factor[column:, column] = rest / np.sqrt(rest[0])
    return factor


def _is_diagonal(matrix: Array) -> bool:
    return not np.any(matrix - np.diag(np.diag(matrix)))
