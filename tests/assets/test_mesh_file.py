"""Mesh files: valid ones are read, and damaged ones are refused with the place of the problem."""

import struct
from pathlib import Path

import numpy as np
import pytest

from symaware_cli.assets import mesh_file
from symaware_cli.assets.asset_error import AssetError
from symaware_cli.assets.mesh_file import check_mesh, is_binary_stl, parse_mesh, stl

CORNERS = "v 0 0 0\nv 3 0 0\nv 0 2 0\nv 0 0 1\n"
FACES = "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
TETRAHEDRON = np.array(
    [
        [[0, 0, 0], [0, 2, 0], [3, 0, 0]],
        [[0, 0, 0], [3, 0, 0], [0, 0, 1]],
        [[3, 0, 0], [0, 2, 0], [0, 0, 1]],
        [[0, 0, 0], [0, 0, 1], [0, 2, 0]],
    ],
    float,
)


def ascii_stl(corners: np.ndarray = TETRAHEDRON) -> str:
    facets = [
        "facet normal 0 0 0\n outer loop\n"
        + "".join(f"  vertex {x} {y} {z}\n" for x, y, z in triangle)
        + " endloop\nendfacet\n"
        for triangle in corners.tolist()
    ]
    return f"solid a\n{''.join(facets)}endsolid a\n"


@pytest.mark.parametrize(
    ("data", "suffix"),
    [
        (stl(TETRAHEDRON), ".stl"),
        (b"solid" + stl(TETRAHEDRON)[5:], ".STL"),  # exporters begin binary files like this, too
        (ascii_stl().encode(), ".stl"),
        (ascii_stl().upper().replace("\n", "\r\n").encode(), ".stl"),
        ((CORNERS + FACES).encode(), ".obj"),
        (b"\xef\xbb\xbf" + (CORNERS + FACES).replace(" ", "\t").encode(), ".OBJ"),
        ((CORNERS + FACES).replace("f 1 3", "f 1 \\\n 3").replace("\n", "\r\n").encode(), ".obj"),
        ((CORNERS + FACES).replace("\n", "\r").encode(), ".obj"),
        ((FACES + CORNERS).encode(), ".obj"),
        ((CORNERS.replace("\n", " 1 0 0\n") + "f -4 -2 -3\nf -4/1 -3/2/3 -1//1\nf 2 3 4\nf 1 4 3").encode(), ".obj"),
    ],
)
def test_all_ways_to_write_a_tetrahedron_give_its_triangles(data: bytes, suffix: str) -> None:
    surface = parse_mesh(data, suffix)
    np.testing.assert_array_equal(surface.triangles, TETRAHEDRON)
    np.testing.assert_array_equal(surface.bounds(), [[0, 0, 0], [3, 2, 1]])
    assert (surface.parts, surface.is_flat) == ((4,), False)


@pytest.mark.parametrize("face", ["f 1 2 4 3", "f 1/1 2/2 4/1 3/2", "f -4 -3 -1 -2"])
def test_a_face_is_a_fan_of_triangles(face: str) -> None:
    surface = parse_mesh((CORNERS + face).encode(), ".obj")
    assert surface.corners.tolist() == [[0, 1, 3], [0, 3, 2]]


