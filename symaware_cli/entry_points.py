"""Plugins that installed packages register as entry points; they are imported only when they are used."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any

from symaware_cli.world import code_position, describe

#: The distribution that this package is.
DISTRIBUTION = "symaware-cli"

#: Optional modules, and the extra of this package that installs each.
_EXTRAS = {
    "rerun": "viewer",
    "pybullet": "pybullet",
    "pybullet_data": "pybullet",
    "pymunk": "pymunk",
    "casadi": "casadi",
    "daqp": "qp",
    "zenoh": "zenoh",
}


class PluginError(Exception):
    """A plugin cannot be used.

    Attributes:
        code: A stable identifier for tools.
        expected: What is valid there.
        suggestion: The nearest valid name.
    """

    def __init__(self, code: str, message: str, expected: str | None = None, suggestion: str | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.expected = expected
        self.suggestion = suggestion


class PluginWarning(UserWarning):
    """A plugin is left out, because it is broken."""


@dataclass(frozen=True, slots=True)
class Listing:
    """A plugin that is installed, but not necessarily imported.

    Attributes:
        kind: Its kind, such as ``component``.
        name: Its entry-point name.
        target: Its class or function, as ``module:Class``.
        package: The distribution that contains it.
        version: The version of that distribution.
        point: The entry point.
    """

    kind: str
    name: str
    target: str
    package: str
    version: str
    point: metadata.EntryPoint = field(repr=False, compare=False)

    @property
    def built_in(self) -> bool:
        """Whether it is part of this package."""
        return self.package == DISTRIBUTION

    @property
    def origin(self) -> str:
        """The plugin with its package, for messages."""
        return f"the {self.kind} `{self.name}` of {self.package} {self.version}".rstrip()

    def warn(self, problem: str) -> None:
        """Report that this plugin is left out.

        Args:
            problem: Why, as a predicate.
        """
        warnings.warn(f"{self.origin} {problem}; it is left out", PluginWarning, stacklevel=2)

    def load(self) -> Any:
        """Import the object of the entry point.

        Raises:
            PluginError: The import failed.
        """
        try:
            return self.point.load()
        except ModuleNotFoundError as error:
            extra = _EXTRAS.get((error.name or "").partition(".")[0])
            if extra:
                raise PluginError(
                    "missing-extra",
                    f"{self.origin} needs the module `{error.name}`, which is not installed",
                    expected=f"the extra `{extra}`: pip install '{DISTRIBUTION}[{extra}]'",
                ) from error
            text = f"{error}{code_position(error, beyond=__file__)}"
            raise PluginError("broken-plugin", f"{self.origin} cannot be imported: {text}") from error
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            text = describe(error) + code_position(error, beyond=__file__)
            raise PluginError("broken-plugin", f"{self.origin} cannot be imported: {text}") from error


_known: tuple[object, metadata.EntryPoints] | None = None


def installed() -> metadata.EntryPoints:
    """Find the entry points of all installed packages.

    The metadata of every package is read, so it is kept until a folder of the search path changes, as it does when a
    package is installed or removed.
    """
    global _known
    state = tuple((folder, _changed(folder or os.curdir)) for folder in sys.path)
    if _known is None or _known[0] != state:
        found: metadata.EntryPoints = metadata.entry_points()  # type: ignore[assignment] # from 3.12 on
        _known = state, found
    return _known[1]


def _changed(folder: str) -> int | None:
    """When a folder changed [ns]; None if there is none."""
    try:
        return os.stat(folder).st_mtime_ns
    except OSError:
        return None


#: All plugins of a kind by their names; more than one if several packages register the same name.
Listings = Mapping[str, list[Listing]]


def built_in(kind: str, group: str) -> Listings:
    """Find the plugins of a kind that are part of this package; no other package is looked at.

    Args:
        kind: The kind.
        group: Its entry-point group.
    """
    try:
        points = metadata.distribution(DISTRIBUTION).entry_points
    except metadata.PackageNotFoundError:
        return {}
    return listings_of(kind, points.select(group=group))


def chosen(same: list[Listing]) -> Listing:
    """Return the plugin of some with the same name.

    Raises:
        PluginError: There is more than one.
    """
    if len(same) > 1:
        first, packages = same[0], " and ".join(sorted(listing.package for listing in same))
        raise PluginError(
            "ambiguous-plugin", f"the {first.kind} `{first.name}` is registered by {packages}; uninstall one of them"
        )
    return same[0]


#: Each distribution, which thus keeps its identity, with its name and version, which are read from a file.
_OWNERS: dict[int, tuple[metadata.Distribution | None, str, str]] = {}


def listings_of(kind: str, points: Iterable[metadata.EntryPoint]) -> Listings:
    """Return the plugins of a kind that are registered by some entry points."""
    found: dict[str, list[Listing]] = {}
    for point in points:
        if id(point.dist) not in _OWNERS:
            _OWNERS[id(point.dist)] = point.dist, *_owner(point.dist)
        listing = Listing(kind, point.name, point.value, *_OWNERS[id(point.dist)][1:], point)
        same = found.setdefault(point.name, [])
        # A package that is on the path twice, such as a checkout and its installation, counts once.
        if all((each.package, each.target) != (listing.package, listing.target) for each in same):
            same.append(listing)
    return found


def _owner(distribution: metadata.Distribution | None) -> tuple[str, str]:
    """The name and version of a distribution."""
    if distribution is None:
        return "unknown", ""
    # Only these lines are read: `metadata` of the distribution parses its whole description, too.
    text = distribution.read_text("METADATA") or distribution.read_text("PKG-INFO") or ""
    head = dict(line.partition(": ")[::2] for line in text.partition("\n\n")[0].splitlines())
    return head.get("Name") or "unknown", head.get("Version") or ""
