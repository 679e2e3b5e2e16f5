"""Tolerances of a comparison of two logs, by channels and columns, from a file.

Reasons: docs/decisions/0085-results-for-continuous-integration.md
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from symaware_cli.language import ScenarioError, Section, read, validate
from symaware_cli.language.compose import Composition
from symaware_cli.log import LogDifference

_Tolerated = Annotated[float, Field(ge=0, description="Greatest difference that does not count.")]


class ColumnTolerance(Section):
    """The allowed difference of two numbers: the greater of an absolute and a relative one."""

    absolute: _Tolerated = Field(0.0, description="In the unit of the column.")
    relative: _Tolerated = Field(0.0, description="As a share of the greater magnitude of the two.")

    def allows(self, one: Any, other: Any) -> bool:
        """Whether two values are equal but for numbers within the tolerance; two that are no numbers are equal too."""
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            return one.keys() == other.keys() and all(self.allows(one[key], other[key]) for key in one)
        if isinstance(one, list | tuple) and isinstance(other, list | tuple):
            return len(one) == len(other) and all(map(self.allows, one, other))
        if isinstance(one, str) and isinstance(other, str) and one[:1] == other[:1] == "{":
            with suppress(ValueError, RecursionError):  # else a text
                return one == other or self.allows(json.loads(one), json.loads(other))  # such as the data of an event
        if not (_is_number(one) and _is_number(other)):
            return bool(one == other)
        if math.isnan(one) or math.isnan(other):
            return math.isnan(one) and math.isnan(other)
        return math.isclose(one, other, rel_tol=self.relative, abs_tol=self.absolute)


class ChannelTolerance(ColumnTolerance):
    """The tolerance of a channel, and of some of its columns."""

    columns: dict[str, ColumnTolerance] = Field(
        default_factory=dict,
        description="Tolerances of some columns in place of that of the channel; * in a name matches any characters.",
    )
    ignore: bool = Field(False, description="Whether the channel is not compared at all.")


class ToleranceDocument(Section):
    """Tolerances of `symaware diff`, by channels."""

    symaware_tolerance: Literal[1] = Field(alias="symaware-tolerance", description="Version of the format.")
    channels: dict[str, ChannelTolerance] = Field(
        description="The tolerance of each channel, such as /agents/robot/control, of an attachment, or of `outcome`; "
        "* in a name matches any characters, and the first matching entry applies."
    )


class Tolerances:
    """The tolerances of a comparison; values without an entry are compared exactly."""

    def __init__(self, document: ToleranceDocument) -> None:
        self._channels = [
            (
                _pattern(name),
                channel,
                [(_pattern(column), tolerance) for column, tolerance in channel.columns.items()],
            )
            for name, channel in document.channels.items()
        ]

    @classmethod
    def everywhere(cls, greatest: float) -> Tolerances:
        """Return the tolerances that allow each number to be off by an absolute or relative difference."""
        channels = {"*": {"absolute": greatest, "relative": greatest}}
        return cls(ToleranceDocument.model_validate({"symaware-tolerance": 1, "channels": channels}))

    @classmethod
    def read(cls, path: Path) -> Tolerances:
        """Read a file in YAML or TOML.

        Raises:
            ScenarioError: It cannot be used; every problem is located.
        """
        source = read(path, str(path))
        if source.root is None or source.problems:
            raise ScenarioError(source.problems)
        composition = Composition(source.name, source.root, {}, {source.name: source})
        document = validate(ToleranceDocument, composition.data, composition, ())
        if isinstance(document, list):
            raise ScenarioError(document)
        return cls(document)

    def allow(self, difference: LogDifference) -> bool:
        """Whether a difference is within the tolerance of its channel and column."""
        for pattern, channel, columns in self._channels:
            if pattern.fullmatch(difference.topic):
                if channel.ignore:
                    return True
                # A column of a point in a series, as in `x[3]`, and one of a belief about another agent.
                column = re.sub(r"(\[\d+\])+$", "", difference.element)
                names = {difference.element, column, column.rpartition(":")[2]}
                tolerance: ColumnTolerance = channel
                for name, own in columns:
                    if any(map(name.fullmatch, names)):
                        tolerance = own
                        break
                return bool(difference.element) and tolerance.allows(*difference.values)
        return False


def _pattern(name: str) -> re.Pattern[str]:
    """Return the pattern of a name in which * matches any characters."""
    return re.compile(".*".join(map(re.escape, name.split("*"))), re.DOTALL)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
