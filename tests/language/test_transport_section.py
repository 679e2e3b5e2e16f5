"""The `transport` section: read with the scenario, and used only by runs of several processes."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from spreading import goal_seekers

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.processes.tcp import Tcp


@pytest.fixture
def built(tmp_path: Path) -> Any:
    """Build a scenario with some transport, or with none."""

    def build_with(transport: Any) -> Any:
        document = {key: value for key, value in goal_seekers(distance=1.0).items() if key != "transport"}
        if transport is not None:
            document["transport"] = transport
        path = tmp_path / "goals.yaml"
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        return build(path)

    return build_with


def test_the_section_defines_the_transport_and_its_parameters(built: Any) -> None:
    transport = built({"use": "tcp", "with": {"timeout": 0.5, "maximum_frame": 4096}}).sections["transport"]
    assert isinstance(transport, Tcp)
    assert (transport.parameters.timeout, transport.parameters.maximum_frame) == (0.5, 4096)
    assert transport.parameters.members == 64


def test_the_section_may_be_left_out(built: Any) -> None:
    assert "transport" not in built(None).sections


def test_in_one_process_the_section_has_no_effect(built: Any, tmp_path: Path) -> None:
    logs = set()
    for name, transport in (("none", None), ("tcp", {"use": "tcp"}), ("memory", {"use": "memory"})):
        execute(built(transport), tmp_path / f"{name}.mcap")
        found = open_log(tmp_path / f"{name}.mcap").messages()
        logs.add(tuple((each.channel.topic, each.time, each.data) for each in found if each.channel.topic != "/timing"))
    assert len(logs) == 1


@pytest.mark.parametrize(
    ("transport", "said"),
    [
        ({"use": "tpc"}, "no transport called `tpc` is installed"),
        ({"use": "tcp", "with": {"timeout": 0}}, "expected a number of at least 0.05 [s]"),
        ({"use": "tcp", "with": {"timout": 1.0}}, "timout"),
        ({"use": "tcp", "with": {"maximum_frame": 10}}, "expected a whole number of at least 1024"),
        ({"with": {"timeout": 1.0}}, "use"),
        ("zenoh or so", "zenoh or so"),
    ],
)
def test_its_problems_are_reported(built: Any, transport: Any, said: str) -> None:
    with pytest.raises(ScenarioError) as raised:
        built(transport)
    assert len(raised.value.problems) == 1
    assert said in str(raised.value)
