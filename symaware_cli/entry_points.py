"""Plugins that installed packages register as entry points; they are imported only when they are used.

The files of entry points are read here, and not by `importlib.metadata`, whose import takes longer than reading them.
The specification: https://packaging.python.org/specifications/entry-points
Reasons: docs/decisions/0116-the-start.md
"""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from typing import Any, NamedTuple

from symaware_cli.world import code_position, describe

#: The distribution that this package is.
DISTRIBUTION = "symaware-cli"

#: With what the names of all groups begin.
_PREFIX = "symaware"

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
        expected: A description of valid values.
        suggestion: The nearest valid name.
    """

    def __init__(self, code: str, message: str, expected: str | None = None, suggestion: str | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.expected = expected
        self.suggestion = suggestion

    @property
    def sentence(self) -> str:
        """The message, with the valid values if they are known."""
        return f"{self}; expected {self.expected}" if self.expected else str(self)


class PluginWarning(UserWarning):
    """A plugin is left out, because it is broken."""


class EntryPoint(NamedTuple):
    """An entry point of an installed distribution.

    Attributes:
        group: Its group, such as ``symaware.components``.
        name: Its name.
        value: The object that it refers to, as ``module:Class``.
        package: The name of the distribution; ``unknown`` if its metadata does not have one.
        version: The version of the distribution; empty if its metadata does not have one.
    """

    group: str
    name: str
    value: str
    package: str
    version: str


class Listing(NamedTuple):
    """A plugin that is installed, but not necessarily imported.

    Attributes:
        kind: Its kind, such as ``component``.
        name: Its entry-point name.
        target: Its class or function, as ``module:Class``.
        package: The distribution that contains it.
        version: The version of that distribution.
    """

    kind: str
    name: str
    target: str
    package: str
    version: str

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
            problem: The reason, as a predicate.
        """
        warnings.warn(f"{self.origin} {problem}; it is left out", PluginWarning, stacklevel=2)

    def load(self) -> Any:
        """Import the object of the entry point.

        Raises:
            PluginError: The import failed.
        """
        try:
            # An extra in brackets is allowed by an older specification, and ignored.
            module, _, attribute = self.target.partition("[")[0].partition(":")
            loaded: Any = import_module(module.strip())
            for name in attribute.strip().split(".") if attribute.strip() else ():
                loaded = getattr(loaded, name)
            return loaded
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


#: The entry points in the groups of SymAware, by group.
EntryPoints = Mapping[str, list[EntryPoint]]

_known: tuple[object, EntryPoints] | None = None


def installed() -> EntryPoints:
    """Find the entry points of all installed packages.

    They are read again only if a folder of the search path has changed, as it does when a package is installed or
    removed.
    """
    global _known
    state = tuple((folder, _changed(folder or os.curdir)) for folder in sys.path)
    if _known is None or _known[0] != state:
        found: dict[str, list[EntryPoint]] = {}
        for package in _packages():
            for point in package.points():
                found.setdefault(point.group, []).append(point)
        _known = state, found
    return _known[1]


def points_of(distribution: str) -> list[EntryPoint] | None:
    """Find the entry points of an installed distribution in the groups of SymAware; None if it is not installed."""
    package = _package(distribution)
    return None if package is None else list(package.points())


def package_file(distribution: str, name: str) -> str | None:
    """Read a file of the metadata of an installed distribution; None if there is none.

    Args:
        distribution: The distribution.
        name: The file, such as ``direct_url.json``.
    """
    package = _package(distribution)
    return None if package is None else package.read(name)


