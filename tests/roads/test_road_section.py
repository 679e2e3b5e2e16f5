"""Roads in scenarios: as regions, as a network, and in the log."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from road_groups import group
from simulating import present

import symaware_cli as sa
from symaware_cli.language.build import Built
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.roads.lane import Lane, lane_sides
from symaware_cli.specification.region import PlacedRegion

Road = Callable[..., Built]
SCENARIOS = Path(__file__).parents[2] / "scenarios"
KEEPING = {"use": "control.lane-keeping", "with": {"speed": 10.0}}
CROSS: dict[str, dict[str, Any]] = {
    "west": {"points": [[0, 0], [100, 0]]},
    "passing": {"points": [[0, 3.5], [100, 3.5]]},
    "oncoming": {"points": [[100, 7], [0, 7]]},
    "east": {"points": [[100, 0], [200, 0]]},
    "ramp": {"points": [[100, 0.2], [200, -30]]},
}


def depth(built: Built, name: str, *points: tuple[float, float]) -> list[float]:
    placed = PlacedRegion(name, built.simulation.groups[0].regions, lambda _: (np.full(2, np.nan), None))
    return [float(each) for each in placed.robustness(np.array(points))]


def problems(road: Road, lanes: dict[str, Any]) -> list[tuple[str, str]]:
    with pytest.raises(ScenarioError) as refused:
        road({"lanes": lanes}, car=group([0, 0, 0], KEEPING))
    return [(problem.path, problem.message) for problem in refused.value.problems]


def test_links_and_neighbours_are_derived_from_positions(road: Road) -> None:
    network = road({"lanes": CROSS}, car=group([0, 0, 0], KEEPING)).sections["roads"]
    lanes = {lane.name: lane for lane in network.lanes}
    assert lanes["west"].successors == ("east", "ramp")
    assert [lanes[name].successors for name in ("passing", "oncoming", "east")] == [(), (), ()]
    assert (lanes["west"].left_lane, lanes["passing"].right_lane) == ("passing", "west")
    assert (lanes["passing"].left_lane, lanes["oncoming"].left_lane) == (None, None), "the other way"


def test_given_links_take_precedence_over_derived_ones(road: Road) -> None:
    lanes = {**CROSS, "west": {**CROSS["west"], "successors": ["ramp"], "left": "oncoming"}}
    found = {lane.name: lane for lane in road({"lanes": lanes}, car=group([0, 0, 0], KEEPING)).sections["roads"].lanes}
    assert (found["west"].successors, found["west"].left_lane) == (("ramp",), "oncoming")


def test_lanes_and_the_road_are_regions(road: Road) -> None:
    built = road({"lanes": CROSS}, car=group([0, 0, 0], KEEPING))
    assert depth(built, "lane_west", (50, 0), (50, 3.5)) == pytest.approx([1.751, -1.749], abs=1e-9)
    assert depth(built, "road", (50, 1.0), (50, 20)) == pytest.approx([0.751, -11.249], abs=1e-9)
    assert min(depth(built, "road", (50, 1.75), (100, 0.0), (50, 5.25))) > 0.0, "where lanes meet"


def test_the_centres_of_lanes_are_regions_if_their_width_is_stated(road: Road) -> None:
    assert "lane_west_centre" not in road({"lanes": CROSS}, car=group([0, 0, 0], KEEPING)).simulation.groups[0].regions
    built = road({"lanes": CROSS, "centre": 0.4}, car=group([0, 0, 0], KEEPING))
    assert depth(built, "lane_west_centre", (50, 0), (50, -1)) == pytest.approx([0.401, -0.599], abs=1e-9)
    assert depth(built, "road", (50, 1.0)) == pytest.approx([0.751], abs=1e-9)


FORMULA = 'inside(position, lane("west").centre)'


def test_lanes_and_centres_are_named_by_their_kind_in_formulas_definitions_and_conditions(road: Road) -> None:
    car = group([0.5, 0.3, 0], {**KEEPING, "condition": 'not inside(position, lane("east").centre)'})
    stated = {
        "plain": {"formula": "always inside(position, lane_west_centre)", "each": "car"},
        "named": {"formula": f"always {FORMULA}", "each": "car"},
        "where": {"formula": "always lane", "where": {"lane": FORMULA}, "each": "car"},
        "believed": {"formula": "always inside(position, lane.west)", "each": "car", "of": "belief"},
    }
    until = 'inside(position["car"], lane("west").centre) and time > 0.5'
    more = {"run": {"duration": 2.0, "until": until}, "specifications": stated}
    summary = execute(road({"lanes": CROSS, "centre": 0.4}, more=more, car=car), None)
    assert 0.5 < summary.simulated_time < 1.0
    found = {each.name: present(each.robustness) for each in summary.specifications}
    assert found["plain"] == found["named"] == found["where"] == pytest.approx(0.101, abs=1e-3)
    assert found["believed"] > found["plain"]


@pytest.mark.parametrize(
    ("region", "said", "nearest"),
    [
        ('lane("wset")', "there is no lane `wset`", "west"),
        ('lane("west").center', "there is no part `center`", "centre"),
        ("lane", 'say which: lane["east"]', None),
        ("lane[1]", '`lane` takes a name in quotes: lane["east"]', None),
        ('line("west")', "there is no function `line`", "lane"),
    ],
)
def test_an_unknown_lane_is_reported_at_its_place(road: Road, region: str, said: str, nearest: str | None) -> None:
    more = {"specifications": {"keeps": {"formula": f"always inside(position, {region})", "each": "car"}}}
    with pytest.raises(ScenarioError) as refused:
        road({"lanes": CROSS, "centre": 0.4}, more=more, car=group([0, 0, 0], KEEPING))
    (problem,) = refused.value.problems
    assert problem.message == f"`specifications.keeps.formula`: {said}"
    assert problem.suggestion == nearest


def test_a_lane_may_not_have_the_name_of_the_centre_of_another(road: Road) -> None:
    lanes = {**CROSS, "west_centre": {"points": [[0, 50], [100, 50]]}}
    assert road({"lanes": lanes}, car=group([0, 0, 0], KEEPING))
    with pytest.raises(ScenarioError, match="would be called as the lane"):
        road({"lanes": lanes, "centre": 0.4}, car=group([0, 0, 0], KEEPING))


@given(st.lists(st.floats(-0.4, 0.4), min_size=1, max_size=12), st.floats(2.0, 5.0))
@settings(max_examples=60, deadline=None)
def test_every_point_between_the_boundaries_is_in_the_areas_of_a_lane(turns: list[float], width: float) -> None:
    headings = np.cumsum([0.0, *turns])
    centre = np.concatenate([[[0.0, 0.0]], np.cumsum(9.0 * np.stack([np.cos(headings), np.sin(headings)], 1), axis=0)])
    left, right = lane_sides(centre, np.full(len(centre), width))
    areas = Lane("one", left, right).areas()
    share = np.linspace(0.0, 1.0, 7)[:, None]
    for place in range(len(left) - 1):
        for along in (0.0, 0.3, 1.0):
            one, other = (side[place] * (1 - along) + side[place + 1] * along for side in (left, right))
            points = one * share + other * (1.0 - share)
            assert (np.max([area.depth(points) for area in areas], axis=0) >= 0.0).all()


def test_wrong_lanes_are_refused_at_their_places(road: Road) -> None:
    for lane, said in (
        ({"points": [[0, 0]]}, "a lane has at least 2 points"),
        ({"points": [[0, 0], [0, 0]]}, "points 0 and 1 are the same"),
        ({"points": [[0, 0], [9, 0]], "width": [1, 2, 3]}, "there are 3 widths for 2 points"),
    ):
        ((_, message),) = problems(road, {"one": lane})
        assert message.endswith(said)
    crossed = [[0, 0], [10, 0], [10, 10], [5, 10], [5, -5]]
    assert problems(road, {"one": {"points": crossed}}) == [
        ("roads.lanes.one.points[3]", "the centre line crosses itself here")
    ]
    unlinked = {"one": {"points": [[0, 0], [9, 0]], "successors": ["two"], "left": "one"}}
    assert problems(road, unlinked) == [
        ("roads.lanes.one.left", "there is no other lane `one`"),
        ("roads.lanes.one.successors[0]", "there is no lane `two`"),
    ]


def test_a_wrong_file_is_refused_at_its_place(road: Road, tmp_path: Path) -> None:
    content = (SCENARIOS / "maps" / "oval.xodr").read_text()
    (tmp_path / "oval.xodr").write_text(content.replace('length="40.000000000"', 'length="nan"', 1))
    with pytest.raises(ScenarioError) as refused:
        road({"file": "oval.xodr"}, car=group([0, 0, 0], KEEPING))
    (problem,) = refused.value.problems
    assert "`length` is not a finite number" in problem.message
    assert problem.span is not None
    assert (Path(problem.span.file).name, problem.span.line) == ("oval.xodr", 12)
    for name in ("oval.txt", "none.xodr"):
        (tmp_path / "oval.txt").write_text("")
        with pytest.raises(ScenarioError, match="the roads `"):
            road({"file": name}, car=group([0, 0, 0], KEEPING))


def test_a_log_with_roads_repeats_without_their_file(tmp_path: Path) -> None:
    shutil.copytree(SCENARIOS / "maps", tmp_path / "maps")
    shutil.copy(SCENARIOS / "oval.yaml", tmp_path)
    short = sa.load(tmp_path / "oval.yaml", {"run.duration": 1.0})
    short.run(output=tmp_path / "first.mcap")
    shutil.rmtree(tmp_path / "maps")
    sa.load(tmp_path / "first.mcap").run(output=tmp_path / "again.mcap")
    states = [sa.open_log(tmp_path / name).series("car", "world").values for name in ("first.mcap", "again.mcap")]
    np.testing.assert_array_equal(states[0], states[1])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_thirty_cars_change_lanes_and_never_touch(seed: int, tmp_path: Path) -> None:
    sa.load(SCENARIOS / "highway.yaml", seed=seed).run(output=tmp_path / "log.mcap")
    events = [event.name for event in sa.open_log(tmp_path / "log.mcap").events()]
    assert "contact" not in events
    assert events.count("lane-changed") >= 5
