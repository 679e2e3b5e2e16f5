"""Finds the installed worlds with the features that a scenario needs, for messages; there is no fixed list of worlds.

Reasons: docs/decisions/0081-vehicles-and-cameras.md
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from symaware_cli.entry_points import PluginError
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.problem import Problem, ScenarioError, quoted

#: What the features of worlds are called in messages (see `Environment.provides`).
_CALLED = {
    "co-simulation": "steps models that are programs, such as FMUs",
    "forces": "moves bodies by forces",
    "images": "has images",
    "mechanisms": "moves the joints of robots from files",
    "tilt": "lets entities tilt",
    "vehicles": "has vehicles",
}


def worlds_that_provide(feature: str, catalogue: Catalogue) -> Sequence[str]:
    """Return the names of the installed worlds with a feature, sorted; those that cannot be imported are left out."""
    return [name for name, world in _usable(catalogue) if feature in world.provides]


def expected_world(feature: str, catalogue: Catalogue, described: str = "") -> str:
    """Describe a world with a feature that is lacking, and name the installed worlds that have it.

    Args:
        feature: The feature.
        catalogue: The installed plugins.
        described: A description of worlds that have it; by default one of the feature.
    """
    described = described or f"a world that {_CALLED.get(feature, f'provides {feature}')}"
    found = worlds_that_provide(feature, catalogue)
    if found:
        return f"{described}: {_listed(found)}"
    missing = [f"{quoted(name)} may, with {each}" for name, each in _incomplete(catalogue).items()]
    return f"{described}; no installed one does" + "".join(f", but {each}" for each in missing)


def with_other_worlds(error: ScenarioError, catalogue: Catalogue, builds: Callable[[str], bool]) -> ScenarioError:
    """Add, to the problem that a world is not installed, the other worlds with forces that would run the scenario.

    Args:
        error: The problems of the scenario.
        catalogue: The installed plugins.
        builds: Whether the scenario can be built with another world.
    """
    codes = ("missing-extra", "unknown-plugin")
    unknown = [each for each in error.problems if each.path == "environment.use" and each.code in codes]
    if not unknown or any(each.suggestion for each in unknown):
        return error
    found = [name for name in worlds_that_provide("forces", catalogue) if builds(name)]
    return ScenarioError([_extended(each, found) for each in error.problems]) if found else error


def _extended(problem: Problem, worlds: Sequence[str]) -> Problem:
    if problem.path != "environment.use":
        return problem
    said = f"{_listed(worlds)}, which would run this scenario"
    return dataclasses.replace(problem, expected=f"{problem.expected}; or {said}" if problem.expected else said)


def _usable(catalogue: Catalogue) -> Iterator[tuple[str, Any]]:
    for name in dict.fromkeys(listing.name for listing in catalogue.listings("environment")):
        try:
            yield name, catalogue.load("environment", name)
        except PluginError:
            continue


def _incomplete(catalogue: Catalogue) -> dict[str, str]:
    """Return the extras that are missing for worlds, by the names of the worlds."""
    found = {}
    for listing in catalogue.listings("environment"):
        try:
            catalogue.load("environment", listing.name)
        except PluginError as error:
            if error.code == "missing-extra" and error.expected:
                found[listing.name] = error.expected
    return found


def _listed(names: Sequence[str]) -> str:
    *others, last = [quoted(name) for name in names]
    return f"{', '.join(others)} or {last}" if others else last
