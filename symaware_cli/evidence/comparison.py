"""Comparison of two logs or two scenarios: the differences, and when, where and by how much the runs diverge."""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from symaware_cli.evidence.tolerances import Tolerances
from symaware_cli.evidence.verification import VersionDifference, logged_versions, version_differences
from symaware_cli.language import RESOLVED, extracted
from symaware_cli.language.compose import Composition, compose
from symaware_cli.log import (
    ChannelDifference,
    Log,
    LogDifference,
    LogError,
    attachment_differences,
    channel_differences,
    compared_channels,
    first_difference,
    open_log,
)
from symaware_cli.views import plot_logs


@dataclass(frozen=True, slots=True)
class ScenarioChange:
    """A value in which two scenarios differ.

    Attributes:
        path: The path of the value.
        values: The value in each scenario, as plain data; None if missing.
        places: The position of each value, as ``file:line``; "" if missing.
    """

    path: str
    values: tuple[Any, Any]
    places: tuple[str, str]


@dataclass(frozen=True, slots=True)
class ComparisonResult:
    """The differences between two logs or two scenarios.

    Attributes:
        paths: The paths of both.
        scenario: The differing values of the scenarios, in the order of the first.
        first: The first differing message; None for scenarios and for equal logs.
        channels: The differences of channels, the earliest first.
        attachments: The differences in attachments, outcome and channel metadata about columns.
        events: The numbers of occurrences in each log of events for which they differ.
        versions: The differences in versions and machine.
        compared: All channels that were compared, whether they differ or not; empty for scenarios.
    """

    paths: tuple[Path, Path]
    scenario: Sequence[ScenarioChange]
    first: LogDifference | None = None
    channels: Sequence[ChannelDifference] = ()
    attachments: Sequence[LogDifference] = ()
    events: Mapping[str, tuple[int, int]] | None = None
    versions: Sequence[VersionDifference] = ()
    compared: Sequence[str] = ()

    @property
    def is_equal(self) -> bool:
        """Whether they are equal, regardless of versions and of differences within tolerances."""
        return not (self.scenario or self.first or self.attachments)

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {"equal": self.is_equal, **asdict(self), "paths": [str(path) for path in self.paths]}


def compare(
    one: str | os.PathLike[str],
    other: str | os.PathLike[str],
    plot: str | os.PathLike[str] | None = None,
    tolerance: str | os.PathLike[str] | None = None,
) -> ComparisonResult:
    """Compare two logs or two scenarios; for a log and a scenario, their scenarios.

    Args:
        one: A log or a scenario.
        other: Another log or scenario.
        plot: A file for a figure of two logs; None for no figure.
        tolerance: A file with the tolerances of numbers in two logs; None to compare them exactly.

    Raises:
        LogError: A log cannot be read or plotted, or a figure or a tolerance is given for anything but two logs.
        OutputError: The figure cannot be written.
        ScenarioError: A scenario or the tolerances cannot be read.
    """
    one, other = Path(one), Path(other)
    allowed = None if tolerance is None else Tolerances.read(Path(tolerance)).allow
    with tempfile.TemporaryDirectory() as folder:
        composed = [_composed(path, Path(folder, str(number))) for number, path in enumerate((one, other))]
    changes = list(_changes(*composed))
    if not (one.suffix == other.suffix == ".mcap"):
        if plot is not None:
            raise LogError("a figure of differences needs two logs")
        if allowed is not None:
            raise LogError("tolerances need two logs")
        return ComparisonResult((one, other), changes)
    logs = open_log(one), open_log(other)
    channels = channel_differences(*logs, allowed)
    if allowed is None:
        first = first_difference(*logs)
    else:
        # The order of channels within an instant does not count then.
        first = channels[0].first if channels else None
    if plot is not None:
        plot_logs(*logs, plot, None if first is None else first.time)
    return ComparisonResult(
        (one, other),
        changes,
        first,
        channels,
        attachment_differences(*logs, allowed),
        _events(*logs),
        version_differences(*map(logged_versions, logs)),
        compared_channels(*logs),
    )


def _composed(path: Path, folder: Path) -> Composition:
    if path.suffix != ".mcap":
        return compose(path)
    folder.mkdir()
    file, _ = extracted(path, folder)
    return compose(file, name=f"{path}:{RESOLVED}")


def _changes(one: Composition, other: Composition) -> Iterator[ScenarioChange]:
    for path, values in differing_values(one.data, other.data, ()):
        places = tuple(_place(each, path, value) for each, value in zip((one, other), values, strict=True))
        yield ScenarioChange(".".join(map(str, path)), values, (places[0], places[1]))


def differing_values(
    one: Any, other: Any, path: tuple[str | int, ...]
) -> Iterator[tuple[tuple[str | int, ...], tuple[Any, Any]]]:
    """Yield the paths and values of the innermost differences between plain data."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys([*one, *other]):
            yield from differing_values(one.get(key), other.get(key), (*path, key))
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for place, values in enumerate(zip(one, other, strict=True)):
            yield from differing_values(*values, (*path, place))
    elif one != other:
        yield path, (one, other)


def _place(composition: Composition, path: tuple[str | int, ...], value: Any) -> str:
    span = None if value is None else composition.span(path)
    return "" if span is None else f"{span.file}:{span.line}"


def _events(one: Log, other: Log) -> Mapping[str, tuple[int, int]]:
    counts = [Counter(event.name for event in log.events()) for log in (one, other)]
    names = sorted({*counts[0], *counts[1]})
    return {name: (counts[0][name], counts[1][name]) for name in names if counts[0][name] != counts[1][name]}
