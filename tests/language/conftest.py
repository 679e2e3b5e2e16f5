"""Fixtures of tests of scenarios: plugins with faults, and functions that write and build a scenario."""

import copy
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli import entry_points
from symaware_cli.language.build import Built, build
from symaware_cli.language.problem import Problem, ScenarioError

PLUGINS = Path(__file__).parent / "plugins"
SECTION_PLUGINS = Path(__file__).parent / "section_plugins"
_KNOWN = {"symaware-cli", "broken-plugins", "sound-plugins", "twin-one", "twin-two"}


@contextmanager
def only(folders: Sequence[Path], names: Collection[str]) -> Iterator[None]:
    """Install the plugins of some folders, and hide all packages but those with some names."""
    with pytest.MonkeyPatch.context() as patch:
        for folder in folders:
            patch.syspath_prepend(folder)
        points = {
            group: [point for point in points if point.package in names]
            for group, points in entry_points.installed().items()
        }
        patch.setattr(entry_points, "installed", lambda: points)
        yield
    for name in [each for each in sys.modules if each.partition(".")[0].endswith("_plugins")]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def known_plugins() -> Iterator[None]:
    """Install the plugins of tests/language/plugins, and hide all others on this machine."""
    with only([PLUGINS], _KNOWN):
        yield


@pytest.fixture(scope="module")
def known_sections() -> Iterator[None]:
    """The same with those that add sections to scenarios."""
    with only([PLUGINS, SECTION_PLUGINS], {*_KNOWN, "weather-plugins"}):
        yield


@pytest.fixture
def sound() -> dict[str, Any]:
    """A scenario to change: two unicycles that go to a goal."""
    return {
        "symaware": 1,
        "name": "sound",
        "seed": 5,
        "run": {"duration": 1.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": {
            "robot": {
                "count": 2,
                "model": {"use": "unicycle"},
                "state": {"circle": {"radius": 5.0}},
                "knowledge": {"goal": [0, 0]},
                "components": {"sense": {"use": "perception.self"}, "steer": {"use": "control.go-to-goal"}},
            }
        },
    }


@pytest.fixture
def building(tmp_path: Path, sound: dict[str, Any]) -> Callable[..., Built]:
    """Build a document from plain data, by default the sound one; keywords replace fields of its group `robot`."""

    def make(document: dict[str, Any] | None = None, *, seed: int | None = None, **robot: Any) -> Built:
        content = copy.deepcopy(sound if document is None else document)
        content["agents"]["robot"] |= robot
        path = tmp_path / "scenario.yaml"
        path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        return build(path, seed=seed, name="scenario.yaml")

    return make


@pytest.fixture
def problems(building: Callable[..., Built]) -> Callable[..., list[Problem]]:
    """Build a document that has problems, and return them."""

    def make(*arguments: Any, **robot: Any) -> list[Problem]:
        with pytest.raises(ScenarioError) as raised:
            building(*arguments, **robot)
        return list(raised.value.problems)

    return make
