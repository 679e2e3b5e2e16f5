"""What stands in a recording, beside what stands in the log."""

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from outlines import distance, placed
from plot_logs import AIRCRAFT, YARD, log_of
from rerun_files import STEP, Recording, Script, group, saved
from simulating import Team, simulate

from symaware_cli import AwarenessVector, Component, Log, Shape, TimeSeries
from symaware_cli.engine.components.perception import OmniscientPerception, SelfPerception
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log import wire
from symaware_cli.views.palette import AGENTS, MOVABLE, RISK
from symaware_cli.views.plotting.content import gather
from symaware_cli.views.plotting.panels import Trajectories
from symaware_cli.views.plotting.request import PlotRequest

DISC = {"circle": {"radius": 0.5}}


def colour(packed: int) -> list[int]:
    return [packed >> 24, packed >> 16 & 255, packed >> 8 & 255]


@pytest.fixture(scope="module")
def yard(tmp_path_factory: pytest.TempPathFactory) -> tuple[Log, Recording]:
    folder = tmp_path_factory.mktemp("yard")
    log = log_of(folder, YARD)
    return log, saved(log, folder)


def test_boxes_are_where_their_agents_truly_are(yard: tuple[Log, Recording]) -> None:
    log, recording = yard
    truth = log.series("cart", "world")
    assert recording.times("/world/agents/cart/body", "Boxes3D:centers") == truth.times.tolist()
    centres = np.array(recording.values("/world/agents/cart/body", "Boxes3D:centers"))
    np.testing.assert_array_equal(centres[..., :2], truth.values[..., :2].astype(np.float32))
    turned = np.array(recording.values("/world/agents/cart/body", "Boxes3D:quaternions"))
    headings = 2.0 * np.arctan2(turned[..., 2], turned[..., 3])
    np.testing.assert_allclose(np.cos(headings), np.cos(truth.values[..., 2]), atol=1e-5)


def test_polygons_are_drawn_around_where_their_agents_are(yard: tuple[Log, Recording]) -> None:
    log, recording = yard
    truth = log.series("guard", "world")
    strips = np.array(recording.values("/world/agents/guard/body", "LineStrips3D:strips"))
    assert strips.shape == (len(truth.times), 1, 4, 3)
    np.testing.assert_allclose(strips[:, 0, 0, :2] - truth.values[:, :2], [[-0.3, -0.3]] * len(strips), atol=1e-5)


def test_goals_and_waypoints_are_crosses_in_their_places(yard: tuple[Log, Recording]) -> None:
    _, recording = yard
    (carts,) = recording.values("/world/agents/cart/goal", "LineStrips3D:strips")
    assert sorted({tuple(np.mean(stroke, axis=0).round(4)[:2].tolist()) for stroke in carts}) == [(-2, 0.3), (2, 0)]
    (guard,) = recording.values("/world/agents/guard/goal/way", "LineStrips3D:strips")
    assert [list(map(list, np.array(strip)[:, :2].tolist())) for strip in guard][-1] == [[-1, -1], [1, -1]]


def test_of_many_waypoints_only_the_last_is_a_cross(tmp_path: Path) -> None:
    way = "[[-1, -1], [1, -1], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2]]"
    log = log_of(tmp_path, YARD.replace("[[-1, -1], [1, -1]]", way), "run.duration=0.2")
    recording = saved(log, tmp_path)
    (strokes,) = recording.values("/world/agents/guard/goal", "LineStrips3D:strips")
    assert {tuple(np.mean(stroke, axis=0).round(4)[:2].tolist()) for stroke in strokes} == {(0, 2)}
    (dots,) = recording.values("/world/agents/guard/goal/waypoints", "Points3D:positions")
    assert np.array(dots)[:, :2].tolist() == [[-1, -1], [1, -1], [2, 0], [2, 1], [2, 2], [1, 2]]
    assert "/world/agents/cart/goal/waypoints" not in recording.entities
    plane = gather(log, PlotRequest()).panels[0]
    assert isinstance(plane, Trajectories)
    assert plane.goals["guard"].tolist() == [[0, 2]]
    np.testing.assert_array_equal(plane.waypoints["guard"], np.array(dots)[:, :2])


