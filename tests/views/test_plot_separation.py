"""Separation of bodies, compared with Shapely, with all pairs, and with the contacts of the world."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from outlines import distance, placed, random_shape
from plot_logs import AIRCRAFT, SCENARIOS, YARD, log_of
from rerun_files import saved
from simulating import present

from symaware_cli import Circle, Log, Polygon, Shape, Wall, open_log
from symaware_cli.views.plotting import separation as closeness
from symaware_cli.views.plotting.content import gather
from symaware_cli.views.plotting.motion import Motion, Obstacles
from symaware_cli.views.plotting.panels import Distances
from symaware_cli.views.plotting.request import PlotRequest
from symaware_cli.views.views import run_view_of

seeds = st.integers(0, 2**32 - 1)


def motion(positions: ArrayLike, shapes: Sequence[Shape | None], headings: NDArray[np.float64] | None = None) -> Motion:
    """Agents at (k, n, 2 or 3) positions."""
    positions = np.asarray(positions, float)
    if positions.shape[2] == 2:
        positions = np.concatenate([positions, np.zeros((*positions.shape[:2], 1))], axis=2)
    headings = np.zeros(positions.shape[:2]) if headings is None else headings
    times, names = np.arange(len(positions)) * 10**9, tuple(str(number) for number in range(len(shapes)))
    return Motion(names, times, positions, headings, tuple(shapes), (True,) * len(shapes))


def separation(log: Log) -> Distances:
    return next(
        panel for panel in gather(log, PlotRequest(show=("separation",))).panels if isinstance(panel, Distances)
    )


@settings(max_examples=25)
@given(seeds, st.integers(2, 30))
def test_the_least_separation_is_that_of_all_pairs_of_outlines(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    kinds = [random_shape(random) for _ in range(3)]
    shapes = [kinds[number] for number in random.integers(3, size=count)]
    # Some are crowded, some scattered: of bodies with many corners, the nearest centre may not have the nearest
    # outline.
    positions = random.uniform(-1, 1, (3, count, 2)) * random.choice([2.0, 8.0, 30.0])
    headings = random.uniform(-3, 3, (3, count))
    found = closeness.among(motion(positions, shapes, headings))
    for step in range(3):
        bodies = [placed(shape, positions[step, row], headings[step, row])[0] for row, shape in enumerate(shapes)]
        gaps = np.full((count, count), np.inf)
        for one in range(count):
            for other in range(one):
                gaps[one, other] = gaps[other, one] = distance(bodies[one], bodies[other])
        assert found is not None
        assert found.least[step] == pytest.approx(gaps.min(), abs=1e-9)
        assert gaps[tuple(found.pair[step])] == pytest.approx(gaps.min(), abs=1e-9)
        assert found.typical[step] == pytest.approx(np.median(gaps.min(axis=1)), abs=1e-9)


@settings(max_examples=25)
@given(seeds)
def test_the_least_separation_from_obstacles_is_that_of_all_their_pieces(seed: int) -> None:
    random = np.random.default_rng(seed)
    shapes = [random_shape(random) for _ in range(4)]
    wall = Wall(points=[tuple(point) for point in random.uniform(-3, 3, (4, 2))], thickness=0.3)
    around = [Shape(wall=wall), *(random_shape(random) for _ in range(3))]
    pieces = [shape.pieces for shape in around]
    positions, headings = random.uniform(-4, 4, (3, 4, 2)), random.uniform(-3, 3, (3, 4))
    places = np.concatenate([random.uniform(-4, 4, (3, 4, 2)), np.zeros((3, 4, 1))], axis=2)
    turns = random.uniform(-3, 3, (3, 4))
    moved = motion(positions, shapes, headings)
    found = closeness.from_obstacles(moved, Obstacles(tuple("abcd"), pieces, ["#000000"] * 4, places, turns))
    for step in range(3):
        gaps = np.array(
            [
                [
                    min(
                        distance(placed(shape, positions[step, row], headings[step, row])[0], piece)
                        for piece in placed(around[number], places[step, number, :2], turns[step, number])
                    )
                    for number in range(4)
                ]
                for row, shape in enumerate(shapes)
            ]
        )
        assert found is not None
        assert found.least[step] == pytest.approx(gaps.min(), abs=1e-9)
        assert gaps[tuple(found.pair[step])] == pytest.approx(gaps.min(), abs=1e-9)


def test_the_nearest_body_is_found_among_many_of_different_size() -> None:
    random = np.random.default_rng(7)
    radii = random.choice([0.1, 0.5, 3.0], 400)
    positions = random.uniform(0, 100, (400, 2))
    found = closeness.among(motion([positions], [Shape(circle=Circle(radius=radius)) for radius in radii]))
    apart = np.linalg.norm(positions[:, None] - positions, axis=2) - radii[:, None] - radii
    np.fill_diagonal(apart, np.inf)
    assert found is not None
    assert found.least[0] == pytest.approx(apart.min(), abs=1e-9)
    assert found.typical[0] == pytest.approx(np.median(apart.min(axis=1)), abs=1e-9)
    one, other = found.pair[0]
    assert found.centres[0] == pytest.approx(np.linalg.norm(positions[one] - positions[other]))


def test_points_are_as_far_apart_as_their_centres_and_balls_as_in_space() -> None:
    found = closeness.among(motion([[[0, 0, 0], [3, 4, 12]]], [None, None]))
    assert found is not None
    assert (found.least[0], found.centres[0]) == (13.0, 13.0)
    ball = Shape(circle=Circle(radius=1.0))
    assert present(closeness.among(motion([[[0, 0, 0], [3, 4, 12]]], [ball, ball]))).least[0] == 11.0
    # Bodies with corners are compared from above, but only once their bounding balls meet.
    flat = Shape(polygon=Polygon(vertices=[(-1, -1), (1, -1), (1, 1), (-1, 1)]))
    above = closeness.among(motion([[[0, 0, 0], [0, 0, 12]]], [flat, flat]))
    assert above is not None
    assert above.least[0] == pytest.approx(12 - 2 * np.sqrt(2))
    assert present(closeness.among(motion([[[0, 0, 0], [0, 0, 1]]], [flat, flat]))).least[0] < 0


def test_agents_in_one_place_overlap_by_the_whole_of_their_radii() -> None:
    disc = Shape(circle=Circle(radius=0.5))
    assert present(closeness.among(motion(np.zeros((2, 5, 2)), [disc] * 5))).least.tolist() == [-1.0, -1.0]


def test_absent_agents_are_ignored() -> None:
    positions = np.array([[[0.0, 0.0], [np.nan, np.nan], [4.0, 0.0]], [[0.0, 0.0], [1.0, 0.0], [4.0, 0.0]]])
    found = closeness.among(motion(positions, [None] * 3))
    assert found is not None
    assert found.least.tolist() == [4.0, 1.0]
    assert found.pair.tolist() == [[0, 2], [0, 1]]
    alone = np.array([[[0.0, 0.0], [np.nan, np.nan]]])
    assert closeness.among(motion(alone, [None] * 2)) is None
    assert closeness.among(motion(alone[:, :1], [None])) is None


def test_with_too_much_work_instants_are_left_out_but_not_the_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(closeness, "_WORK", 100)
    found = closeness.among(motion(np.random.default_rng(7).normal(size=(64, 5, 2)), [None] * 5))
    assert found is not None
    assert found.every == 4
    assert found.times.tolist() == [*range(0, 61 * 10**9, 4 * 10**9), 63 * 10**9]


def test_bodies_overlap_exactly_while_the_world_reports_a_contact(tmp_path: Path) -> None:
    log = log_of(tmp_path, YARD)
    distances = separation(log)
    assert distances.agents is not None
    assert distances.obstacles is not None
    expected, instants = [], distances.agents.times
    touching: set[Any] = set()
    changes = list(log.contacts())
    for time in instants:
        for contact in (each for each in changes if each.time == time):
            (touching.add if contact.stage == "BEGIN" else touching.remove)((contact.a, contact.b))
        expected.append(bool(touching))
    overlapping = (distances.agents.least < 0) | (distances.obstacles.least < 0)
    assert any(expected)
    assert overlapping.tolist() == expected
    assert "cart.0" in distances.who(distances.agents)


@pytest.mark.parametrize("shape", ["circle: {radius: 0.3}", "box: {length: 0.9, width: 0.3}"])
def test_summary_plot_and_replay_have_the_same_least_separation(tmp_path: Path, shape: str) -> None:
    from symaware_cli.language.build import build
    from symaware_cli.language.execution import execute

    text = (SCENARIOS / "head-on.yaml").read_text()
    assert "circle: {radius: 0.3}" in text
    (tmp_path / "a.yaml").write_text(text.replace("circle: {radius: 0.3}", shape))
    summary = execute(build(tmp_path / "a.yaml"), tmp_path / "a.mcap").minimum_separation
    log = open_log(tmp_path / "a.mcap")
    distances = separation(log)
    least = distances.facts()["agents"]
    assert summary is not None
    assert least["minimum"] == pytest.approx(summary.value, abs=1e-12)
    assert (least["time"], tuple(least["who"])) == (summary.time, summary.who)
    assert distances.sampled is None
    drawn = saved(log, tmp_path).values("/curves/separation/smallest", "Scalars:scalars")
    np.testing.assert_allclose(np.array(drawn)[:, 0], present(distances.agents).least, atol=1e-12)


def test_a_plot_of_a_sampled_log_has_a_note(tmp_path: Path) -> None:
    from symaware_cli.language.build import build
    from symaware_cli.language.execution import execute

    text = (SCENARIOS / "head-on.yaml").read_text() + "\nrecording: {interval: 0.5}\n"
    (tmp_path / "a.yaml").write_text(text)
    execute(build(tmp_path / "a.yaml"), tmp_path / "a.mcap")
    distances = separation(open_log(tmp_path / "a.mcap"))
    assert distances.sampled == 0.5
    assert distances.facts()["recorded_every"] == 0.5
    assert "Recorded only every 0.5 s: in between, bodies may have been closer." in distances.notes()


def test_aircraft_pass_over_each_other(tmp_path: Path) -> None:
    log = log_of(tmp_path, AIRCRAFT)
    assert run_view_of(log).is_spatial
    least = separation(log).facts()["agents"]
    # Twelve metres of altitude between two balls of five metres.
    assert least["minimum"] == pytest.approx(2.0, abs=1e-3)
    assert least["time"] == pytest.approx(2.5)
    assert not list(log.contacts())


def test_shapely_agrees_about_boxes_that_are_turned() -> None:
    box = Shape.model_validate({"box": {"length": 2.0, "width": 1.0}})
    found = closeness.among(motion([[[0, 0], [3, 1]]], [box, box], np.array([[0.3, 1.2]])))
    polygons = [shapely.Polygon(placed(box, at, turn)[0][0]) for at, turn in (((0, 0), 0.3), ((3, 1), 1.2))]
    assert found is not None
    assert found.least[0] == pytest.approx(polygons[0].distance(polygons[1]))