def test_the_groups_of_an_obj_are_its_parts() -> None:
    assert parse_mesh(f"o a\n{CORNERS}{FACES}g b\ng c\n{FACES}f 1 2 3".encode(), ".obj").parts == (4, 5)


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("", 0, "no triangles"),
        (CORNERS, 0, "no triangles"),
        (CORNERS + "f 1 2 9\n", 5, "refers to vertex 9, and there are 4"),
        (CORNERS + "f 1 2 -5\n", 5, "before the first"),
        (CORNERS + "f 1 2 0\n", 5, "before the first"),
        (CORNERS + "f 1 2\n", 5, "at least 3 vertices, not 2"),
        (CORNERS + "f 1 2 x\n", 5, "`x` is no vertex"),
        (CORNERS + "f 1 2 3/a\n", 5, "`3/a` is no vertex"),
        (CORNERS + "f 1 2 1.5\n", 5, "`1.5` is no vertex"),
        (CORNERS.replace("3", "nan") + FACES, 2, "`nan` is no finite number"),
        (CORNERS.replace("3", "-inf") + FACES, 2, "`-inf` is no finite number"),
        (CORNERS.replace("3", "1e999") + FACES, 2, "too large"),
        (CORNERS.replace("3", "0,5") + FACES, 2, "decimals are written with a point"),
        (CORNERS.replace("3", "1_0") + FACES, 2, "`1_0` is no finite number"),
        (CORNERS.replace("v 3 0 0", "v 3 0") + FACES, 2, "3 numbers, not 2"),
    ],
)
def test_a_damaged_obj_is_refused_at_its_line(text: str, line: int, said: str) -> None:
    with pytest.raises(AssetError, match=said) as refused:
        parse_mesh(text.encode(), ".obj")
    assert refused.value.line == line


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("solid a\n", 1, "cut off: `facet` or `endsolid` is expected"),
        ("solid a\nendsolid a\n", 0, "no triangles"),
        (ascii_stl().rpartition("endsolid")[0], 29, "cut off: `facet` or `endsolid` is expected"),
        (ascii_stl().replace("vertex 3.0 0.0 0.0", "vertex 3.0 0.0", 1), 6, "3 numbers, not 2"),
        (ascii_stl().replace("3.0", "nan", 1), 6, "`nan` is no finite number"),
        (ascii_stl().replace("3.0", "3,0", 1), 6, "written with a point"),
        (ascii_stl().replace("  vertex 0.0 0.0 0.0\n", "", 1), 6, "3 vertices, not 2"),
        (ascii_stl().replace(" endloop\n", "", 1), 7, "`endfacet` stands where"),
        (ascii_stl().replace("outer", "inner", 1), 3, "`inner` stands where `outer` is expected"),
    ],
)
def test_a_damaged_ascii_stl_is_refused_at_its_line(text: str, line: int, said: str) -> None:
    with pytest.raises(AssetError, match=said) as refused:
        parse_mesh(text.encode(), ".stl")
    assert refused.value.line == line


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "it is empty"),
        (stl(TETRAHEDRON)[:50], "a head of 84 bytes, and this has 50"),
        (stl(TETRAHEDRON)[:-10], "states 4 triangles, which take 284 bytes; the file has 274"),
        (stl(TETRAHEDRON) + b"x", "the file has 285"),
        (stl(TETRAHEDRON)[:80] + struct.pack("<I", 2**32 - 1), "states 4,294,967,295 triangles"),
        (stl(TETRAHEDRON)[:80] + bytes(4), "no triangles"),
        (stl(TETRAHEDRON).replace(struct.pack("<f", 3.0), struct.pack("<f", np.nan)), "triangle 1 has a coordinate"),
    ],
)
def test_a_damaged_binary_stl_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(AssetError, match=said):
        parse_mesh(data, ".stl")


def test_a_flat_mesh_may_be_seen_but_not_be_a_body(tmp_path: Path) -> None:
    (tmp_path / "flat.obj").write_text(CORNERS + "f 1 2 3\n")
    check_mesh(tmp_path / "flat.obj", encloses=False)
    with pytest.raises(AssetError, match="lie in one plane"):
        check_mesh(tmp_path / "flat.obj", encloses=True)


def test_a_file_that_was_corrected_is_read_again(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(CORNERS)
    with pytest.raises(AssetError, match="no triangles"):
        check_mesh(tmp_path / "a.obj", encloses=True)
    (tmp_path / "a.obj").write_text(CORNERS + FACES)
    check_mesh(tmp_path / "a.obj", encloses=True)


def test_size_and_triangles_are_bounded_before_anything_is_parsed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open(tmp_path / "a.stl", "wb") as file:
        file.truncate((64 << 20) + 1)
    with pytest.raises(AssetError, match="longer than 64 MiB"):
        check_mesh(tmp_path / "a.stl", encloses=True)
    monkeypatch.setattr(mesh_file, "MOST_TRIANGLES", 3)
    for name, data in {".obj": (CORNERS + FACES), ".stl": ascii_stl()}.items():
        with pytest.raises(AssetError, match="4 triangles; at most 3 are read"):
            parse_mesh(data.encode(), name)
    with pytest.raises(AssetError, match="4 triangles; at most 3 are read"):
        parse_mesh(stl(TETRAHEDRON), ".stl")


def test_formats_without_a_reader_are_refused() -> None:
    for suffix in (".glb", ".ply", ""):
        with pytest.raises(AssetError, match=r"an .obj, .stl or .dae file"):
            parse_mesh(b"glTF", suffix)


def test_stl_files_are_written_in_binary() -> None:
    assert is_binary_stl(stl(TETRAHEDRON))
    assert not is_binary_stl(ascii_stl().encode())
