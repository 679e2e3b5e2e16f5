"""Labels in Rerun cover neither bodies nor each other, in the view that a replay opens with."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from symaware_cli.geometry import Shape
from symaware_cli.views.palette import DARK, LIGHT
from symaware_cli.views.rerun.labels import Labels, SceneView
from symaware_cli.views.scene.marks import Bodies, Solid
from symaware_cli.views.video.viewpoint import VIEWPOINTS

pytest.importorskip("rerun")

SCALE, HEIGHT = 0.02, 20.0


class Taken:
    """Takes the columns that labels send."""

    def __init__(self, theme: Any = DARK) -> None:
        self.theme, self.looks, self.sent = theme, dict[str, Any](), dict[str, np.ndarray]()

    def static(self, path: str, look: Any) -> None:
        self.looks[path] = look

    def send(self, path: str, times: np.ndarray, columns: Any, counts: Any) -> None:
        (column,) = list(columns)
        flat = np.array(column.as_arrow_array().to_pylist(), float).reshape(len(times), -1, 3)
        assert [flat.shape[1]] * len(times) == list(counts)
        self.sent[path] = flat


def bodies(path: str, positions: np.ndarray, labels: Mapping[int, str]) -> Bodies:
    times, count = positions.shape[:2]
    return Bodies(
        path=path,
        times=np.arange(times, dtype=np.int64) * 100_000_000,
        names=[str(number) for number in range(count)],
        positions=positions,
        orientations=np.broadcast_to([0.0, 0.0, 0.0, 1.0], (times, count, 4)),
        colours=np.zeros((times, count, 3), np.uint8),
        shape=Shape.model_validate({"circle": {"radius": 0.3}}),
        labels=labels,
        label_colours=np.full((count, 3), 90, np.uint8),
        nosed=False,
        ring=None,
        floor=-np.inf,
        extent=0.3,
        spatial=False,
    )


def placed(view: SceneView, *marks: Bodies | Solid, theme: Any = DARK) -> Taken:
    labels, taken = Labels(view), Taken(theme)
    for mark in marks:
        labels.take(mark, mark.positions) if isinstance(mark, Bodies) else labels.take_area(mark)
    labels.show(taken)  # type: ignore[arg-type] # as much of an output as labels need
    return taken


def crowd(seed: int = 1) -> np.ndarray:
    chance = np.random.default_rng(seed)
    start, way = chance.uniform(-2.0, 2.0, (12, 3)), chance.normal(0.0, 0.05, (12, 3))
    return (start + np.arange(30)[:, None, None] * way) * [1.0, 1.0, 0.0]


@pytest.mark.parametrize("name", ["above", "angle"])
def test_labels_of_all_groups_cover_no_body_and_no_label(name: str) -> None:
    view, positions = SceneView(VIEWPOINTS[name], SCALE), crowd()
    one = bodies("world/agents/one", positions[:, :6], {row: f"one.{row}" for row in range(6)})
    other = bodies("world/agents/other", positions[:, 6:], {row: f"other.{row}" for row in range(6)})
    sent = placed(view, one, other).sent
    middles = np.concatenate([sent[f"world/agents/{each}/label"] for each in ("one", "other")], axis=1)
    # Rerun writes a label below its point.
    seen = view.viewpoint.project(middles) - [0.0, 0.5 * HEIGHT * SCALE]
    width = np.array([len("one.0")] * 6 + [len("other.0")] * 6) * 7.0 * SCALE
    at = view.viewpoint.project(positions)
    shown = np.atleast_1d(np.isfinite(seen).all(axis=-1))
    assert shown.mean() > 0.5
    for instant in range(len(seen)):
        for label in np.flatnonzero(shown[instant]):
            gap = np.abs(at[instant] - seen[instant, label]) - [0.5 * width[label], 0.5 * HEIGHT * SCALE]
            assert (np.hypot(*np.maximum(gap, 0.0).T) > 0.27).all()
            for second in np.flatnonzero(shown[instant]):
                apart = np.abs(seen[instant, second] - seen[instant, label])
                half = 0.5 * np.array([width[label] + width[second], 2.0 * HEIGHT * SCALE])
                assert second == label or (apart >= half - 1e-6).any()


def area(positions: np.ndarray) -> Solid:
    return Solid(
        path="world/regions/red",
        times=np.arange(len(positions), dtype=np.int64) * 100_000_000,
        name="red",
        pieces=[([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)], 0.0)],
        low=0.0,
        high=0.0,
        colour=(205, 70, 70),
        positions=positions,
        orientations=np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(positions), 4)),
        label="red",
    )


def test_the_label_of_an_area_leaves_its_middle_for_a_body_also_if_both_move() -> None:
    way = np.arange(20)[:, None, None] * [0.1, 0.0, 0.0]
    for moved in (np.zeros((20, 3)), way[:, 0]):
        at = np.zeros((20, 1, 3)) + moved[:, None]
        sent = placed(SceneView(scale=SCALE), bodies("world/agents/one", at, {}), area(moved)).sent
        (middle,) = {tuple(each) for each in sent["world/regions/red/label"][:, 0].round(6).tolist()}
        assert abs(middle[1] - 0.5 * HEIGHT * SCALE) > 0.3 + 0.5 * HEIGHT * SCALE


def test_words_are_lighter_than_bodies_before_a_dark_background_and_darker_before_a_light_one() -> None:
    mark = bodies("world/agents/one", np.zeros((1, 1, 3)), {0: "one"})
    shades = []
    for theme in (DARK, LIGHT):
        look = placed(SceneView(scale=SCALE), replace(mark), theme=theme).looks["world/agents/one/label"]
        shades.append(look.colors.as_arrow_array().to_pylist()[0] >> 24)
    assert shades[0] > 90 > shades[1]
