"""Every built-in plugin that can run in the small scenario of the checks conforms."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from symaware_cli import testing
from symaware_cli.language import Catalogue
from symaware_cli.testing import check_entry_points
from symaware_cli.views import DRAWING
from symaware_cli.world import InstalledPlugins

sys.path.append(str(Path(__file__).parent.parent / "engine" / "models"))
from specimens import COUPLED

#: The parameters of plugins that need some, and the changes of the scenario that they need.
PARAMETERS: Mapping[str, Mapping[str, Any]] = {
    "communication.consensus": {"name": "guess", "gain": 0.2},
    "communication.map": {"scan": "lidar", "resolution": 0.5, "within": (-5.0, 5.0, -5.0, 5.0), "interval": 0.2},
    "control.dynamic-window": {"scan": "lidar"},
    "control.follow": {"leader": "leader"},
    "control.vector-field-histogram": {"scan": "lidar"},
    "ackermann-drive": {"driven": ["left", "right"], "steered": ["port", "starboard"]},
    "articulated": {"joints": ["shoulder", "elbow"]},
    "control.random": {"inputs": [[0.1, 0.0], [0.0, 0.2]]},
    "control.schedule": {"inputs": [{"time": 0.0, "input": [0.1, 0.0]}, {"time": 0.2, "input": [0.0, 0.2]}]},
    "control.switch": {"when": "x > 0.1", "to": "spare"},
    "differential-drive": {"left": ["left"], "right": ["right"]},
    "perception.map": {"scan": "lidar", "resolution": 0.5, "within": (-5.0, 5.0, -5.0, 5.0)},
    "planning.cbs": {"within": (-5.0, 5.0, -5.0, 5.0)},
    "planning.grid": {"resolution": 0.5, "within": (-5.0, 5.0, -5.0, 5.0)},
    "planning.prioritised": {"within": (-5.0, 5.0, -5.0, 5.0)},
    "planning.roadmap": {"samples": 200, "within": (-5.0, 5.0, -5.0, 5.0)},
    "planning.rrt-star": {"iterations": 50, "within": (-5.0, 5.0, -5.0, 5.0)},
    "planning.lattice": {"turning_radius": 1.0, "within": (-5.0, 5.0, -5.0, 5.0)},
    "risk.map": {"within": (-5.0, 5.0, -5.0, 5.0)},
    "perception.range": {"range": 5.0, "position_noise": 0.1},
    "dubins-aircraft": {"min_speed": 6.0, "max_speed": 9.0, "max_turn_rate": 0.1},
    "linear": COUPLED,
    "graph": {"edges": [["robot.0", "robot.1"]]},
    "k-nearest": {"count": 2},
    "line-of-sight": {"range": 3.0},
    "range": {"range": 3.0},
    "topology random": {"probability": 0.5},
    "bias": {"of": "robot.0.sense", "state": [0.1, 0.0, 0.0]},
    "believe": {"agent": "robot.0", "about": "robot.1"},
    "blind": {"root": "robot.0.sense"},
    "cut": {"between": ["robot.0", "robot.1"]},
    "degrade": {"loss": 0.5},
    "delay": {"by": 0.1},
    "deliver": {"sender": "robot.0"},
    "drop": {"probability": 0.5},
    "freeze": {"root": "robot.0.steer"},
    "inform": {"of": "robot.0", "knowledge": {"goal": [1.0, 1.0]}},
    "keep": {"promise": "stay"},
    "noise": {"of": "robot.0.sense", "deviation": [0.1, 0.1, 0.1]},
    "prevent": {"root": "other"},
    "partition": {"root": [["robot.0"], ["robot.1"]]},
    "place": {"of": "robot.0", "state": [0.0, 0.0, 1.0]},
    "push": {"of": "robot.0", "by": [0.1, 0.0, 0.0]},
    "reconfigure": {"of": "robot.steer", "with": {"speed": 0.4}},
    "replace": {"of": "robot.steer", "use": "control.random", "with": {"inputs": [[0.0, 0.0]]}},
    "restart": {"root": "robot.0.steer"},
    "restore": {"root": "other"},
    "slow": {"of": "robot.steer", "latency": 0.1},
    "stop": {"root": "robot.0"},
}
ROADS = {
    "roads.lanes": {
        "one": {"points": [[-100.0, 0.0], [500.0, 0.0]], "speed_limit": 1.0},
        "two": {"points": [[-100.0, 3.5], [500.0, 3.5]], "speed_limit": 2.0},
    }
}
LIDAR = {"agents.robot.components.lidar": {"use": "perception.lidar", "with": {"rays": 24}}}
CHANGES: Mapping[str, Mapping[str, Any]] = {
    "control.car-following": ROADS,
    "control.dynamic-window": LIDAR,
    "control.lane-change": ROADS,
    "control.lane-keeping": ROADS,
    "control.vector-field-histogram": LIDAR,
    "communication.consensus": {"agents.robot.knowledge.guess": {"uniform": [0.0, 1.0]}},
    "control.switch": {
        "agents.robot.count": 1,
        "agents.robot.components.spare": {
            "use": "control.schedule",
            "condition": "switched[0] == 1",
            "with": {"inputs": [{"time": 0.0, "input": [0.1, 0.0]}]},
        },
    },
    "control.follow": {
        "agents.leader": {"model": {"use": "unicycle"}, "state": [3.0, 0.0, 0.0]},
        "agents.robot.knowledge.offset": {"all": [-1.0, 0.0]},
    },
    "control.pure-pursuit": {
        "agents.robot.model.use": "bicycle",
        "agents.robot.knowledge.waypoints": {"all": [[0.0, 0.0], [3.0, 1.0]]},
    },
    "control.waypoints": {"agents.robot.knowledge.waypoints": {"all": [[0.0, 0.0], [3.0, 1.0]]}},
    "communication.map": LIDAR,
    "perception.map": LIDAR,
    "control.timed-waypoints": {
        "agents.robot.knowledge.timed_waypoints": {"all": [[0.0, 0.0, 0.0], [3.0, 3.0, 1.0]]},
    },
    "planning.cbs": {"agents.robot.knowledge": {"goal": [[3.0, 1.0], [-2.0, 1.0], [0.0, -3.0]]}},
    "planning.grid": {"agents.robot.knowledge": {"goal": {"all": [3.0, 1.0]}}},
    "planning.prioritised": {"agents.robot.knowledge": {"goal": [[3.0, 1.0], [-2.0, 1.0], [0.0, -3.0]]}},
    "planning.roadmap": {"agents.robot.knowledge": {"goal": {"all": [3.0, 1.0]}}},
    "planning.rrt-star": {"agents.robot.knowledge": {"goal": {"all": [3.0, 1.0]}}},
    "planning.lattice": {"agents.robot.knowledge": {"goal": {"all": [3.0, 1.0]}}},
    "prediction.error": {"agents.robot.components.estimate": {"use": "uncertainty.conformal"}},
    "keep": {
        "agents.robot.components.watch": {"use": "promises.monitor"},
        "regions.here": {"box": [-9.0, 0.2, -9.0, 9.0]},
        "promises.stay": {"of": "robot.0", "to": "robot", "formula": "always inside(position, here)"},
    },
    "prevent": {"faults.other": {"at": 0.05, "stop": "robot.1"}},
    "restore": {"faults.other": {"at": 0.05, "stop": "robot.1"}},
}

#: Plugins that are tested elsewhere, with the reason.
EXCLUDED = {
    "control.policy": "reads a file: `tests/learning/test_policy_controller.py`",
    "control.cells": "needs a knowledge model",
    "control.mpc": "starts each search from the last one, which is kept in the solver",
    "control.quadrotor-velocity": "needs a quadrotor in pybullet",
    "control.stl": "needs specifications",
    "fmu": "needs a file that is trusted",
    "knowledge.blocked-cells": "needs a knowledge model",
    "knowledge.strategy": "needs a knowledge model",
    "memory": "carries no frames",
    "perception.bag": "needs a recording",
    "perception.camera": "needs images",
    "risk.specification": "needs specifications",
    "zenoh": "leaves threads of its own behind",
}

KINDS = ("component", "drawing", "environment", "fault", "metric", "model", "topology", "transport")


def catalogue() -> InstalledPlugins:
    found = Catalogue()
    found.add_sections()
    found.add([DRAWING])
    return found


INSTALLED = catalogue()
BUILT_IN = [
    (kind, listing.name)
    for kind in KINDS
    for listing in INSTALLED.listings(kind)
    if listing.built_in and listing.name not in EXCLUDED
]


@pytest.mark.parametrize(("kind", "name"), BUILT_IN)
def test_a_built_in_plugin_conforms(kind: str, name: str) -> None:
    check = getattr(testing, f"check_{kind}")
    parameters = PARAMETERS.get(f"{kind} {name}", PARAMETERS.get(name, {}))
    arguments = [] if name not in CHANGES else [CHANGES[name]]
    check(INSTALLED.load(kind, name), *arguments, **parameters)


def test_excluded_plugins_exist() -> None:
    names = {listing.name for kind in KINDS for listing in INSTALLED.listings(kind)}
    assert set(EXCLUDED) <= names


def test_the_entry_points_of_the_package_itself_conform() -> None:
    check_entry_points("symaware-cli")
