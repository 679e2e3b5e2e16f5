"""Comparison of batched runs with the same runs executed alone, for the conformance kit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from symaware_cli.engine import Run, RunSummary
from symaware_cli.language import Changes
from symaware_cli.language.build import Built, build, build_composition
from symaware_cli.language.compose import Composition, compose
from symaware_cli.studies.batch import Batch
from symaware_cli.studies.batch_simulation import refusal
from symaware_cli.studies.measurement import Measurement, RunMeasurement
from symaware_cli.studies.metrics import RunFigures, figures

#: The sizes of the batches, and the seeds whose runs are also executed alone.
_SIZES, _ALONE = (1, 3, 7, 64), (0, 2, 6, 63)


def differing_runs(path: Path, changes: Changes = ()) -> str | None:
    """Describe the first run of a batch that differs from the same run executed alone; None if all are equal.

    Args:
        path: The scenario file.
        changes: Values that replace those of the file, as for ``--set``.

    Raises:
        ScenarioError: The scenario is invalid.
    """
    return differing_compositions(build(path, changes), lambda: compose(path, changes), path.parent)


def differing_compositions(
    built: Built, composed: Callable[[], Composition], folder: Path, sizes: Sequence[int] = _SIZES
) -> str | None:
    """Like `differing_runs`, for a scenario that is not in a file.

    Args:
        built: The scenario, built.
        composed: Composes its document.
        folder: The folder of the files that it names.
        sizes: The sizes of the batches.

    Raises:
        ScenarioError: The scenario is invalid.
    """
    reason = refusal(built)
    if reason is not None:
        return f"it cannot be batched: {reason}"
    alone = {seed: _alone(composed(), folder, seed) for seed in _ALONE if seed < max(sizes)}
    for size in sizes:
        # The position of a run in its batch depends on the size of the batch.
        seeds = [*range(size // 2, size), *range(size // 2)]
        batch = Batch(composed(), built, seeds)
        batch.advance()
        if batch.run.failure is not None:
            return f"a batch of {size} runs failed: {batch.run.failure}"
        for seed, summary, measured in zip(seeds, batch.summaries(), batch.measurement.finish(), strict=True):
            if seed in alone:
                expected, run = alone[seed]
                found = _comparable(summary, measured, run)
                wrong = [name for name, value in expected.items() if found[name] != value]
                if wrong:
                    return f"the run with seed {seed} has other {', '.join(wrong)} in a batch of {size} than alone"
    return None


def _alone(composition: Composition, folder: Path, seed: int) -> tuple[dict[str, object], Run]:
    built = build_composition(composition, folder, seed)
    run = Run(built.simulation, built.steps, None, None, replace(built.options, may_exit=False))
    measurement = Measurement(built.simulation)
    run.advance()
    return _comparable(run.summary, measurement.finish()[0], run), run


def _comparable(summary: RunSummary, measured: RunMeasurement, run: Run) -> dict[str, object]:
    """Return the quantities of a run that have to be equal, by name."""
    return {
        "states or control inputs": measured.digest,
        "specifications": [(each.name, each.verdict, each.robustness) for each in summary.specifications],
        **figures(RunFigures(summary, measured, run.simulation)),
    }
