"""Five drones satisfy the tasks of the scenario, by its monitors; barriers agree with these."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml
from drone_flights import SCENARIOS, fly
from simulating import in_process as command
from symaware_drones.schedule import Schedule, ScheduledTask
from symaware_drones.task import Task

from symaware_cli import Log
from symaware_cli.formulas import Region

ETA, FACES = 20.0, 5
FIRST, WHOLE = "run.duration=7.5", "run.duration=28"
PHASE = ("point-1", "slot-0-1", "slot-1-1", "slot-2-1", "slot-3-1")
#: When the pentagons are to be entered and left [s], as the controllers choose it.
TIMES = {
    "point": [(3, 6), (15, 18), (23, 23)],
    "slot": [(6, 7), (12, 16), (24, 28)],
}


def robustness(log: Log) -> dict[str, float]:
    """The least robustness of each specification, from the monitors."""
    return {each.name: each.robustness for each in log.outcomes if each.robustness is not None}


def interval(name: str) -> tuple[int, int]:
    kind, *_, phase = name.split("-")
    return (13, 16) if name == "slot-2-2" else TIMES[kind][int(phase) - 1]


def scheduled(regions: dict[str, Region], starts: dict[str, tuple[float, float]]) -> dict[str, ScheduledTask]:
    """The tasks by name, as the controllers schedule them from where the drones are at first."""
    tasks = []
    for name, region in regions.items():
        kind, *which, phase = name.replace("area", "point").split("_")
        label = "-".join([kind, *which, phase])
        begin, end = (int(second * 1e9) for second in interval(label))
        agents = ("hub", f"drone.{which[0]}") if which else ("hub",)
        corners = tuple((x, y) for x, y in region.polygon or ())
        tasks.append(Task(label, agents, corners, begin, begin, end - begin))
    schedule = Schedule(tasks, starts)
    return {each.task.name: each for every in schedule.tasks.values() for each in every}


def check_agreement(log: Log) -> int:
    """Check that barriers and predicates agree at every sample; returns at how many they were due.

    With the widths g of the faces, which are 0 once a task is due, b <= least of margin + g <= b + ln(n) / eta.
    """
    said = yaml.safe_load(log.attachments["resolved.yaml"])["regions"]
    regions = {name: Region.model_validate(region) for name, region in said.items()}
    compared = 0
    agents = ("hub", *(f"drone.{number}" for number in range(4)))
    hub = log.series("hub", "world")
    for agent in agents:
        own, barriers = log.series(agent, "world"), log.series(agent, "steer.barrier")
        places = np.searchsorted(own.times, barriers.times)
        assert (own.times[places] == barriers.times).all()
        # The hub may have moved before a drone knows that it leads.
        first = {
            id: each.values[np.searchsorted(each.times, barriers.times[0], "right") - 1]
            for id, each in ((id, log.series(id, "world")) for id in agents)
        }
        tasks = scheduled(regions, {id: (float(start[0]), float(start[1])) for id, start in first.items()})
        for column, name in enumerate(barriers.columns):
            if agent not in ("hub", f"drone.{name.split('-')[1]}") or (agent == "hub" and name.startswith("slot")):
                continue
            values, seconds = barriers.values[:, column], barriers.seconds
            known = np.isfinite(values)
            region = regions[name.replace("-", "_").replace("point", "area")]
            points = own.values[places] - (hub.values[places] if region.around else 0.0)
            corners = np.array(region.polygon)
            along = np.roll(corners, -1, axis=0) - corners
            normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
            faces = np.sum(normals * corners, axis=1) - points @ normals.T
            margins = faces.min(axis=1)
            start, end = interval(name)
            early = known & (seconds < start)
            widths = [tasks[name].width(now) for now in barriers.times[early].tolist()]
            least = (faces[early] + np.array(widths).reshape(-1, FACES)).min(axis=1, initial=np.inf)
            assert (values[early] <= least + 1e-9).all(), name
            assert (least <= values[early] + math.log(FACES) / ETA + 1e-9).all(), name
            due = known & (seconds >= start) & (seconds <= end)
            assert (values[due] <= margins[due] + 1e-9).all(), name
            assert (margins[due] <= values[due] + math.log(FACES) / ETA + 1e-9).all(), name
            assert not known[seconds > end].any(), name
            compared += int(due.sum())
    return compared


def greatest_speed(log: Log) -> float:
    """The greatest norm of the requested inputs [m/s]."""
    agents = ("hub", *(f"drone.{number}" for number in range(4)))
    return max(float(np.hypot(*log.series(agent, "requested_control").values.T).max()) for agent in agents)


@pytest.mark.parametrize("scenario", ["five-drones.yaml", "asynchronous.yaml"])
def test_the_first_tasks_hold_in_both_modes_and_barriers_agree_with_predicates(scenario: str) -> None:
    log = fly(scenario, FIRST)
    found = robustness(log)
    assert min(found[name] for name in PHASE) > 0.005
    assert check_agreement(log) > 700
    assert greatest_speed(log) <= 3.0 + 1e-9


def test_every_drone_knows_the_leaders() -> None:
    said = [event.text for event in fly("five-drones.yaml", FIRST).events() if event.name == "decided"]
    assert said == ["follows drone.0, drone.1, drone.2, drone.3", *["leads hub"] * 4]


@pytest.mark.parametrize(
    ("override", "said"),
    [
        (
            "topology={use: ring}",
            "`slot-1-1` of drone.1 and hub needs messages from drone.1 to hub, and there is no link",
        ),
        ("agents.hub.state=[0, -20]", "`point-1` of hub cannot be met"),
        ("regions.area_2.polygon.centre=[2, 6]", None),
        ("specifications.point-2.formula=always[0, 3] inside(position, area_2) or time > 3", "is no task"),
        ("regions.slot_1_1.turns=true", "the region `slot_1_1` turns with hub; set `turns: false`"),
    ],
)
def test_impossible_tasks_are_reported_before_the_run(override: str, said: str | None) -> None:
    done = command("validate", SCENARIOS / "five-drones.yaml", "--set", override)
    if said is None:
        assert done.returncode == 0, done.stderr
    else:
        assert done.returncode == 2
        assert said in done.stderr


def test_without_a_link_the_common_task_fails_and_both_ends_report_its_beginning() -> None:
    log = fly("lost-link.yaml")
    assert [name for name in PHASE if robustness(log)[name] <= 0] == ["slot-1-1"]
    said = {event.name: event for event in log.events() if event.name in ("unheard", "unanswered")}
    assert said["unheard"].source == "agents.hub.steer"
    assert said["unanswered"].source == "agents.drone.1.steer"
    for event in said.values():
        assert (event.data["since"], event.data["tasks"]) == (pytest.approx(3.99), ["slot-1-1"])


#: How the runs that several tests look at are shortened, or lengthened.
LASTING = {"asynchronous.yaml": [WHOLE], "five-drones.yaml": [FIRST], "quadrotors.yaml": [FIRST]}


@pytest.mark.parametrize("scenario", ["five-drones.yaml", "lost-link.yaml"])
def test_drones_keep_apart(scenario: str) -> None:
    keep_apart(fly(scenario, *LASTING.get(scenario, ())))


# The group lets one process make the run that several tests look at.
@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario",
    [
        pytest.param(name, marks=pytest.mark.xdist_group(name))
        for name in ("asynchronous.yaml", "late-messages.yaml", "lost-drone.yaml", "quadrotors.yaml")
    ],
)
def test_drones_keep_apart_with_late_messages_without_one_and_as_quadrotors(scenario: str) -> None:
    keep_apart(fly(scenario, *LASTING.get(scenario, ())))


def keep_apart(log: Log) -> None:
    found = {each.name: (each.robustness, each.verdict) for each in log.outcomes}
    for name in ("apart", "apart-from-hub"):
        least, verdict = found[name]
        assert least is not None
        assert least > 0.01
        assert verdict != "violated"
    assert not list(log.contacts())


def test_drones_overlap_with_the_published_parameters() -> None:
    """They do not avoid each other there: the specifications would say so."""
    log = fly("published.yaml", "run.duration=4")
    assert not {"apart", "apart-from-hub"} & {each.name for each in log.outcomes}
    assert [(each.a, each.b) for each in log.contacts() if each.stage == "BEGIN"] == [("drone.2", "drone.3")]


def test_each_drone_knows_its_own_tasks_only() -> None:
    log = fly("five-drones.yaml", FIRST)
    known = {each.agent: each.values["tasks"] for each in log.knowledge() if "tasks" in each.values}
    assert len(known["hub"]) == 15
    assert {id: names for id, names in known.items() if id != "hub"} == {
        f"drone.{j}": [f"slot-{j}-{phase}" for phase in (1, 2, 3)] for j in range(4)
    }


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("agents.drone.knowledge.tasks={all: [slot-0-1]}", "drone.0 must know `slot-0-2`, a task of its own"),
        ("agents.hub.knowledge.tasks=point-1", "hub must know its `tasks`, a list of names: point-1"),
        ("agents.hub.knowledge=null", "tasks"),
    ],
)
def test_a_drone_that_lacks_a_task_is_refused_before_the_run(override: str, said: str) -> None:
    done = command("validate", SCENARIOS / "five-drones.yaml", "--set", override)
    assert done.returncode == 2
    assert said in done.stderr


@pytest.mark.slow
@pytest.mark.xdist_group("late-messages.yaml")
def test_messages_that_are_two_samples_late_are_survived() -> None:
    log = fly("late-messages.yaml")
    assert min(robustness(log)[name] for name in PHASE) > 0.005
    assert log.series("drone.0", "steer.round").values[-1, -1] > 700  # rounds that were not complete in time


@pytest.mark.slow
@pytest.mark.xdist_group("lost-drone.yaml")
def test_a_drone_that_fails_takes_no_other_task_with_it() -> None:
    log = fly("lost-drone.yaml")
    assert [name for name in PHASE if robustness(log)[name] <= 0] == ["slot-3-1"]
    assert [event.data["neighbour"] for event in log.events() if event.name == "unheard"] == ["drone.3"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario",
    ["five-drones.yaml", pytest.param("asynchronous.yaml", marks=pytest.mark.xdist_group("asynchronous.yaml"))],
)
def test_all_tasks_hold(scenario: str) -> None:
    log = fly(scenario, WHOLE)
    found = robustness(log)
    assert len(found) == 17
    assert min(found.values()) > 0.005
    assert check_agreement(log) > 3000
    assert greatest_speed(log) <= 3.0 + 1e-9


@pytest.mark.slow
@pytest.mark.xdist_group("quadrotors.yaml")
def test_the_cameras_follow_the_two_points_of_interest() -> None:
    log = fly("quadrotors.yaml", FIRST)
    seen = set()
    for group in ("hub", "drone"):
        for message in log.messages([f"/agents/{group}/image/look"]):
            target = tuple(round(each, 6) for each in message.decode().target[:2])
            assert target == ((3.0, 3.0) if message.time < 6e9 else (0.0, 6.0))
            seen.add(target)
    assert len(seen) == 2