class _Package:
    """The metadata of an installed distribution, in a folder."""

    def __init__(self, folder: str) -> None:
        self._folder = folder

    def read(self, name: str) -> str | None:
        """The text of a file; None if there is none."""
        try:
            with open(os.path.join(self._folder, name), encoding="utf-8") as file:
                return file.read()
        except (FileNotFoundError, IsADirectoryError, NotADirectoryError, PermissionError):
            return None

    def points(self) -> Iterator[EntryPoint]:
        """The entry points in the groups of SymAware."""
        text = self.read("entry_points.txt") or ""
        if _PREFIX not in text:
            return
        package, version = self._owner()
        group = ""
        for line in map(str.strip, text.splitlines()):
            if line.startswith("[") and line.endswith("]"):
                group = line.strip("[]")
            elif group.startswith(_PREFIX) and line and not line.startswith("#"):
                name, _, value = line.partition("=")
                yield EntryPoint(group, name.strip(), value.strip(), package, version)

    def _owner(self) -> tuple[str, str]:
        """The name and version."""
        # Only these lines are used: the rest is the description.
        text = self.read("METADATA") or self.read("PKG-INFO") or ""
        head = dict(line.partition(": ")[::2] for line in text.partition("\n\n")[0].splitlines())
        return head.get("Name") or "unknown", head.get("Version") or ""


class _ArchivedPackage(_Package):
    """The metadata of a distribution that is not in a folder, such as in a ZIP file."""

    def __init__(self, distribution: Any) -> None:
        super().__init__("")
        self._distribution = distribution

    def read(self, name: str) -> str | None:
        """The text of a file; None if there is none."""
        text: str | None = self._distribution.read_text(name)
        return text


def _package(distribution: str) -> _Package | None:
    """An installed distribution; None if there is none."""
    wanted = _normal(distribution)
    return next((package for name, package in _named() if name == wanted), None)


def _packages() -> Iterator[_Package]:
    """All installed distributions; of two with the same name, the first on the path is the one that is imported."""
    seen = set()
    for name, package in _named():
        if name not in seen:
            seen.add(name)
            yield package


def _named() -> Iterator[tuple[str, _Package]]:
    """Distributions in all folders of the search path, with their normalized names."""
    for folder in sys.path:
        try:
            entries = sorted(os.listdir(folder or os.curdir))
        except FileNotFoundError:
            continue
        except OSError:
            yield from _archived(folder)
            continue
        for entry in entries:
            if entry.lower().endswith((".dist-info", ".egg-info")):
                yield _normal(entry.rpartition(".")[0].partition("-")[0]), _Package(os.path.join(folder, entry))
            elif entry == "EGG-INFO" and folder.endswith(".egg"):
                yield _normal(os.path.basename(folder).partition("-")[0]), _Package(os.path.join(folder, entry))


def _archived(file: str) -> Iterator[tuple[str, _Package]]:
    from importlib import metadata

    for distribution in metadata.distributions(path=[file]):
        yield _normal(distribution.metadata["Name"] or ""), _ArchivedPackage(distribution)


def _normal(name: str) -> str:
    """Return the normalized name of a distribution (https://packaging.python.org/specifications/name-normalization)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def _changed(folder: str) -> int | None:
    """Return when a folder was last changed [ns]; None if it does not exist."""
    try:
        return os.stat(folder).st_mtime_ns
    except OSError:
        return None


#: All plugins of a kind by their names; more than one if several packages register the same name.
Listings = Mapping[str, list[Listing]]


def built_in(kind: str, group: str) -> Listings:
    """Find the plugins of a kind that are part of this package; no other package is searched.

    Args:
        kind: The kind.
        group: Its entry-point group.
    """
    return listings_of(kind, (each for each in points_of(DISTRIBUTION) or () if each.group == group))


def chosen(same: list[Listing]) -> Listing:
    """Return the only one of the plugins with a name.

    Raises:
        PluginError: There is more than one.
    """
    if len(same) > 1:
        first, packages = same[0], " and ".join(sorted(listing.package for listing in same))
        raise PluginError(
            "ambiguous-plugin", f"the {first.kind} `{first.name}` is registered by {packages}; uninstall one of them"
        )
    return same[0]


def listings_of(kind: str, points: Iterable[EntryPoint]) -> Listings:
    """Return the plugins of a kind that are registered by some entry points."""
    found: dict[str, list[Listing]] = {}
    for point in points:
        listing = Listing(kind, point.name, point.value, point.package, point.version)
        same = found.setdefault(point.name, [])
        # A package that is on the path twice, such as a checkout and its installation, counts once.
        if all((each.package, each.target) != (listing.package, listing.target) for each in same):
            same.append(listing)
    return found
