"""The overview of a sweep: varied parameters, numbers of runs by state, and columns of the table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class SweepOverview:
    """The overview of a sweep folder.

    Attributes:
        folder: The folder.
        scenario: The scenario.
        seed: The seed of the sweep.
        planned: The number of planned runs.
        counts: The number of runs in each state: ``done``, ``failed`` and ``lost``.
        combinations: The number of combinations of parameters and variant.
        varies: The varied parameters, as ``path: values``.
        variants: The names of the variants.
        claim: The claim to be certified, if any.
        columns: The columns of the table.
    """

    folder: str
    scenario: str
    seed: int
    planned: int
    counts: Mapping[str, int]
    combinations: int
    varies: Sequence[str]
    variants: Sequence[str]
    claim: str | None
    columns: Sequence[str]

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data for JSON."""
        return asdict(self)


def sweep_overview(folder: Path) -> SweepOverview:
    """Return the overview of a sweep, which may be unfinished or running.

    Raises:
        SweepError: There is no sweep.
        LogError: PyArrow is not installed.
    """
    from symaware_cli.studies.sweep_reading import require_pyarrow

    require_pyarrow()
    from symaware_cli.studies.folder import SweepFolder
    from symaware_cli.studies.session import rows_so_far

    sweep = SweepFolder.opened(folder)
    table, document = rows_so_far(sweep), sweep.plan.document
    states = Counter(table["state"].to_pylist())
    varied = document.model_dump(mode="json", include={"over", "together"}, exclude_unset=True)
    lists = [varied.get("over", {}), *varied.get("together", [])]
    return SweepOverview(
        folder=str(folder),
        scenario=document.scenario,
        seed=document.seed,
        planned=sweep.plan.count,
        counts={state: states[state] for state in ("done", "failed", "lost")},
        combinations=len(sweep.plan.cells),
        varies=[f"{path}: {_text(values)}" for each in lists for path, values in each.items()],
        variants=list(document.variants),
        claim=None if document.claim is None else str(document.claim),
        columns=table.column_names,
    )


def _text(values: Any) -> str:
    """Format a list of values or a distribution on one line."""
    if isinstance(values, dict):
        return ", ".join(f"{name} {value}" for name, value in values.items())
    return ", ".join(map(str, values)) if isinstance(values, list) else str(values)
