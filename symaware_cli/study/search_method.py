"""Search methods that minimise a function of points between 0 and 1, evaluated one batch at a time.

The points of a batch depend only on the seed and on the values of earlier batches, not on where they were computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any, Literal, get_args

import numpy as np

from symaware_cli.study.statistics.design import independent
from symaware_cli.study.statistics.interval_estimate import Array
from symaware_cli.study.sweep_error import SweepError

#: ``random``: independent draws; the others: towards lower values.
Method = Literal["random", "differential-evolution", "tpe", "cma-es"]
METHODS: tuple[Method, ...] = get_args(Method)

#: The module that a method needs and that is not always installed.
_MODULES = {"tpe": "optuna", "cma-es": "cmaes"}

#: Returns the values of points: shapes (n, d) and (n,); raises whatever is to end the search.
Look = Callable[[Array], Array]

#: How many points a batch of `random` has, and of ``tpe``.
_DRAWN, _PROPOSED = 256, 8

#: The least number of points of a generation of differential evolution, and how many for each coordinate.
_LEAST, _EACH = 8, 5

#: The standard deviation with which the covariance matrix adaptation begins, on coordinates between 0 and 1.
_DEVIATION = 0.3


def require(method: Method) -> None:
    """Make sure that the module that a method needs is installed.

    Raises:
        SweepError: It is not.
    """
    module = _MODULES.get(method)
    if module is not None and find_spec(module) is None:
        raise SweepError(
            f"the method {method} needs the module `{module}`, which is not installed: "
            "pip install 'symaware-cli[falsify]'"
        )


def minimise(method: Method, look: Look, names: Sequence[str], most: int, seed: int) -> None:
    """Look at points until `look` ends the search by an exception, or at `most` of them.

    Args:
        method: Which points.
        look: Returns the values of a batch of points.
        names: The names of the coordinates, d of them.
        most: How many points at least, if nothing ends the search.
        seed: What points are drawn from.
    """
    {"random": _draw, "differential-evolution": _evolve, "tpe": _propose, "cma-es": _adapt}[method](
        look, names, most, seed
    )


def _draw(look: Look, names: Sequence[str], most: int, seed: int) -> None:
    """Independent points."""
    for begin in range(0, most, _DRAWN):
        look(independent(seed, names, np.arange(begin, begin + _DRAWN)))


def _evolve(look: Look, names: Sequence[str], most: int, seed: int) -> None:
    """Differential evolution, a generation at a time; it begins again where it has converged.

    Source: R. Storn, K. Price, "Differential Evolution: A Simple and Efficient Heuristic for Global Optimization over
    Continuous Spaces", Journal of Global Optimization 11, 1997; as in `scipy.optimize.differential_evolution`.
    """
    from scipy.optimize import Bounds, differential_evolution

    size = max(_LEAST, _EACH * len(names))
    bounds = Bounds(np.zeros(len(names)), np.ones(len(names)))

    def of_columns(points: Any) -> Any:  # a generation of points (d, n), of which the types of SciPy know nothing
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


def _propose(look: Look, names: Sequence[str], most: int, seed: int) -> None:
    """Points that are likely under a density of the good ones and unlikely under one of the others (TPE).

    Source: J. Bergstra, R. Bardenet, Y. Bengio, B. Kégl, "Algorithms for Hyper-Parameter Optimization", NeurIPS 2011;
    as in `optuna.samplers.TPESampler`.
    """
    import optuna

    with _quiet():
        sampler = optuna.samplers.TPESampler(seed=_number(seed))
        study = optuna.create_study(sampler=sampler)
        bounds: dict[str, optuna.distributions.BaseDistribution] = dict.fromkeys(
            names, optuna.distributions.FloatDistribution(0.0, 1.0)
        )
        for _ in range(0, most, _PROPOSED):
            trials = [study.ask(bounds) for _ in range(_PROPOSED)]
            values = look(np.array([[trial.params[name] for name in names] for trial in trials]))
            for trial, value in zip(trials, values.tolist(), strict=True):
                study.tell(trial, value)


def _adapt(look: Look, names: Sequence[str], most: int, seed: int) -> None:
    """Covariance matrix adaptation, a generation at a time.

    Where it has converged, it begins again at another point, with twice the points in a generation.

    Sources: N. Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772, 2016; A. Auger, N. Hansen, "A
    Restart CMA Evolution Strategy with Increasing Population Size", IEEE Congress on Evolutionary Computation 2005.
    """
    from cmaes import CMA

    square = np.tile([0.0, 1.0], (len(names), 1))
    size: int | None = None
    for attempt in range(most):
        (first,) = independent(seed, names, np.arange(attempt, attempt + 1))
        found = CMA(mean=first, sigma=_DEVIATION, bounds=square, seed=_number(seed, attempt), population_size=size)
        while not found.should_stop():
            points = [found.ask() for _ in range(found.population_size)]
            found.tell(list(zip(points, look(np.array(points)).tolist(), strict=True)))
        size = 2 * found.population_size


def _number(*key: int) -> int:
    """A seed for generators that take one of 32 bits."""
    return int(np.random.SeedSequence(key).generate_state(1)[0])


@contextmanager
def _quiet() -> Iterator[None]:
    """Let Optuna report nothing but trouble meanwhile."""
    import optuna

    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)
