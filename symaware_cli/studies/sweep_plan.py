"""The plan of a sweep: its runs, and the changes of each to the scenario.

Runs are numbered replicate by replicate: run ``index`` is replicate ``index // cells`` of cell ``index % cells``, so
runs can be added without renumbering, and the first runs are balanced over the cells. A drawn parameter has one value
per replicate, which all cells share.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from symaware_cli.language import Assignment
from symaware_cli.studies.statistics.design import independent, latin_hypercube, sobol
from symaware_cli.studies.statistics.interval_estimate import Array
from symaware_cli.studies.sweep_document import SweepDocument


def seed_of(sweep_seed: int, key: int) -> int:
    """Return the seed of a run, from 0 to 2^63 - 1.

    Args:
        sweep_seed: The seed of the sweep.
        key: The index of the run; for paired variants, the number that they share.
    """
    words = SeedSequence(sweep_seed, spawn_key=(key,)).generate_state(2)
    return (int(words[0]) << 32 | int(words[1])) >> 1


def seeds_of(sweep_seeds: Sequence[int], keys: Sequence[int]) -> list[int]:
    """Return the seeds of runs of several sweeps: those of `seed_of`, in a fifteenth of the time for many.

    Source: M. E. O'Neill, "Developing a seed_seq Alternative with Better Statistical Properties", 2015, with the
    constants of NumPy's `SeedSequence`, whose results do not change between versions (NEP 19).

    Args:
        sweep_seeds: The seed of the sweep of each run.
        keys: The index of each run in its sweep.
    """
    if len(keys) < 16 or max(keys) >= 1 << 32 or max(sweep_seeds) >= 1 << 128:
        return [seed_of(*each) for each in zip(sweep_seeds, keys, strict=True)]
    words = [np.array([each >> shift & 0xFFFFFFFF for each in sweep_seeds], np.uint32) for shift in (0, 32, 64, 96)]
    factor = 0x43B0D7E5

    def hashed(value: Words) -> Words:
        nonlocal factor
        value = value ^ np.uint32(factor)
        factor = factor * 0x931E8875 & 0xFFFFFFFF
        return _folded(value * np.uint32(factor))

    pool = [hashed(each) for each in words]
    for source in range(4):
        for place in range(4):
            if place != source:
                pool[place] = _mixed(pool[place], hashed(pool[source]))
    index = np.array(keys, np.uint32)
    pool = [_mixed(each, hashed(index)) for each in pool]
    high = _folded((pool[0] ^ np.uint32(0x8B51F9DD)) * np.uint32(0x8B51F9DD * 0x58F38DED & 0xFFFFFFFF))
    second = 0x8B51F9DD * 0x58F38DED & 0xFFFFFFFF
    low = _folded((pool[1] ^ np.uint32(second)) * np.uint32(second * 0x58F38DED & 0xFFFFFFFF))
    seeds: list[int] = ((high.astype(np.uint64) << np.uint64(32) | low) >> np.uint64(1)).tolist()
    return seeds


Words = NDArray[np.uint32]


def _mixed(one: Words, other: Words) -> Words:
    return _folded(one * np.uint32(0xCA01F9DD) - other * np.uint32(0x4973F715))


def _folded(value: Words) -> Words:
    return value ^ (value >> np.uint32(16))


#: The number of samples converted to values at a time.
_AT_ONCE = 1024


class Samples:
    """The values of each sample, which depend only on the sweep's seed and design and on the sample's number.

    Attributes:
        paths: The paths of the drawn parameters.
    """

    def __init__(self, document: SweepDocument) -> None:
        self._document = document
        self.paths = tuple(document.drawn)
        self._block: tuple[int, list[tuple[Any, ...]]] = (-1, [])

    def of(self, number: int) -> Mapping[str, Any]:
        """Return the values of a sample by path."""
        if not self.paths:
            return {}
        block, place = divmod(number, _AT_ONCE)
        if self._block[0] != block:
            columns = [
                each.values(points)
                for each, points in zip(self._document.drawn.values(), self._points(block).T, strict=True)
            ]
            self._block = (block, list(zip(*columns, strict=True)))
        return dict(zip(self.paths, self._block[1][place], strict=True))

    def _points(self, block: int) -> Array:
        """Return the points between 0 and 1 for a block of samples; shape (n, d)."""
        start = block * _AT_ONCE
        if self._document.design == "random":
            return independent(self._document.seed, self.paths, np.arange(start, start + _AT_ONCE))
        return self._whole[start : start + _AT_ONCE]

    @cached_property
    def _whole(self) -> Array:
        """All points of a design with dependent points."""
        design = sobol if self._document.design == "sobol" else latin_hypercube
        return design(self._document.seed, self.paths, self._document.runs)


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A replacement of a value of the scenario.

    Attributes:
        target: The path of the value in the scenario.
        value: The new value.
        place: The position of the new value in the document of the sweep.
    """

    target: str
    value: Any
    place: tuple[str | int, ...]

    def assignment(self) -> Assignment:
        """Return the change as an assignment, as for ``--set``."""
        return Assignment.of(self.target, self.value)


