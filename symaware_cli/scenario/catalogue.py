"""The catalogue of installed plugins, found through entry points and imported only when they are used."""

from __future__ import annotations

import inspect
import os
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from typing import Any

from pydantic import BaseModel

from symaware_cli.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.core import Component, Environment, GroupComponent, Metric, Model
from symaware_cli.distributed.transport import Transport
from symaware_cli.network.topology.topology import Topology
from symaware_cli.runtime.failure import describe
from symaware_cli.scenario.problem import nearest, quoted

#: The kinds of plugins, and the entry-point group of each.
GROUPS = {
    "abstraction": "symaware.abstractions",
    "component": "symaware.components",
    "environment": "symaware.environments",
    "metric": "symaware.metrics",
    "model": "symaware.models",
    "topology": "symaware.topologies",
    "transport": "symaware.transports",
}

#: The plurals of the kinds.
PLURALS = {kind: group.rpartition(".")[2] for kind, group in GROUPS.items()}

_BASES: Mapping[str, tuple[type, ...]] = {
    "abstraction": (KnowledgeModel,),
    "component": (Component, GroupComponent),
    "environment": (Environment,),
    "metric": (Metric,),
    "model": (Model,),
    "topology": (Topology,),
    "transport": (Transport,),
}

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

_DISTRIBUTION = "symaware-cli"


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


@dataclass(frozen=True, slots=True)
class Listing:
    """A plugin that is installed, but not necessarily imported.

    Attributes:
        kind: A key of `GROUPS`.
        name: Its entry-point name.
        target: Its class, as ``module:Class``.
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
        return self.package == _DISTRIBUTION


class Catalogue:
    """The installed plugins."""

    @cached_property
    def _found(self) -> Mapping[str, Mapping[str, list[tuple[Listing, metadata.EntryPoint]]]]:
        found: dict[str, dict[str, list[tuple[Listing, metadata.EntryPoint]]]] = {kind: {} for kind in GROUPS}
        # Called once, because each call reads the metadata of every installed package.
        points = metadata.entry_points()
        owners: dict[int, tuple[str, str]] = {}
        for kind, group in GROUPS.items():
            for point in points.select(group=group):
                if id(point.dist) not in owners:
                    owners[id(point.dist)] = (point.dist.name, point.dist.version) if point.dist else ("", "")
                package, version = owners[id(point.dist)]
                listing = Listing(kind, point.name, point.value, package or "unknown", version or "")
                same = found[kind].setdefault(point.name, [])
                # A package that is on the path twice, such as a checkout and its installation, counts once.
                if all((each.package, each.target) != (listing.package, listing.target) for each, _ in same):
                    same.append((listing, point))
        return found

    def listings(self, kind: str) -> list[Listing]:
        """All plugins of a kind, sorted by name; none is imported."""
        return sorted(
            (listing for same in self._found[kind].values() for listing, _ in same),
            key=lambda listing: (listing.name, listing.package),
        )

    def find(self, name: str) -> list[Listing]:
        """All plugins with a name, of any kind."""
        return [listing for kind in GROUPS for listing in self.listings(kind) if listing.name == name]

    def load(self, kind: str, name: str) -> Any:
        """Import the class of a plugin.

        Raises:
            PluginError: There is no such plugin, more than one, or it cannot be used.
        """
        same = self._found[kind].get(name)
        if not same:
            raise self._unknown(kind, name)
        if len(same) > 1:
            packages = " and ".join(sorted(listing.package for listing, _ in same))
            raise PluginError(
                "ambiguous-plugin", f"the {kind} `{name}` is registered by {packages}; uninstall one of them"
            )
        listing, point = same[0]
        origin = f"the {kind} `{name}` of {listing.package} {listing.version}".rstrip()
        loaded = _imported(point, origin)
        fault = _fault(kind, loaded)
        if fault:
            raise PluginError("broken-plugin", f"{origin} {fault}")
        return loaded

    def _unknown(self, kind: str, name: str) -> PluginError:
        everything = f"a name that `symaware list {PLURALS[kind]}` shows"
        for other in GROUPS:
            if other != kind and name in self._found[other]:
                article = "an" if other[0] in "aeiou" else "a"
                return PluginError("unknown-plugin", f"`{name}` is {article} {other}, not a {kind}", everything)
        known = sorted(self._found[kind])
        suggestion = nearest(name, known)
        # Only names of the same family, the part before the dot, are listed.
        family = [each for each in known if each.rpartition(".")[0] == name.rpartition(".")[0]]
        listed = f"one of {', '.join(family)}" if family and len(family) <= 12 and not suggestion else everything
        return PluginError("unknown-plugin", f"no {kind} called {quoted(name)} is installed", listed, suggestion)


def _imported(point: metadata.EntryPoint, origin: str) -> Any:
    """Import the object of an entry point.

    Raises:
        PluginError: The import failed.
    """
    try:
        return point.load()
    except ModuleNotFoundError as error:
        extra = _EXTRAS.get((error.name or "").partition(".")[0])
        if extra:
            raise PluginError(
                "missing-extra",
                f"{origin} needs the module `{error.name}`, which is not installed",
                expected=f"the extra `{extra}`: pip install '{_DISTRIBUTION}[{extra}]'",
            ) from error
        raise PluginError("broken-plugin", f"{origin} cannot be imported: {error}{code_position(error)}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        text = describe(error) + code_position(error)
        raise PluginError("broken-plugin", f"{origin} cannot be imported: {text}") from error


def code_position(error: BaseException) -> str:
    """Return the position of an error in a plugin's code, as `` (module.py, line 3)``; empty if unknown."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<") and "importlib" not in frame.filename and frame.filename != __file__
    ]
    if not frames or isinstance(error, SyntaxError):
        return ""
    return f" ({frames[-1].filename.replace(os.sep, '/').rpartition('/')[2]}, line {frames[-1].lineno})"


def _fault(kind: str, loaded: Any) -> str | None:
    """Return why an imported object is not a valid plugin, as a predicate; None if it is valid."""
    bases = " or ".join(base.__name__ for base in _BASES[kind])
    if not inspect.isclass(loaded) or not issubclass(loaded, _BASES[kind]):
        return f"is not a subclass of {bases}"
    if inspect.isabstract(loaded):
        missing = ", ".join(sorted(getattr(loaded, "__abstractmethods__", ())))
        return f"does not implement {missing}"
    parameters = getattr(loaded, "Parameters", None)
    if not inspect.isclass(parameters) or not issubclass(parameters, BaseModel):
        return "has Parameters that are not a subclass of symaware_cli.Parameters"
    return None
