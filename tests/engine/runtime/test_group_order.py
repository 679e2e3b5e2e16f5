"""The order of groups in a file has no effect: not on what faults do to several groups at one instant, either."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from features import missing

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.execution import execute
from symaware_cli.log.digest import Digest, digest

#: A fault of each kind that concerns agents or components of several groups.
FAULTS: Mapping[str, Any] = {
    "stop": "*",
    "restart": "*.see",
    "freeze": "*.see",
    "blind": "*.see",
    "slow": {"of": "*.steer", "latency": 0.2},
    "believe": {"agent": "*", "about": "*"},
    "bias": {"of": "*.see", "state": [0.5, 0.0]},
    "noise": {"of": "*.see", "deviation": [0.1, 0.1]},
    "drop": {"sender": "*", "probability": 0.5},
    "delay": {"sender": "*", "by": 0.1},
    "deliver": {"sender": "*", "placebo": True},
    "cut": {"between": ["*", "*"]},
    "degrade": {"sender": "*", "loss": 0.5, "delay": 0.1},
    "partition": [["zebra.*"], ["ape.*"]],
    "keep": {"promise": "stay"},
    "push": {"of": "*", "by": [0.0, 0.5]},
    "place": {"of": "*", "state": [0.0, 9.0]},
    "inform": {"of": "*", "knowledge": {"goal": [0.0, 9.0]}},
    "reconfigure": {"of": "*.steer", "with": {"speed": 0.4}},
    "replace": {"of": "*.steer", "use": "control.velocity-obstacle"},
}

#: Faults without a target.
ELSEWHERE = {"restore", "prevent"}


def ran(path: Path, names: list[str], fault: Mapping[str, Any]) -> Digest:
    group = {
        "count": 2,
        "model": {"use": "single-integrator"},
        "state": {"uniform": [-1, 1]},
        "knowledge": {"goal": {"all": [5.0, 0.0]}},
        "components": {
            "see": {"use": "perception.range", "with": {"range": 9.0, "self_noise": 0.1}},
            "steer": {"use": "control.go-to-goal", "condition": "time >= 0"},
            "tell": {"use": "communication.broadcast"},
            "hear": {"use": "communication.inbox"},
            "watch": {"use": "promises.monitor"},
        },
    }
    document = {
        "symaware": 1,
        "name": "order",
        "seed": 3,
        "run": {"duration": 0.8},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": dict.fromkeys(names, group),
        "faults": {"it": fault},
        "regions": {"here": {"box": [-2, 0, -2, 2]}},
        "promises": {"stay": {"of": "zebra", "to": ["ape", "mole"], "formula": "always inside(position, here)"}},
        "recording": {"events": "all"},
    }
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    log = path.with_suffix(".mcap")
    assert execute(build(path), log).status == "finished"
    return digest(open_log(log))


def test_every_kind_of_fault_with_a_target_is_tried() -> None:
    there = {each.name for each in Catalogue().listings("fault") if each.built_in}
    assert (FAULTS.keys() | ELSEWHERE) - there == {each for each in FAULTS if is_removed(each)}
    assert there <= FAULTS.keys() | ELSEWHERE


def is_removed(kind: str) -> bool:
    """Whether the installed copy has no such kind of fault (`.ci/removals.py`)."""
    return f"symaware_cli.engine.faults.{kind.replace('-', '_')}" in missing()


@pytest.mark.parametrize("kind", [each for each in FAULTS if not is_removed(each)])
def test_a_fault_of_several_groups_does_not_depend_on_their_order_in_the_file(kind: str, tmp_path: Path) -> None:
    lasting = {} if kind in ("restart", "push", "place", "inform") else {"for": 0.3}
    fault = {"at": 0.2, kind: FAULTS[kind], **lasting}
    one, other = (
        ran(tmp_path / f"{names[0]}.yaml", names, fault)
        for names in (["zebra", "ape", "mole"], ["mole", "ape", "zebra"])
    )
    assert one.channels == other.channels