def test_a_gate_moves_and_a_pillar_stays(yard: tuple[Log, Recording]) -> None:
    log, recording = yard
    gate = np.array(recording.values("/world/scenery/gate", "Transform3D:translation"))[:, 0]
    np.testing.assert_array_equal(gate[:, :2], log.series("gate", "world").values[:, :2].astype(np.float32))
    assert recording.values("/world/scenery/pillar", "Transform3D:translation") == [[[0, 2, 0]]]
    assert {"/world/scenery/fence/0", "/world/scenery/fence/1"} <= recording.entities


def test_curves_are_what_the_log_says_with_names_and_units(yard: tuple[Log, Recording]) -> None:
    log, recording = yard
    state = log.series("cart.1", "state")
    path = "/curves/agents/cart.1/state"
    assert recording.static(path, "SeriesLines:names") == ["x [m]", "y [m]", "heading [rad]"]
    frames = log.series("cart", "state")
    assert recording.times(path, "Scalars:scalars") == frames.times.tolist()
    np.testing.assert_array_equal(recording.values(path, "Scalars:scalars"), frames.values[:, 1])
    assert len(state.times) <= len(frames.times)
    risks = log.series("cart", "risk").values[..., 0]
    np.testing.assert_array_equal(recording.values("/curves/risk/cart", "Scalars:scalars"), risks)


def test_separation_is_the_least_between_any_two_outlines(yard: tuple[Log, Recording]) -> None:
    log, recording = yard
    carts, guard = log.series("cart", "world"), log.series("guard", "world")
    shapes = [Shape.model_validate(log.manifest["groups"][name]["entity"]["shape"]) for name in ("cart", "guard")]
    shown = np.array(recording.values("/curves/separation/smallest", "Scalars:scalars"))[:, 0]
    for step in range(0, len(shown), 7):
        bodies = [placed(shapes[0], state[:2], state[2])[0] for state in carts.values[step]]
        heading = guard.values[step][2] if len(guard.values[step]) > 2 else 0.0
        bodies.append(placed(shapes[1], guard.values[step][:2], heading)[0])
        assert shown[step] == pytest.approx(min(distance(*pair) for pair in itertools.combinations(bodies, 2)))


def test_where_curves_are_thinned_extremes_stay(yard: tuple[Log, Recording]) -> None:
    _, recording = yard
    kept = {
        "/curves/risk/cart": "Max",
        "/curves/separation/smallest": "Min",
        "/curves/agents/cart.0/risk": "Max",
        "/curves/agents/cart.0/state": "MinMax",
    }
    policies = rr.components.AggregationPolicy
    for path, policy in kept.items():
        assert recording.static(path, "SeriesLines:aggregation_policy") == [getattr(policies, policy).value], path


