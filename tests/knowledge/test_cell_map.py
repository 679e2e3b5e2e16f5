"""The picture of a knowledge model has its cells by name, with what holds in them."""

import re
from pathlib import Path

import pytest

from symaware_cli.geometry.region import Region
from symaware_cli.knowledge import draw_models
from symaware_cli.knowledge.abstraction.region_graph import RegionGraph

REGIONS = {
    "hall": Region(box=(0, 4, 0, 3)),
    "lab": Region(box=(4, 6, 1, 2)),
    "wing": Region(box=(4, 6, 0, 4)),
}


def test_cells_are_drawn_with_their_names_and_labels_below_the_number_of_transitions(tmp_path: Path) -> None:
    model = RegionGraph(RegionGraph.Parameters(regions=("hall", "lab")))
    model.prepare(REGIONS)
    draw_models({"rooms": model}, tmp_path / "rooms.svg")
    words = re.findall(r"<text[^>]*>([^<]+)</text>", (tmp_path / "rooms.svg").read_text(encoding="utf-8"))
    transitions = sum(map(len, model.system.successors))
    assert {"hall", "lab", "wing", f"rooms: 2 cells, {transitions} transitions"} <= {*words}


def test_a_picture_in_a_folder_that_is_missing_is_an_error(tmp_path: Path) -> None:
    model = RegionGraph(RegionGraph.Parameters(regions=("hall", "lab")))
    model.prepare(REGIONS)
    with pytest.raises(OSError, match="none"):
        draw_models({"rooms": model}, tmp_path / "none" / "rooms.svg")
