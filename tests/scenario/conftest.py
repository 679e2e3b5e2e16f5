"""What tests of scenarios share: plugins with faults, and a way to write a scenario down and build it."""

import copy
import sys
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli.scenario import catalogue
from symaware_cli.scenario.build import Built, build
from symaware_cli.scenario.problem import Problem, ScenarioError

PLUGINS = Path(__file__).parent / "plugins"
_KNOWN = {"symaware-cli", "broken-plugins", "sound-plugins", "twin-one", "twin-two"}


@pytest.fixture(scope="module")
def known_plugins() -> Iterator[None]:
    """Install the plugins of tests/scenario/plugins, and hide what else may be installed on this machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(PLUGINS)
        found = {
            group: [each for each in metadata.entry_points(group=group) if each.dist and each.dist.name in _KNOWN]
            for group in catalogue.GROUPS.values()
        }
        points = metadata.EntryPoints(point for each in found.values() for point in each)
        patch.setattr(metadata, "entry_points", lambda: points)
        yield
    for name in [each for each in sys.modules if each.partition(".")[0] in ("broken_plugins", "sound_plugins")]:
        del sys.modules[name]


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
