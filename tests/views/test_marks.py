"""Marks, made by hand, in Rerun and in Foxglove: neither needs a log, or anybody that the marks are about."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from foxglove_files import read
from rerun_files import Recording

from symaware_cli.views.foxglove.output import Output, SceneUpdates
from symaware_cli.views.foxglove.show import show
from symaware_cli.views.palette import faded
from symaware_cli.views.rerun.output import RerunOutput
from symaware_cli.views.scene import marks

SECOND = 1_000_000_000
TIMES = np.array([0, SECOND])
RED = (200, 40, 40)
SQUARE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def shown(folder: Path, *shown: marks.Mark) -> tuple[Recording, Any]:
    """The same marks in both."""
    recording = rr.RecordingStream("test")
    recording.save(folder / "marks.rrd")
    output = RerunOutput(recording)
    with open(folder / "marks.mcap", "wb") as file, Output(file) as written:
        updates = SceneUpdates(written)
        for mark in shown:
            output.show(mark)
            show(updates, mark)
        updates.flush()
    output.flush()
    recording.disconnect()
    return Recording(folder / "marks.rrd"), read(folder / "marks.mcap")


def a_line(**more: Any) -> marks.Lines:
    """A line at the first instant, and none at the second."""
    given: dict[str, Any] = {"path": "ways/one", "times": TIMES, "counts": [1, 0], "lengths": [3], "colours": RED}
    given |= {"points": np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)])}
    return marks.Lines(**({**given, "names": ["one"], "who": np.array([0])} | more))


def test_a_line_is_up_until_the_next_instant(tmp_path: Path) -> None:
    recording, messages = shown(tmp_path, a_line())
    first, second = recording.values("/ways/one", "LineStrips3D:strips")
    assert (first, second or []) == ([[[0, 0, 0], [1, 0, 0], [2, 0, 0]]], [])
    (_, up), (time, down) = messages["/ways/one"]
    assert [entity.id for entity in up.entities] == [deletion.id for deletion in down.deletions] == ["one"]
    assert (time, len(down.entities)) == (SECOND, 0)


def test_transparency_is_mixed_with_the_background_where_there_is_none(tmp_path: Path) -> None:
    recording, messages = shown(tmp_path, a_line(transparency=0.4))
    ((packed,), *_) = recording.values("/ways/one", "LineStrips3D:colors")
    assert packed >> 8 == int.from_bytes(bytes(faded(np.array(RED, np.uint8), 0.4).tolist()), "big")
    (line,) = messages["/ways/one"][0][1].entities[0].lines
    assert line.color.a == pytest.approx(0.6)
    assert round(255 * line.color.r) == RED[0]


def test_a_line_that_fades_is_cut_into_pieces_or_has_a_colour_at_each_point(tmp_path: Path) -> None:
    recording, messages = shown(tmp_path, a_line(fades=True))
    (first, *_) = recording.values("/ways/one", "LineStrips3D:strips")
    assert first == [[[0, 0, 0], [1, 0, 0]], [[1, 0, 0], [2, 0, 0]]]
    (line,) = messages["/ways/one"][0][1].entities[0].lines
    alphas = [colour.a for colour in line.colors]
    assert alphas == sorted(alphas, reverse=True)
    assert len(alphas) == len(line.points) == 3


def test_lasting_marks_are_shown_together_with_earlier_ones(tmp_path: Path) -> None:
    points = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 2.0, 0.0)])
    given: dict[str, Any] = {"points": points, "lengths": [2, 2], "counts": [1, 1], "who": np.array([0, 0])}
    _, messages = shown(tmp_path, a_line(**given, lasting=5.0))
    lines = [update.entities[0].lines[0].points for _, update in messages["/ways/one"]]
    assert [[(point.x, point.y) for point in line] for line in lines] == [[(0, 0), (1, 0)], [(0, 0), (1, 0), (1, 2)]]


def test_new_marks_are_sent_once_if_they_expire_by_themselves(tmp_path: Path) -> None:
    points = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 1.0, 0.0)])
    given: dict[str, Any] = {"points": points, "lengths": [2, 2], "counts": [1, 1], "who": np.array([0, 0])}
    recording, messages = shown(tmp_path, a_line(**given, lasting=0.5, begins=np.array([True, False])))
    assert len(recording.values("/ways/one", "LineStrips3D:strips")) == 2
    ((time, update),) = messages["/ways/one"]
    (entity,) = update.entities
    assert (time, entity.id, entity.lifetime.nanos) == (0, "one", SECOND // 2)
    assert [(point.x, point.y) for point in entity.lines[0].points] == [(0, 0), (1, 0)]


def test_an_area_is_filled_with_its_label_in_the_middle(tmp_path: Path) -> None:
    area = marks.Solid(
        path="world/regions/dock",
        layer="regions",
        times=TIMES[:1],
        name="dock",
        pieces=[(SQUARE, 0.0)],
        low=0.0,
        high=0.0,
        colour=RED,
        transparency=0.5,
        label="dock",
        positions=np.array([(5.0, 6.0, 0.0)]),
        orientations=np.array([(0.0, 0.0, 0.0, 1.0)]),
    )
    recording, messages = shown(tmp_path, area)
    assert recording.values("/world/regions/dock", "Transform3D:translation") == [[[5, 6, 0]]]
    assert recording.static("/world/regions/dock/label", "Points3D:labels") == ["dock"]
    assert len(recording.static("/world/regions/dock/0", "Mesh3D:triangle_indices")) == 2
    (entity,) = messages["/regions"][0][1].entities
    assert (entity.texts[0].text, entity.triangles[0].color.a) == ("dock", 0.5)
    (frame,) = messages["/tf/dock"][0][1].transforms
    assert (frame.translation.x, frame.translation.y, frame.child_frame_id) == (5, 6, entity.frame_id)


def test_a_curve_has_a_level_to_compare_with(tmp_path: Path) -> None:
    values = np.array([[1.0], [-0.5]])
    curve = marks.Curves(path="curves/safe", times=TIMES, values=values, names=["robustness"], level=("bound", 0.0))
    recording, messages = shown(tmp_path, curve)
    assert recording.values("/curves/safe", "Scalars:scalars") == values.tolist()
    assert recording.values("/curves/safe/level", "Scalars:scalars") == [[0.0], [0.0]]
    assert recording.static("/curves/safe/level", "SeriesLines:names") == ["bound"]
    assert [(list(each.robustness), list(each.bound)) for _, each in messages["/curves/safe"]] == [
        ([1.0], [0.0]),
        ([-0.5], [0.0]),
    ]


def test_a_backend_skips_marks_that_it_cannot_show(tmp_path: Path) -> None:
    modes = marks.Modes(path="modes/one", times=TIMES, modes=["on", "off"])
    recording, messages = shown(tmp_path, modes)
    assert recording.values("/modes/one", "StateChange:state") == [["on"], ["off"]]
    assert not messages
