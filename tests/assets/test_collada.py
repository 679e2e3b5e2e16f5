"""Surfaces of Collada files."""

from pathlib import Path

import numpy as np
import pybullet
import pybullet_data
import pytest

from symaware_cli.assets import collada as reader
from symaware_cli.assets.asset_error import AssetError
from symaware_cli.geometry.vectors import Array

SQUARE = """<geometry id="g"><mesh>
 <source id="s"><float_array count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>
  <technique_common><accessor stride="3"/></technique_common></source>
 <vertices id="v"><input semantic="POSITION" source="#s"/></vertices>{faces}</mesh></geometry>"""
INPUTS = '<input semantic="VERTEX" source="#v" offset="1"/><input semantic="NORMAL" source="#n" offset="0"/>'


def triangles(data: bytes) -> Array:
    return reader.triangles(data, 1_000)


def collada(faces: str, node: str = "<instance_geometry url='#g'/>", asset: str = "") -> bytes:
    scene = f"<library_visual_scenes><visual_scene><node>{node}</node></visual_scene></library_visual_scenes>"
    geometry = f"<library_geometries>{SQUARE.format(faces=faces)}</library_geometries>"
    return f"<COLLADA xmlns='urn:c'><asset>{asset}</asset>{geometry}{scene if node else ''}</COLLADA>".encode()


HALVES = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]


@pytest.mark.parametrize(
    "faces",
    [
        f"<triangles>{INPUTS}<p>9 0 9 1 9 2 9 0 9 2 9 3</p></triangles>",
        f"<polylist>{INPUTS}<vcount>4</vcount><p>9 0 9 1 9 2 9 3</p></polylist>",
        f"<polygons>{INPUTS}<p>9 0 9 1 9 2</p><p>9 0 9 2 9 3</p></polygons>",
    ],
)
@pytest.mark.parametrize("node", ["<instance_geometry url='#g'/>", ""])
def test_faces_of_all_kinds_are_triangles(faces: str, node: str) -> None:
    assert triangles(collada(faces, node)).tolist() == HALVES


TRIANGLE = f"<triangles>{INPUTS}<p>9 0 9 1 9 2</p></triangles>"


def test_nodes_are_where_their_changes_put_them_last_first() -> None:
    change = "<translate>10 0 0</translate><rotate>0 0 1 90</rotate><scale>2 1 1</scale>"
    inner = f"{change}<node><matrix>1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url='#g'/></node>"
    (found,) = triangles(collada(TRIANGLE, inner, '<unit meter="0.5"/>'))
    np.testing.assert_allclose(found, np.array([[5, 5, 0], [5, 6, 0], [4.5, 6, 0]]), atol=1e-12)


@pytest.mark.parametrize("axis", ["X_UP", "Y_UP", "Z_UP"])
def test_size_and_orientation_agree_with_the_engine(axis: str, tmp_path: Path) -> None:
    with open(f"{pybullet_data.getDataPath()}/racecar/meshes/chassis.dae") as file:
        text = file.read().replace("<up_axis>Y_UP</up_axis>", f'<unit meter="0.5"/><up_axis>{axis}</up_axis>')
    (tmp_path / "a.dae").write_text(text)
    link = "<link name='b'><collision><geometry><mesh filename='a.dae'/></geometry></collision></link>"
    (tmp_path / "a.urdf").write_text(f"<robot name='a'>{link}</robot>")
    client = pybullet.connect(pybullet.DIRECT)
    body = pybullet.loadURDF(str(tmp_path / "a.urdf"), physicsClientId=client)
    low, high = pybullet.getAABB(body, -1, client)
    pybullet.disconnect(client)
    corners = triangles(text.encode()).reshape(-1, 3)
    assert corners.min(axis=0) == pytest.approx(low, abs=3e-3)  # with the margin of the engine
    assert corners.max(axis=0) == pytest.approx(high, abs=3e-3)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "no XML"),
        (b"<robot/>", "begins with `robot`"),
        (b"<!DOCTYPE a><COLLADA/>", "document type"),
        (collada(TRIANGLE.replace("9 2", "9 7")), "refers to vertex 7, and there are 4"),
        (collada(TRIANGLE.replace("#v", "#w")), "`#w`, which do not exist"),
        (collada(TRIANGLE.replace("9 2", "9 x")), "`x` is no index"),
        (collada(TRIANGLE.replace("9 2", "9")), "no multiple of the 2"),
        (collada(TRIANGLE.replace("<triangles>", "<triangles count='2'>")), "states 2 faces, and has 1"),
        (collada(TRIANGLE).replace(b"0 0 0 1", b"0 0 nan 1"), "not finite"),
        (collada(TRIANGLE).replace(b"0 0 0 1", b"0 0 0,5 1"), "`0,5` is no number"),
        (collada(TRIANGLE).replace(b'count="12"', b'count="13"'), "states 13 numbers, and has 12"),
        (collada(TRIANGLE, "<instance_geometry url='#h'/>"), "`#h`, which does not exist"),
        (collada(TRIANGLE, "<matrix>1 0</matrix><instance_geometry url='#g'/>"), "2 numbers, not 16"),
        (collada(TRIANGLE, "<node>" * 120 + "</node>" * 120), "nested more than 100 deep"),
        (collada(TRIANGLE, "<instance_geometry url='#g'/>" * 1_001), "at most 1,000 are read"),
    ],
)
def test_damaged_files_are_refused_with_the_place(data: bytes, said: str) -> None:
    with pytest.raises(AssetError, match=said):
        triangles(data)
