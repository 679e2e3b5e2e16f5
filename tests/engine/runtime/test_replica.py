"""Replicas of components, served by a thread here in place of a worker process: the same bytes cross pipes."""

import os
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import pytest
import yaml

import symaware_cli.world
from symaware_cli import Log, open_log
from symaware_cli.core.verdict import SpecificationStatus
from symaware_cli.engine.runtime.replica import ReceivedStatuses, Unavailable
from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.engine.runtime.worker import serve
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.digest import digest

Run = Callable[..., tuple[RunSummary, Log]]


class ThreadChild:
    """Serves replicas in a thread, through pipes, as `PythonChild` does in a process that takes a second to start."""

    started: ClassVar[list[str]] = []

    def __init__(self, target: str) -> None:
        self.started.append(target)
        theirs_in, ours_out = os.pipe()
        ours_in, theirs_out = os.pipe()
        self.requests, self.answers = os.fdopen(ours_out, "wb"), os.fdopen(ours_in, "rb")
        self._thread = threading.Thread(target=self._serve, args=(theirs_in, theirs_out))
        self._thread.start()

    def _serve(self, incoming: int, outgoing: int) -> None:
        with os.fdopen(incoming, "rb") as requests, os.fdopen(outgoing, "wb") as answers:
            serve(requests, answers)

    def kill(self) -> None:
        """Nothing: a thread ends when its pipe is closed."""

    def close(self) -> int:
        self.requests.close()
        self._thread.join()
        self.answers.close()
        return 0


@pytest.fixture
def ran(doubles: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run agents whose component is computed in a place, and return the summary and the log."""
    monkeypatch.setattr(symaware_cli.world, "PythonChild", ThreadChild)
    monkeypatch.setattr(ThreadChild, "started", [])

    def run(agents: Mapping[str, Any], name: str = "run", **sections: Any) -> tuple[RunSummary, Log]:
        content = {
            "symaware": 1,
            "name": "replicas",
            "seed": 5,
            "run": {"mode": "asynchronous", "duration": 0.4, "workers": 1},
            "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
            "agents": agents,
            **sections,
        }
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
        summary = execute(build(tmp_path / f"{name}.yaml"), tmp_path / f"{name}.mcap")
        if name != "here":
            assert {*ThreadChild.started} == {f"{serve.__module__}:{serve.__name__}"}
        return summary, open_log(tmp_path / f"{name}.mcap")

    return run


def robots(component: Mapping[str, Any], where: str, **more: Any) -> dict[str, Any]:
    """Three agents in sight of each other, with a component that is computed in a place."""
    return {
        "count": 3,
        "model": {"use": "single-integrator"},
        "entity": {"shape": {"circle": {"radius": 0.3}}},
        "state": [[0, 0], [1, 0], [5, 5]],
        "knowledge": {"goal": [[0.5, 0], [-0.5, 0], [0, 0]]},
        "components": {
            "see": {"use": "perception.range", "with": {"range": 9.0, "position_noise": 0.1}},
            "look": {"use": "perception.lidar", "with": {"range": 9.0, "rays": 12}},
            "steer": {**component, "run_in": where},
        },
        **more,
    }


APART = {"specifications": {"apart": {"pairs": "robot", "formula": "always distance > 0.5"}}}


@pytest.mark.parametrize(
    ("use", "sections"),
    [
        ("doubles.thinker", {"recording": {"events": "all"}}),
        ("doubles.keeper", {}),
        ("doubles.gaze", {}),
        ("doubles.cautious", APART),
        ("control.go-to-goal", {}),
        ("control.velocity-obstacle", {}),
    ],
)
def test_components_compute_in_replicas_what_they_compute_in_the_run(
    use: str, sections: dict[str, Any], ran: Run
) -> None:
    logs = []
    for where in ("here", "process"):
        present = [{}, {"until": 0.3}, {"from": 0.2}] if use.startswith("control") else [{}] * 3
        summary, log = ran({"robot": robots({"use": use}, where, present=present)}, where, **sections)
        assert summary.status == "finished", summary.failure
        logs.append(digest(log).channels)
    assert logs[0] == logs[1]


def test_components_that_read_the_world_see_in_replicas_who_enters_and_leaves(ran: Run) -> None:
    logs = []
    for where in ("here", "process"):
        own = robots({"use": "control.go-to-goal"}, "here", present=[{}, {"until": 0.3}, {"from": 0.2}])
        own["components"]["look"]["run_in"] = own["components"]["see"]["run_in"] = where
        summary, log = ran({"robot": own}, where)
        assert summary.status == "finished", summary.failure
        logs.append(digest(log).channels)
    assert logs[0] == logs[1]


def test_an_exception_in_a_replica_is_a_failure_of_its_component_with_the_traceback(ran: Run) -> None:
    component = {"use": "doubles.thinker", "with": {"at": 0.2, "agent": "robot.2"}}
    summary, log = ran({"robot": robots(component, "process")})
    assert summary.status == "failed"
    (failed,) = [event for event in log.events() if event.name == "failed"]
    assert (failed.time, failed.source) == (200_000_000, "agents.robot.2.steer")
    assert "ZeroDivisionError: on purpose" in failed.data["problem"]
    assert "symaware_doubles.py" in failed.data["traceback"]


def test_a_component_that_is_restarted_has_a_new_replica(ran: Run) -> None:
    component = {"use": "doubles.thinker", "with": {"at": 0.2, "agent": "robot.2"}, "on_failure": "restart"}
    logs = []
    for where in ("here", "process"):
        summary, log = ran({"robot": robots(component, where)}, where)
        assert summary.status == "finished", summary.failure
        events = [(event.time, event.name, event.source) for event in log.events()]
        assert "restarted" in {name for _, name, _ in events}
        logs.append(events)
    assert logs[0] == logs[1]


def test_what_a_replica_lacks_is_reported_by_name() -> None:
    with pytest.raises(RuntimeError, match="has no exchange: it lives on what its agent is aware of"):
        Unavailable("exchange").send()
    assert Unavailable("world", time_step=7).time_step == 7
    with pytest.raises(AttributeError):
        Unavailable("world").__deepcopy__()


def test_a_replica_knows_the_robustness_by_measurement_of_offered_specifications_only() -> None:
    status = SpecificationStatus(None, 0.3, (-1.0, 2.0))
    statuses = ReceivedStatuses(tuple(status), {"robot.0": tuple(status)}, {"robot.0": 0.5})
    assert statuses.of("robot.0") == statuses.worst == status
    assert statuses.of("robot.1") is None
    assert statuses.measured("robot.0") == 0.5
    with pytest.raises(RuntimeError, match="the robustness of what is offered alone"):
        statuses.measured("robot.1")
