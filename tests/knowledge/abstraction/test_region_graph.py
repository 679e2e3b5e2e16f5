import pytest

from symaware_cli.geometry.region import Region
from symaware_cli.knowledge.abstraction.region_graph import RegionGraph
from symaware_cli.world.plugin import ParameterError

REGIONS = {
    "hall": Region(box=(0, 4, 0, 3)),
    "lab": Region(box=(4, 6, 1, 2)),
    "attic": Region(box=(4, 6, 3, 4)),
    "cellar": Region(box=(1, 2, 1, 2)),
    "house": Region(box=(0, 6, 0, 4)),
    "round": Region.model_validate({"circle": {"centre": [3.5, 2.5], "radius": 0.3}}),
}


def graph(*names: str) -> RegionGraph:
    made = RegionGraph(RegionGraph.Parameters(regions=names))
    made.prepare(REGIONS)
    return made


def test_rooms_that_share_a_side_are_connected_and_those_that_share_a_corner_are_not() -> None:
    model = graph("hall", "lab", "attic")
    assert model.system.successors == ((0, 1), (1, 0), (2,))
    assert model.gate(0, 1).tolist() == [4.0, 1.5]


def test_a_room_is_labelled_with_itself_and_what_contains_it() -> None:
    assert graph("hall", "lab").system.labels_in(1) == {"lab", "house"}


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("hall", "round"), "`round` is no box"),
        (("hall", "cellar"), "`hall` and `cellar` overlap"),
        (("hall", "loft"), "no region `loft`"),
        (("hall", "hall"), "a cell once"),
    ],
)
def test_regions_that_cannot_be_cells_are_refused(names: tuple[str, ...], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        graph(*names)
