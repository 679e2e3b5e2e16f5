"""The search method `tpe`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from symaware_cli.evidence.search_method import Look, SearchMethod, number_of

#: The number of points of a batch.
_PROPOSED = 8


class ParzenTree(SearchMethod):
    """Points that are likely under a density of the good ones and unlikely under one of the others (TPE).

    Source: J. Bergstra, R. Bardenet, Y. Bengio, B. Kégl, "Algorithms for Hyper-Parameter Optimization", NeurIPS 2011;
    as in `optuna.samplers.TPESampler`.
    """

    module = "optuna"
    install = "pip install 'symaware-cli[tpe]'"

    def minimise(self, look: Look, names: Sequence[str], most: int, seed: int) -> None:
        """Evaluate the points that the sampler proposes."""
        import optuna

        with _quiet():
            sampler = optuna.samplers.TPESampler(seed=number_of(seed))
            study = optuna.create_study(sampler=sampler)
            bounds: dict[str, optuna.distributions.BaseDistribution] = dict.fromkeys(
                names, optuna.distributions.FloatDistribution(0.0, 1.0)
            )
            for _ in range(0, most, _PROPOSED):
                trials = [study.ask(bounds) for _ in range(_PROPOSED)]
                values = look(np.array([[trial.params[name] for name in names] for trial in trials]))
                for trial, value in zip(trials, values.tolist(), strict=True):
                    study.tell(trial, value)


@contextmanager
def _quiet() -> Iterator[None]:
    """Limit Optuna's log messages to warnings in the block."""
    import optuna

    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)