@dataclass(frozen=True, slots=True)
class Cell:
    """A combination of listed parameters and a variant, which is run repeatedly.

    Attributes:
        number: Its number.
        point: The number of its combination of parameters.
        variant: The name of its variant; None without variants.
        parameters: The values of the listed parameters, by path.
        shared: The changes of all its runs that are applied before those of drawn parameters, in order.
        own: The changes of its variant, applied afterwards.
    """

    number: int
    point: int
    variant: str | None
    parameters: Mapping[str, Any]
    shared: tuple[ParameterChange, ...]
    own: tuple[ParameterChange, ...]


@dataclass(frozen=True)
class SweepPlan:
    """The plan of a sweep: its cells and runs.

    Attributes:
        document: The document of the sweep.
    """

    document: SweepDocument

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """All cells: each combination of listed parameters, in each variant."""
        document = self.document
        shared = tuple(ParameterChange(path, value, ("set", path)) for path, value in document.set.items())
        found: list[Cell] = []
        for point, varied in enumerate(_points(document)):
            parameters = {each.target: each.value for each in varied}
            for variant, content in document.variants.items() or ((None, {}),):
                own = tuple(
                    ParameterChange(path, value, ("variants", str(variant), path)) for path, value in content.items()
                )
                found.append(Cell(len(found), point, variant, parameters, (*shared, *varied), own))
        return tuple(found)

    @cached_property
    def points(self) -> int:
        """The number of combinations of listed parameters."""
        return len(self.cells) // max(1, len(self.document.variants))

    @property
    def count(self) -> int:
        """The number of runs."""
        return self.document.runs * len(self.cells)

    def cell(self, index: int) -> Cell:
        """Return the cell of a run."""
        return self.cells[index % len(self.cells)]

    def replicate(self, index: int) -> int:
        """Return the number of a run within its cell."""
        return index // len(self.cells)

    @cached_property
    def samples(self) -> Samples:
        """The samples of the drawn parameters."""
        return Samples(self.document)

    @property
    def paths(self) -> tuple[str, ...]:
        """The paths of all varied parameters, the listed ones first."""
        return (*self.cells[0].parameters, *self.samples.paths)

    def parameters(self, index: int) -> Mapping[str, Any]:
        """Return the values of all varied parameters in a run, by path."""
        return {**self.cell(index).parameters, **self.samples.of(self.replicate(index))}

    def changes(self, index: int) -> tuple[ParameterChange, ...]:
        """Return all changes of a run to the scenario, in order."""
        return self._changes(self.cell(index), self.samples.of(self.replicate(index)))

    def landmark_changes(self) -> Iterator[tuple[ParameterChange, ...]]:
        """Yield the changes of run 0 with each representative value of each drawn parameter."""
        first = self.samples.of(0)
        for path, drawn in self.document.drawn.items():
            for value in drawn.landmarks:
                yield self._changes(self.cells[0], {**first, path: value})

    @staticmethod
    def _changes(cell: Cell, sample: Mapping[str, Any]) -> tuple[ParameterChange, ...]:
        drawn = (ParameterChange(path, value, ("over", path)) for path, value in sample.items())
        return (*cell.shared, *drawn, *cell.own)

    def seed_key(self, index: int) -> int:
        """Return the key from which the seed of a run is derived; paired variants share it."""
        if self.document.paired:
            return self.replicate(index) * self.points + self.cell(index).point
        return index

    def seed(self, index: int) -> int:
        """Return the seed of a run."""
        return seed_of(self.document.seed, self.seed_key(index))


def cell_count(document: SweepDocument) -> int:
    """Return the number of cells, without creating them."""
    count = max(1, len(document.variants))
    for values in document.listed.values():
        count *= len(values)
    for lists in document.together:
        count *= len(next(iter(lists.values()), [None]))
    return count


def _points(document: SweepDocument) -> Iterator[tuple[ParameterChange, ...]]:
    """Yield every combination of the listed parameters; the last parameter varies fastest."""
    axes: list[list[tuple[ParameterChange, ...]]] = [
        [(ParameterChange(path, value, ("over", path, k)),) for k, value in enumerate(values)]
        for path, values in document.listed.items()
    ]
    for number, lists in enumerate(document.together):
        steps = zip(*(enumerate(values) for values in lists.values()), strict=True)
        axes.append(
            [
                tuple(
                    ParameterChange(path, value, ("together", number, path, k))
                    for path, (k, value) in zip(lists, step, strict=True)
                )
                for step in steps
            ]
        )
    for combination in product(*axes):
        yield tuple(change for changes in combination for change in changes)


def brief_names(paths: Sequence[str], is_path: Callable[[str], bool] = lambda _: True) -> list[str]:
    """Return the ends of dotted paths, each as short as tells it apart from the others.

    Args:
        paths: The paths, and names among them that stay whole.
        is_path: Whether one of them is a path.
    """

    def brief(path: str) -> str:
        parts = path.split(".")
        others = [other for other in paths if other != path]
        ends = (".".join(parts[-count:]) for count in range(1, len(parts)))
        return next((end for end in ends if not any(f".{other}".endswith(f".{end}") for other in others)), path)

    return [brief(path) if is_path(path) else path for path in paths]
