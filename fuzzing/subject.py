"""A scenario whose promises are checked, its run, and the comparison of logs and values."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from fuzzing.composer import written
from fuzzing.side_files import write_side_files
from fuzzing.target import Finding

Tree = dict[str, Any]

#: Wall time after which a run is given up, and its scenario left alone [s]; runs take tenths of a second of CPU time,
#: and a busy machine much longer.
PATIENCE = 120.0


class Skipped(Exception):  # noqa: N818 (nothing is wrong)
    """An invariant does not apply to a scenario; says why."""


class Subject:
    """A scenario, and what invariants need of it.

    Attributes:
        tree: The scenario.
        folder: Where its files are.
        chance: Draws instants, seeds and choices.
    """

    def __init__(self, tree: Tree, folder: Path, seed: int) -> None:
        self.tree = tree
        self.folder = folder
        self.path = self.written(tree, "scenario")
        self._seed = seed
        self.chance = Random(seed)

    def reseeded(self, name: str) -> None:
        """Draw for one invariant, whatever others drew."""
        self.chance = Random(f"{self._seed} {name}")

    def written(self, tree: Tree, name: str) -> Path:
        """Write a scenario to a file."""
        folder = self.folder / name
        folder.mkdir(exist_ok=True)
        write_side_files(folder)
        path = folder / "composed.yaml"
        path.write_bytes(written(tree))
        return path

    def run(self, path: Path, name: str, **options: Any) -> Any:
        """Run a scenario or log; returns the result, whether the run finished or failed."""
        import symaware_cli as sa

        try:
            result = sa.Scenario(path).run(output=self.folder / f"{name}.mcap", timeout=PATIENCE, **options)
        except sa.RunFailedError as error:
            result = error.run
        if result.status == "interrupted":
            raise Skipped("too slow")
        return result

    @cached_property
    def result(self) -> Any:
        """The run of the scenario."""
        return self.run(self.path, "run")

    @property
    def log(self) -> Path:
        """The log of the run."""
        return Path(self.result.log_path)

    def require_finished(self) -> None:
        """Skip an invariant that is about runs that finish."""
        if self.result.status != "finished":
            raise Skipped("failed")

    def without(self, *features: str) -> None:
        """Skip an invariant that does not hold of some components, topologies or worlds."""
        for feature in features:
            if feature in json.dumps(self.tree):
                raise Skipped(f"has {feature}")


def same_logs(subject: Subject, one: Path, other: Path, *, only_channels: bool = False) -> None:
    """Raise a finding unless two logs are equal."""
    from symaware_cli.log import open_log
    from symaware_cli.log.digest import digest

    first, second = (digest(open_log(path)) for path in (one, other))
    different = first.differences(second)
    if only_channels:
        different = [name for name in different if name in first.channels or name in second.channels]
    if different:
        raise Finding("different", f"{one.name} and {other.name} differ in {', '.join(different)}", kinds(different))


def same(name: str, one: Any, other: Any) -> None:
    """Raise a finding unless two values are equal; NaN equals itself."""
    if not equal(one, other):
        raise Finding("different", f"{name}: {one!r:.500} and {other!r:.500}", name)


def equal(one: Any, other: Any) -> bool:
    """Whether two values are equal; NaN equals itself."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        first, second = np.asarray(one), np.asarray(other)
        return first.shape == second.shape and bool(np.array_equal(first, second, equal_nan=first.dtype.kind == "f"))
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (math.isnan(one) and math.isnan(other))
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(equal, one, other))
    return bool(one == other)


def kinds(names: Iterable[str]) -> str:
    """Topics without the names of groups."""
    return " ".join(
        sorted({"/".join(part for place, part in enumerate(name.split("/")) if place != 2) for name in names})
    )


def same_series(one: Any, other: Any, group: str, field: str, name: str, rows: int | None = None) -> None:
    """Compare values over time, where values that did not change may be recorded less often."""
    import symaware_cli as sa

    try:
        first = one.series(group, field)
    except sa.LogError:
        return
    second = other.series(group, field)
    times = np.union1d(first.times, second.times)
    if not len(first.times) or not len(second.times):
        same(name, len(first.times), len(second.times))
        return
    times = times[times >= max(first.times[0], second.times[0])]
    held = [each.values[np.searchsorted(each.times, times, side="right") - 1] for each in (first, second)]
    same(name, held[0][:, :rows] if rows else held[0], held[1][:, :rows] if rows else held[1])