def test_intents_run_ahead_of_their_agents_and_fade(yard: tuple[Log, Recording]) -> None:
    log, recording = yard
    path = "/awareness/cart/intent"
    first, colours = recording.values(path, "LineStrips3D:strips")[0], recording.values(path, "LineStrips3D:colors")[0]
    prediction = next(log.predictions("cart.0", "intent"))
    np.testing.assert_array_equal(first[0][0][:2], prediction.values[0, :2].astype(np.float32))
    brightness = [sum(colour(each)) for each in colours[: len(colours) // 2]]
    assert brightness == sorted(brightness, reverse=True)
    assert brightness[0] > 2 * brightness[-1]


def test_every_event_is_a_line_with_its_time_and_level(yard: tuple[Log, Recording]) -> None:
    log, recording = yard
    lines = recording.values("/log/events", "TextLog:text")
    assert len(lines) == len(list(log.events()))
    assert "started" in lines[0][0]
    levels = {level for (level,) in recording.values("/log/events", "TextLog:level")}
    assert levels <= {"INFO", "WARN", "ERROR", "DEBUG"}


def test_in_space_bodies_are_at_their_height(tmp_path: Path) -> None:
    log = log_of(tmp_path, AIRCRAFT)
    positions = np.array(saved(log, tmp_path).values("/world/agents/plane/body", "Points3D:positions"))
    np.testing.assert_array_equal(positions, log.series("plane", "world").values[..., :3].astype(np.float32))


def test_a_few_agents_are_drawn_as_red_as_their_risk_was(tmp_path: Path) -> None:
    script = Script(tmp_path / "a.mcap", {"a": group("a.0", "a.1", shape=DISC)})
    for step in range(3):
        script.say("/world/a/state", step * STEP, wire.encode_rows([[0, 0], [step, 1]]), "Rows")
    script.say("/agents/a/risk", STEP, wire.encode_series([0], [[[1.0]]], rows=[1]), "SeriesRows", "risk")
    script.say("/agents/a/risk", 2 * STEP, wire.encode_series([0], [[[np.inf]], [[np.nan]]]), "SeriesRows", "risk")
    recording = saved(script.finish(), tmp_path)
    shown = [[colour(each) for each in row] for row in recording.values("/world/agents/a/body", "Points3D:colors")]
    own = [list(AGENTS[0]), list(AGENTS[1])]
    assert shown == [own, [own[0], list(RISK)], [list(RISK), own[1]]]


def test_a_risk_that_is_unset_again_tints_nobody(tmp_path: Path) -> None:
    script = Script(tmp_path / "a.mcap", {"a": group("a.0", "a.1", shape=DISC)})
    script.say("/agents/a/risk", 0, wire.encode_series([], np.empty((2, 0, 0))), "SeriesRows")
    script.say("/agents/a/risk", STEP, wire.encode_series([0], np.ones((2, 1, 1))), "SeriesRows")
    script.say("/agents/a/risk", 2 * STEP, wire.encode_series([], np.empty((2, 0, 1))), "SeriesRows")
    for step in range(3):
        script.say("/world/a/state", step * STEP, wire.encode_rows([[0, 0], [step, 1]]), "Rows")
    recording = saved(script.finish(), tmp_path)
    reds = [colour(row[0]) == list(RISK) for row in recording.values("/world/agents/a/body", "Points3D:colors")]
    assert reds == [False, True, False]


def test_a_group_without_recorded_truth_is_drawn_where_it_believes_to_be(tmp_path: Path) -> None:
    log = log_of(tmp_path, YARD, "recording.omit=[world]")
    recording = saved(log, tmp_path)
    centres = np.array(recording.values("/world/agents/cart/body", "Boxes3D:centers"))
    believed = log.series("cart", "state")
    np.testing.assert_array_equal(centres[..., :2], believed.values[..., :2].astype(np.float32))
    assert "believed)" in recording.static("/about", "TextDocument:text")[0]
    assert recording.values("/world/scenery/gate", "Transform3D:translation") == [[[-2, 3, 0]]]


@pytest.mark.parametrize("kind", ["cylinder", "mesh"])
def test_a_shape_that_is_round_from_above_has_its_radius(kind: str, tmp_path: Path) -> None:
    more = {"height": 1.0} if kind == "cylinder" else {"file": "a.stl"}
    script = Script(tmp_path / "a.mcap", {"a": group("a", shape={kind: {"radius": 0.7, **more}})})
    script.say("/world/a/state", 0, wire.encode_rows([[0, 0]]), "Rows")
    recording = saved(script.finish(), tmp_path)
    assert recording.static("/world/agents/a/body", "Points3D:radii") == pytest.approx([0.7])


def test_rows_that_appear_late_are_nowhere_before(tmp_path: Path) -> None:
    script = Script(tmp_path / "a.mcap", {"a": group("a.0", "a.1", "a.2", shape=DISC)})
    script.say("/world/a/state", 0, wire.encode_rows([[1, 1]], [1]), "Rows")
    script.say("/world/a/state", STEP, wire.encode_rows([[2, 2]], [2]), "Rows")
    script.say("/world/a/state", 2 * STEP, wire.encode_rows([[0, 0]], [0]), "Rows")
    recording = saved(script.finish(), tmp_path)
    shown = np.array(recording.values("/world/agents/a/body", "Points3D:positions"))
    assert np.isnan(shown[0, :, 0]).tolist() == [True, False, True]
    assert shown[2, :, 0].tolist() == [0, 1, 2]
    separation = np.array(recording.values("/curves/separation/smallest", "Scalars:scalars"))[:, 0]
    np.testing.assert_allclose(separation, [np.nan, np.sqrt(2) - 1, np.sqrt(2) - 1])


def test_samples_are_drawn_as_a_fan(tmp_path: Path) -> None:
    script = Script(tmp_path / "a.mcap", {"a": group("a", shape=DISC)})
    fan = np.arange(12, dtype=float).reshape(1, 3, 4)
    script.say("/agents/a/uncertainty", 0, wire.encode_series([0, 1, 2], fan), "SeriesRows", "x.0,y.0,x.1,y.1")
    recording = saved(script.finish(), tmp_path)
    (ways,) = recording.values("/awareness/a/uncertainty/samples", "LineStrips3D:strips")
    assert [[point[:2] for point in way] for way in ways] == [[[0, 1], [4, 5], [8, 9]], [[2, 3], [6, 7], [10, 11]]]


def test_a_body_of_another_kind_has_a_colour_of_its_own_and_what_stays_is_grey(tmp_path: Path) -> None:
    ball = {"shape": DISC, "position": [0, 3], "heading": 0.0, "moves": True}
    obstacle_views = {"ball1": ball, "ball2": ball, "cue": ball, "rail": {**ball, "moves": False}}
    script = Script(tmp_path / "a.mcap", {"a": group("a", shape=DISC)}, obstacle_views)
    script.say("/world/a/state", 0, wire.encode_rows([[0, 0]]), "Rows")
    recording = saved(script.finish(), tmp_path)
    shades = {
        name: tuple(colour(recording.static(f"/world/scenery/{name}/0", "Mesh3D:albedo_factor")[0]))
        for name in obstacle_views
    }
    assert shades["ball1"] == shades["ball2"] == MOVABLE
    assert np.ptp(shades["cue"]) > 50
    assert np.ptp(shades["rail"]) < 10


def test_messages_are_lines_at_every_stage(tmp_path: Path) -> None:
    script = Script(tmp_path / "a.mcap", {"a": group("a.0", "a.1"), "car": group("car")})
    script.message(0, "a.1", "car", stage=v1.Message.SENT, sent_time=0, payload=json.dumps("long" * 500))
    script.message(STEP, "a.1", "car", sent_time=0)
    script.message(2 * STEP, "car", "a.0", stage=v1.Message.DROPPED, sent_time=0, reason="out of range")
    recording = saved(script.finish(), tmp_path)
    lines = [text for (text,) in recording.values("/log/messages", "TextLog:text")]
    assert len(lines) == 3
    assert max(map(len, lines)) <= 300
    assert "dropped after 0.1 s (out of range)  car -> a.0  hello" in lines[-1]
    assert recording.values("/log/messages", "TextLog:level")[-1] == ["WARN"]


def test_a_contact_flashes_where_two_touch_goes_with_them_and_ends(tmp_path: Path) -> None:
    script = Script(tmp_path / "a.mcap", {"a": group("a.0", "a.1", shape=DISC)})
    for step in range(21):
        # Both drift along x; they touch from 0.2 s to 0.6 s.
        drift = 0.1 * step
        script.say("/world/a/state", step * STEP, wire.encode_rows([[drift, 0], [drift + 0.9, 0]]), "Rows")
        if step == 4:
            script.contact(step * STEP, "a.0", "a.1", point=[0.85, 0.0])
        if step == 12:
            script.contact(step * STEP, "a.0", "a.1", v1.Contact.END)
    recording = saved(script.finish(), tmp_path)
    times = recording.times("/world/contacts", "LineStrips3D:strips")
    rings = recording.values("/world/contacts", "LineStrips3D:strips")
    assert (times[0], times[-1]) == (4 * STEP, 12 * STEP)
    assert rings[-1] in ([], None)
    assert all(len(each) == 1 for each in rings[:-1])
    centres = [np.mean(np.array(each[0])[:-1], axis=0) for each in rings[:-1]]
    widths = [np.ptp(np.array(each[0])[:, 0]) for each in rings[:-1]]
    moved = np.array(times[:-1]) // STEP * 0.1
    np.testing.assert_allclose([centre[0] for centre in centres], moved + 0.45, atol=1e-5)
    assert widths[0] > 1.5 * widths[-1]


def test_a_contact_with_an_entity_is_where_the_agent_is(tmp_path: Path) -> None:
    wall = {"shape": {"box": {"length": 20, "width": 1}}, "position": [0, 10], "heading": 0.0}
    script = Script(tmp_path / "a.mcap", {"a": group("a", shape=DISC)}, {"wall": wall})
    script.say("/world/a/state", 0, wire.encode_rows([[7, 9]]), "Rows")
    script.contact(0, "a", "wall")
    script.say("/world/a/state", STEP, wire.encode_rows([[7, 9]]), "Rows")
    (ring, *_) = saved(script.finish(), tmp_path).values("/world/contacts", "LineStrips3D:strips")
    np.testing.assert_allclose(np.mean(np.array(ring[0])[:-1], axis=0)[:2], [7, 9], atol=1e-5)


def test_events_and_knowledge_of_agents_in_focus_are_modes(tmp_path: Path) -> None:
    script = Script(tmp_path / "a.mcap", {"a": group("a.0", "a.1"), "car": group("car")})
    script.knowledge(0, "car", {0: {"phase": "near", "armed": False, "goal": [1, 2]}})
    script.event(0, "slowed", "agents.car.steer")
    script.event(STEP, "woken", "agents.a.steer")  # of a whole group
    script.event(STEP, "resumed", "agents.a.1.steer", v1.Event.ERROR)
    script.knowledge(STEP, "car", {0: {"phase": "near", "armed": True}})
    recording = saved(script.finish(), tmp_path)
    assert recording.values("/modes/car", "StateChange:state") == [["slowed"]]
    assert recording.values("/modes/a.1", "StateChange:state") == [["resumed"]]
    assert recording.values("/modes/car/phase", "StateChange:state") == [["near"]]
    assert recording.times("/modes/car/armed", "StateChange:state") == [0, STEP]
    assert recording.values("/log/events", "TextLog:level")[-1] == ["ERROR"]


def test_ghosts_stand_where_others_are_believed_to_be(tmp_path: Path) -> None:
    log = log_of(tmp_path, "noisy.yaml", "run.duration=2.0")
    recording = saved(log, tmp_path)
    beliefs = log.beliefs("watcher", "straight")
    places = recording.values("/as/watcher/others", "Cylinders3D:centers")
    roster = [agent for agent in log.manifest["roster"] if agent != "watcher"]
    known = [place for place in places if place and len(place) == 2]
    assert len(known) > 30
    column = roster.index("straight")
    last = beliefs.values[np.isfinite(beliefs.values[:, 0])][-1]
    np.testing.assert_allclose(known[-1][column][:2], last[:2], rtol=1e-5)


@pytest.mark.parametrize("names", [("risk", "separation"), ("scenery", "messages"), ("contacts", "agents")])
def test_agents_may_have_names_of_parts_of_the_display(names: tuple[str, str], tmp_path: Path) -> None:
    pillar = {"shape": {"circle": {"radius": 1}}, "position": [0, 3], "heading": 0.0}
    script = Script(tmp_path / "a.mcap", {name: group(name, shape=DISC) for name in names}, {"body": pillar})
    for row, name in enumerate(names):
        script.say(f"/world/{name}/state", 0, wire.encode_rows([[row, 0]]), "Rows")
        script.say(f"/agents/{name}/state", 0, wire.encode_rows([[row, 0]]), "Rows", "x,y")
    recording = saved(script.finish(), tmp_path)
    for row, name in enumerate(names):
        assert recording.values(f"/world/agents/{name}/body", "Points3D:positions") == [[[row, 0, 0]]]
        assert recording.values(f"/curves/agents/{name}/state", "Scalars:scalars") == [[row, 0]]
    assert recording.values("/world/scenery/body", "Transform3D:translation") == [[[0, 3, 0]]]
    assert not any(entity.startswith("/curves/risk/") and entity.count("/") > 3 for entity in recording.entities)


class Guesses(Component):
    """Believes for a while to know where another means to go: first one way, then a longer one, then none."""

    def _compute(self) -> Any:
        step = self.now // STEP
        way = {1.0: [1.0, 2.0], 2.0: [3.0, 2.0]} | ({} if step < 2 else {3.0: [3.0, 6.0]})
        return TimeSeries() if step >= 4 else TimeSeries(way)

    def _update(self, value: Any) -> None:
        if self._agent.row == 0:
            others = self._agent.awareness_database
            if "robot.1" not in others:
                others["robot.1"] = AwarenessVector("robot.1", [7.0, 8.0, 0.0, 0.0], risk=TimeSeries({0.0: 0.5}))
            others["robot.1"].intent = value


def test_the_ways_that_an_agent_believes_others_to_mean_are_drawn_where_its_ghosts_stand(tmp_path: Path) -> None:
    simulate({"robot": Team({"see": SelfPerception, "guess": Guesses}, count=2)}, 7, tmp_path / "log")
    recording = saved(tmp_path / "log", tmp_path, ["robot"])
    path = "/as/robot.0/others/intent"
    assert recording.times(path, "LineStrips3D:strips") == [0, 2 * STEP, 4 * STEP]
    first, second, last = recording.values(path, "LineStrips3D:strips")
    assert first == [[[1, 2, 0], [3, 2, 0]]]
    assert second == [[[1, 2, 0], [3, 2, 0]], [[3, 2, 0], [3, 6, 0]]]
    assert not last
    assert "/as/robot.0/others/risk" not in recording.entities
    assert ("/as/robot.1/others/intent", "LineStrips3D:strips") not in recording.rows


class Expects(Component):
    """Expects another in regions that grow, for a while."""

    def _compute(self) -> Any:
        if self.now >= 2 * STEP:
            return TimeSeries()
        return TimeSeries({0.0: [1.0, 2.0, 0.0, 0.9], 1.0: [2.0, 2.0, 0.5, 0.9], 2.0: [3.0, 2.0, 1.0, 0.9]})

    def _update(self, value: Any) -> None:
        if self._agent.row == 0:
            self._agent.awareness_database.set_part("region", "robot.1", value)


def test_the_regions_in_which_an_agent_expects_others_are_rings_of_their_radii(tmp_path: Path) -> None:
    simulate({"robot": Team({"see": OmniscientPerception, "expect": Expects}, count=2)}, 4, tmp_path / "log")
    recording = saved(tmp_path / "log", tmp_path, ["robot"])
    path = "/as/robot.0/others/region"
    assert recording.times(path, "Cylinders3D:radii") == [0, 2 * STEP]
    first, last = recording.values(path, "Cylinders3D:radii")
    assert first == [0.5, 1.0]
    assert not last
    assert recording.values(path, "Cylinders3D:centers")[0] == [[2, 2, 0], [3, 2, 0]]
