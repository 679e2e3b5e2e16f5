"""Pictures of sweeps are drawn reproducibly."""

import re
from pathlib import Path

import pytest
from swept import swept

from symaware_cli.log.error import LogError
from symaware_cli.studies.picture.finished_runs import FinishedRuns
from symaware_cli.studies.picture.metric_panel import composed
from symaware_cli.studies.picture.sweep_figure import draw
from symaware_cli.views import AGENTS, PRESETS, hexadecimal
from symaware_cli.views.plotting.paper_preset import GREY_SAFE


@pytest.mark.parametrize(
    "runs",
    [
        swept({}, 40),
        swept({}, 40, ["slow", "fast"]),
        swept({"a": [0.001, 0.1, 10.0]}),
        swept({"a": ["x", "y"]}, variants=["slow", "fast"], ended=13),
        swept({"a": range(20), "agents.robot.components.steer.with.gain": [True, False]}, 2),
        swept({"a": [1, 2], "b": [1, 2], "c": [1, 2]}, 3, ["slow", "fast"]),
        swept({"a": [1, 2]}, ended=1),
        swept({"a": [1, 2]}, 60, ["slow", "fast"], is_drawn=True),
        swept({}, 60, ended=1, is_drawn=True),
    ],
    ids=[
        "distribution",
        "variants",
        "logarithmic",
        "unfinished",
        "map",
        "multiples",
        "one run",
        "drawn",
        "one that draws",
    ],
)
def test_a_picture_is_reproducible_byte_for_byte(runs: FinishedRuns, tmp_path: Path) -> None:
    for name in ("one.svg", "other.svg"):
        draw(composed(runs), tmp_path / name, dpi=50)
    content = (tmp_path / "one.svg").read_bytes()
    assert content == (tmp_path / "other.svg").read_bytes()
    assert content.startswith(b"<?xml")


def test_oversized_panels_and_unprintable_titles_are_rejected(tmp_path: Path) -> None:
    picture = composed(swept({"a": [1, 2], "b": [1, 2], "c": [1, 2]}, 3, ["slow", "fast"]))
    with pytest.raises(LogError, match=r"do not fit into 1\.5 x 1\.5 inches"):
        draw(picture, tmp_path / "small.png", size=(1.5, 1.5))
    with pytest.raises(LogError, match="the font cannot write"):
        draw(picture, tmp_path / "title.png", title="\U0001f4a5")


def test_a_preset_has_the_width_and_the_type_of_a_column_and_colours_that_differ_in_grey(tmp_path: Path) -> None:
    picture = composed(swept({"a": [1, 2, 3]}, 3, ["slow", "fast"]))
    draw(picture, tmp_path / "paper.svg", preset=PRESETS["ieee-column"])
    text = (tmp_path / "paper.svg").read_text()
    assert re.search(r'<svg[^>]*width="252pt"', text)
    assert "STIXGeneral" in text
    assert all(colour in text for colour in GREY_SAFE[:2])
    assert hexadecimal(AGENTS[0]) not in text
    draw(picture, tmp_path / "usual.svg")
    assert hexadecimal(AGENTS[0]) in (tmp_path / "usual.svg").read_text()


@pytest.mark.parametrize(
    "runs",
    [
        swept({}, 40, is_infinite=True),
        swept({"a": [1, 2, 3]}, 8, ["slow", "fast"], is_infinite=True),
        swept({"a": ["x", "y"]}, 8, is_infinite=True),
        swept({"a": [1, 2], "b": [1, 2]}, 8, is_infinite=True),
        swept({}, 60, is_drawn=True, is_infinite=True),
    ],
    ids=["distribution", "variants", "texts", "map", "drawn"],
)
def test_infinite_values_are_marked_with_their_number_of_runs(runs: FinishedRuns, tmp_path: Path) -> None:
    picture = composed(runs, ["robustness.safe"])
    (panel, *_) = picture.panels
    assert panel.infinite is not None
    assert (
        sum(int(each.infinite[0].sum()) for each in picture.panels if each.infinite is not None)
        >= len(runs.indices) // 4
    )
    assert any("-inf in" in note for note in picture.notes)
    assert not any("have no value" in note for note in picture.notes)
    draw(picture, tmp_path / "picture.svg", dpi=50)
    words = re.findall(r"<text[^>]*>([^<]*)</text>", (tmp_path / "picture.svg").read_text())
    assert any("-inf" in word for word in words)
