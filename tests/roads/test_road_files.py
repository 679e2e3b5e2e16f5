"""OpenDRIVE and CommonRoad files: valid ones are read, and invalid ones are refused at the place of the problem."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from symaware_cli.assets import AssetError
from symaware_cli.roads import commonroad, opendrive
from symaware_cli.roads.lane import Lane
from symaware_cli.roads.road_network import RoadNetwork

MAPS = Path(__file__).parents[2] / "scenarios" / "maps"
OVAL, MERGE = (MAPS / "oval.xodr").read_bytes(), (MAPS / "merge.xml").read_bytes()


def xodr(
    geometry: str = '<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry>',
    right: str = '<lane id="-1" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/></lane>',
    left: str = "",
    length: float = 100.0,
    road: str = "",
    rest: str = "",
    lanes: str = "",
) -> bytes:
    """A file with one road."""
    sides = f"<left>{left}</left>" * bool(left) + f"<right>{right}</right>" * bool(right)
    return (
        f'<OpenDRIVE><road id="1" length="{length}" {road}><planView>{geometry}</planView>'
        f'<lanes>{lanes}<laneSection s="0">{sides}</laneSection></lanes></road>{rest}</OpenDRIVE>'
    ).encode()


def named(lanes: list[Lane]) -> dict[str, Lane]:
    return {lane.name: lane for lane in lanes}


def test_the_oval_closes_and_its_lanes_lie_side_by_side() -> None:
    lanes = named(opendrive.lanes_of(OVAL, 2.0))
    assert list(lanes) == ["oval_L1", "oval_R1", "oval_R2"], "the shoulder is no lane that cars drive on"
    for name, lane in lanes.items():
        assert lane.successors == (name,)
        np.testing.assert_allclose(lane.centre[0], lane.centre[-1], atol=1e-6)
        np.testing.assert_allclose(lane.width, 3.5, atol=1e-6)
    # The oval turns left once: a line that lies d further to the right is 2 pi d longer.
    lengths = RoadNetwork(list(lanes.values())).length
    np.testing.assert_allclose(np.diff(lengths), 2 * math.pi * 3.5, atol=0.05)
    assert (lanes["oval_R2"].left_lane, lanes["oval_R1"].right_lane) == ("oval_R1", "oval_R2")
    assert (lanes["oval_L1"].left_lane, lanes["oval_L1"].right_lane) == (None, None), "it is driven the other way"
    assert [lane.speed_limit for lane in lanes.values()] == pytest.approx([80 / 3.6, 80 / 3.6, 60 / 3.6])


def test_an_arc_lies_on_its_circle_and_a_parametric_cubic_on_its_polynomial() -> None:
    arc = '<geometry s="0" x="1" y="2" hdg="0" length="100"><arc curvature="0.01"/></geometry>'
    (lane,) = opendrive.lanes_of(xodr(arc), 1.0)
    radius = np.hypot(lane.left[:, 0] - 1.0, lane.left[:, 1] - 102.0)
    np.testing.assert_allclose(radius, 100.0, atol=1e-9)
    np.testing.assert_allclose(lane.left[-1], [1 + 100 * math.sin(1), 102 - 100 * math.cos(1)], atol=1e-9)
    cubic = (
        '<geometry s="0" x="0" y="0" hdg="0" length="100.66"><paramPoly3 aU="0" bU="100" cU="0" dU="0" aV="0" bV="0" '
        'cV="30" dV="-20" pRange="normalized"/></geometry>'
    )
    (lane,) = opendrive.lanes_of(xodr(cubic, length=100.66), 1.0)
    p = lane.left[:, 0] / 100.0
    np.testing.assert_allclose(lane.left[:, 1], 30 * p**2 - 20 * p**3, atol=1e-9)


def test_a_spiral_is_the_clothoid_of_fresnel() -> None:
    from scipy.special import fresnel

    spiral = '<geometry s="0" x="0" y="0" hdg="0" length="100"><spiral curvStart="0" curvEnd="0.02"/></geometry>'
    (lane,) = opendrive.lanes_of(xodr(spiral), 1.0)
    scale = math.sqrt(math.pi * 100 / 0.02)
    sine, cosine = fresnel(100 / scale)
    np.testing.assert_allclose(lane.left[-1], [scale * cosine, scale * sine], atol=1e-9)


def test_widths_offsets_and_left_hand_traffic_are_read() -> None:
    right = (
        '<lane id="-1" type="driving"><width sOffset="0" a="3" b="0.01" c="0" d="0"/></lane>'
        '<lane id="-2" type="driving"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane>'
    )
    offset = '<laneOffset s="0" a="1" b="0" c="0" d="0"/>'
    lanes = named(opendrive.lanes_of(xodr(right=right, lanes=offset), 1.0))
    np.testing.assert_allclose(lanes["1_R1"].left[:, 1], 1.0)
    np.testing.assert_allclose(lanes["1_R1"].right[[0, -1], 1], [-2.0, -3.0])
    np.testing.assert_allclose(lanes["1_R2"].width, 2.0, atol=0.01)
    left_hand = named(opendrive.lanes_of(xodr(right=right, road='rule="LHT"'), 1.0))
    assert left_hand["1_R1"].centre[0, 0] == pytest.approx(100.0), "driven against the road"
    assert left_hand["1_R1"].left_lane == "1_R2"


def test_junctions_and_sections_link_lanes() -> None:
    def road(id: str, x: float, link: str, junction: str = "-1") -> str:
        return (
            f'<road id="{id}" length="10" junction="{junction}"><link>{link}</link><planView>'
            f'<geometry s="0" x="{x}" y="0" hdg="0" length="10"><line/></geometry></planView><lanes>'
            '<laneSection s="0"><right><lane id="-1" type="driving"><link><successor id="-1"/></link>'
            '<width sOffset="0" a="3" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road>'
        )

    onto = '<successor elementType="junction" elementId="7"/>'
    beyond = '<successor elementType="road" elementId="c" contactPoint="start"/>'
    junction = (
        '<junction id="7"><connection id="0" incomingRoad="a" connectingRoad="b" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection></junction>'
    )
    data = f"<OpenDRIVE>{road('a', 0, onto)}{road('b', 10, beyond, '7')}{road('c', 20, '')}{junction}</OpenDRIVE>"
    lanes = named(opendrive.lanes_of(data.encode(), 1.0))
    assert [lane.successors for lane in lanes.values()] == [("b_R1",), ("c_R1",), ()]


def test_lanelets_have_boundaries_links_neighbours_and_limits() -> None:
    lanes = named(commonroad.lanes_of(MERGE))
    assert [lane.successors for lane in lanes.values()] == [("3",), ("3",), (), ("5",), ()]
    assert (lanes["1"].left_lane, lanes["4"].right_lane, lanes["2"].left_lane) == ("4", "1", None)
    assert [lane.speed_limit for lane in lanes.values()] == [25.0, 16.0, 25.0, 25.0, 25.0]
    np.testing.assert_allclose(lanes["2"].centre[-1], lanes["3"].centre[0])


LINE = '<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry>'

#: A change of a file, and the message about it, whose place has a line.
WRONG_ROADS = [
    (xodr(LINE.replace('x="0"', 'x="nan"')), "`x` is not a finite number"),
    (xodr(LINE.replace('x="0"', 'x="1e300"')), "`x` is not a finite number"),
    (xodr(LINE.replace('length="100"', 'length="-1"')), "the length of a geometry is more than 0"),
    (xodr(LINE.replace("<line/>", "<poly3/>")), "a geometry has one of"),
    (xodr(LINE, length=50), "the length of the road is 50 m, and that of its geometries 100 m"),
    (xodr(LINE, right=""), "it has no lane that cars drive on"),
    (xodr(LINE, right='<lane id="-2" type="driving"/>'), "numbered without gaps, and -1 is missing"),
    (xodr(LINE, right='<lane id="1" type="driving"/>'), "the id of a lane in <right> is -1 to -50, not 1"),
    (
        xodr(LINE, right='<lane id="-1" type="driving"><width sOffset="0" a="3" b="-1" c="0" d="0"/></lane>'),
        "the width of the lane -1 is negative 100 m after the start",
    ),
    (
        xodr('<geometry s="0" x="0" y="0" hdg="0" length="100"><arc curvature="0.5"/></geometry>'),
        "the centre of the lane 1_R1 crosses itself",
    ),
    (
        xodr('<geometry s="0" x="0" y="0" hdg="0" length="3"><arc curvature="-0.9"/></geometry>', length=3),
        "the left boundary of the lane 1_R1 is not on its left",
    ),
    (
        xodr('<geometry s="0" x="0" y="0" hdg="0" length="1e6"><arc curvature="0.001"/></geometry>', length=1e6),
        "need more than 20,000 points",
    ),
    (xodr(rest='<road id="1" length="1"/>'), "<road> has no <planView>"),
    (OVAL.replace(b'elementId="oval"', b'elementId="other"'), "there is no road other"),
    (OVAL.replace(b'elementType="road"', b'elementType="bridge"'), "`elementType` is `road` or `junction`"),
    (OVAL.replace(b'unit="km/h"', b'unit="knots"'), "`unit` is one of m/s, km/h, mph"),
    (b"<OpenDRIVE><road", "it is no XML"),
    (b"<commonRoad/>", "it is no OpenDRIVE file"),
    (b'<!DOCTYPE o [<!ENTITY a "aaaa">]><OpenDRIVE>&a;</OpenDRIVE>', "it declares a document type"),
    (b"<OpenDRIVE>" + b"<a>" * 200 + b"</a>" * 200 + b"</OpenDRIVE>", "nested more than 100 deep"),
]


@pytest.mark.parametrize(("data", "said"), WRONG_ROADS, ids=[said[:40] for _, said in WRONG_ROADS])
def test_a_wrong_opendrive_file_is_refused_with_its_place(data: bytes, said: str) -> None:
    with pytest.raises(AssetError) as refused:
        opendrive.lanes_of(data, 0.5)
    assert said in str(refused.value)
    assert refused.value.line >= 1


WRONG_LANELETS = [
    (MERGE.replace(b"<x>300</x>", b"<x>nan</x>", 1), "`x` is not a finite number", 6),
    (MERGE.replace(b"<x>300</x>", b"<x>0</x>", 1), "points 0 and 1 of the <leftBound> are the same", 6),
    (MERGE.replace(b'<successor ref="5"/>', b'<successor ref="9"/>'), "there is no lanelet 9", 29),
    (MERGE.replace(b'<lanelet id="5">', b'<lanelet id="4">'), "two lanelets have the id 4", 33),
    (MERGE.replace(b'<trafficSignRef ref="101"/>', b'<trafficSignRef ref="9"/>'), "there is no traffic sign 9", 16),
    (MERGE.replace(b'"2020a"', b'"1999"'), "its version is '1999'", 2),
    (MERGE.replace(b"<y>-1.75</y>", b"<y>3</y>", 2), "is not on its left at (0, 1.75)", 5),
    (MERGE.replace(b">25.0<", b">0<"), "a speed limit is more than 0", 41),
    (MERGE.replace(b"<x>275</x><y>0.25</y>", b"<x>50</x><y>-40</y>"), "crosses itself", 13),
    (b'<!DOCTYPE c SYSTEM "http://localhost/"><commonRoad/>', "it declares a document type", 1),
    (b"<commonRoad>" + b"<a/>" * 200_001 + b"</commonRoad>", "it has more than 200,000 elements", 1),
    (b" " * 20_000_001, "bytes, and a file of roads may have", 0),
]


@pytest.mark.parametrize(("data", "said", "line"), WRONG_LANELETS, ids=[said[:40] for _, said, _ in WRONG_LANELETS])
def test_a_wrong_commonroad_file_is_refused_with_its_place(data: bytes, said: str, line: int) -> None:
    with pytest.raises(AssetError) as refused:
        commonroad.lanes_of(data)
    assert said in str(refused.value)
    assert refused.value.line == line


@given(st.data())
@settings(max_examples=150, deadline=None)
def test_any_change_of_a_file_is_read_or_refused(data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(["xodr", "xml"]))
    content = xodr(right='<lane id="-1" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/></lane>')
    content = content if kind == "xodr" else MERGE
    start = data.draw(st.integers(0, len(content)))
    end = min(len(content), start + data.draw(st.integers(0, 30)))
    new = data.draw(st.sampled_from([b"", b"0", b"-1", b"1e9", b"nan", b"inf", b'"', b"<", b"/>", b"\xff", b"9" * 400]))
    changed = content[:start] + new + content[end:]
    try:
        lanes = opendrive.lanes_of(changed, 1.0) if kind == "xodr" else commonroad.lanes_of(changed)
    except AssetError:
        return
    for lane in lanes:
        assert np.isfinite(lane.left).all()
        assert np.isfinite(lane.right).all()
        assert (lane.width > 0.0).all()
        assert lane.areas()


@given(
    st.floats(-0.02, 0.02),
    st.floats(-0.02, 0.02),
    st.floats(10.0, 60.0),
    st.floats(-3.0, 3.0),
)
@settings(max_examples=50, deadline=None)
# A straight line, whose legs are parallel but for rounding.
@example(first=0.0, last=8.703479689921783e-62, length=47.0, heading=-1.0537657857776508)
def test_points_beside_the_centre_have_their_true_coordinates(
    first: float, last: float, length: float, heading: float
) -> None:
    shape = f'<spiral curvStart="{first!r}" curvEnd="{last!r}"/>'
    geometry = f'<geometry s="0" x="5" y="-3" hdg="{heading!r}" length="{length!r}">{shape}</geometry>'
    network = RoadNetwork(opendrive.lanes_of(xodr(geometry, length=length), 1.0))
    along = np.linspace(0.1, 0.9, 9) * network.length[0]
    points, ahead = network.at(np.zeros(9, np.intp), along)
    places = network.places(points + 0.7 * np.stack([-ahead[:, 1], ahead[:, 0]], axis=1))
    np.testing.assert_allclose(places.across[:, 0], 0.7, atol=0.01)
    np.testing.assert_allclose(places.along[:, 0], along, atol=0.05)
