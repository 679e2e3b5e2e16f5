"""Experimental designs: points between 0 and 1 for the parameters of runs, which distributions map to values.

Reasons: docs/decisions/0033-drawn-parameters.md
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.studies.statistics.interval_estimate import Array
from symaware_cli.world import generator, key_of, uniform

#: The maximum number of parameters of a Sobol sequence.
MOST_SOBOL = 21_201

#: The minimum distance of points from 0 and 1, where a normal distribution has no finite quantiles.
_MARGIN = 2.0**-53


def independent(seed: int, names: Sequence[str], indices: ArrayLike) -> Array:
    """Draw independent, uniformly distributed points.

    A point depends only on the seed, the parameter's name and the run's index: adding runs or parameters does not
    change it.

    Args:
        seed: The seed of the sweep.
        names: The names of the parameters, d of them.
        indices: The indices of the runs; shape (n,).

    Returns:
        Shape (n, d), in the open interval from 0 to 1.
    """
    counters = np.asarray(indices, np.uint64)
    others = np.zeros(len(counters), np.uint64)
    columns = [uniform(counters, others, key_of(seed, "design", name), 1)[:, 0] for name in names]
    return _inside(np.stack(columns, axis=1) if columns else np.empty((len(counters), 0)))


def latin_hypercube(seed: int, names: Sequence[str], count: int) -> Array:
    """Draw points such that each of `count` equal parts of each parameter's interval contains exactly one.

    The design is drawn as a whole: another count changes all points. A parameter's column depends only on its name, not
    on the other parameters.

    Args:
        seed: The seed of the sweep.
        names: The names of the parameters, d of them.
        count: The number of runs, n.

    Returns:
        Shape (n, d), in the open interval from 0 to 1.

    Source: M. D. McKay, R. J. Beckman, W. J. Conover, "A Comparison of Three Methods for Selecting Values of Input
    Variables in the Analysis of Output from a Computer Code", Technometrics 21, 1979.
    """
    points = np.empty((count, len(names)))
    for column, name in enumerate(names):
        random = generator(seed, f"latin hypercube {name}")
        points[:, column] = (random.permutation(count) + random.random(count)) / count
    return _inside(points)


def sobol(seed: int, names: Sequence[str], count: int) -> Array:
    """Draw the first points of a scrambled Sobol sequence, which fill the space of all parameters evenly.

    Adding runs keeps the existing points; another set of parameters changes all. The balance is best for powers of two.

    Args:
        seed: The seed of the sweep.
        names: The names of the parameters, d of them, in the order of the sequence's axes.
        count: The number of runs, n.

    Returns:
        Shape (n, d), in the open interval from 0 to 1.

    Raises:
        ValueError: There are more parameters than the sequence has axes.

    Source: I. M. Sobol, "On the Distribution of Points in a Cube and the Approximate Evaluation of Integrals", USSR
    Computational Mathematics and Mathematical Physics 7, 1967; scrambled as in `scipy.stats.qmc.Sobol`.
    """
    from scipy.stats import qmc

    if len(names) > MOST_SOBOL:
        raise ValueError(f"a Sobol sequence has at most {MOST_SOBOL:,} parameters, not {len(names):,}")
    if not names or not count:
        return np.empty((count, len(names)))
    random = np.random.default_rng(key_of(seed, "sobol", *names))
    sequence = qmc.Sobol(len(names), scramble=True, seed=random)
    # A power of two of points is generated, and the first ones are used.
    return _inside(sequence.random_base2((count - 1).bit_length())[:count])


def _inside(points: Array) -> Array:
    inside: Array = np.clip(points, _MARGIN, 1.0 - _MARGIN)
    return inside
