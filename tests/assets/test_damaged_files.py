"""Files of meshes and robots, sound and damaged, in the spatial world.

Each file is either refused with the place of the problem, or the engine has as many collision shapes as the file
declares, of the sizes that an independent reader (trimesh) finds. The engine runs in a separate process, since some
files crash it.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from symaware_cli.assets.mesh_file import stl

#: A wedge whose extents differ along each axis.
CORNERS = [(0, 0, 0), (3, 0, 0), (0, 2, 0), (3, 2, 0), (0, 0, 1), (0, 2, 1)]
FACES = [(1, 3, 4), (1, 4, 2), (1, 2, 5), (3, 6, 4), (1, 5, 6), (1, 6, 3), (2, 4, 6), (2, 6, 5)]
TRIANGLES = np.array([[CORNERS[corner - 1] for corner in face] for face in FACES], float)
BOX = [[0, 0, 0], [3, 2, 1]]

LOOPS = ["".join(f"vertex {x:g} {y:g} {z:g}\n" for x, y, z in triangle) for triangle in TRIANGLES.tolist()]
FACETS = "".join(f"facet normal 0 0 0\nouter loop\n{loop}endloop\nendfacet\n" for loop in LOOPS)
NUMBERS = " ".join(str(number) for corner in CORNERS for number in corner)
INDICES = " ".join(str(corner - 1) for face in FACES for corner in face)
COLLADA = f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="a" count="18">{NUMBERS}</float_array>
<technique_common><accessor source="#a" count="6" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles count="8"><input semantic="VERTEX" source="#v" offset="0"/>
<p>{INDICES}</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node id="n"><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>
"""
#: A sound file of each kind, by its suffix; the second kind of STL has another name.
SOUND: dict[str, tuple[str, bytes]] = {
    "binary": (".stl", stl(TRIANGLES)),
    "ascii": (".stl", f"solid a\n{FACETS}endsolid a\n".encode()),
    "obj": (
        ".obj",
        "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS).encode()
        + "".join(f"f {a} {b} {c}\n" for a, b, c in FACES).encode(),
    ),
    "collada": (".dae", COLLADA.encode()),
}
USES = ("mesh", "collision", "visual")
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'

#: Builds a world with each of the files, and prints the result.
CHILD = """
import json, sys
from pathlib import Path
from symaware_cli.core import Obstacle, WorldError
from symaware_cli.worlds.bullet import engine
from symaware_cli.worlds.spatial import PyBulletEnvironment
for line in sys.stdin:
    name, shape = json.loads(line)
    print(json.dumps([name, None]), flush=True)
    world = PyBulletEnvironment(PyBulletEnvironment.Parameters(ground=None, visuals=True))
    world.folder = Path(sys.argv[1])
    try:
        world.initialise([], {"it": Obstacle(shape=shape, position=(0, 0, 0))}, 1)
    except WorldError as error:
        print(json.dumps([name, {"refused": str(error)}]), flush=True)
        continue
    with world:
        body = world._entities["it"]
        box = engine.getAABB(body, -1, world._id)
        world.step()
        if "mesh" in shape:  # the engine does not list the shapes of bodies of this kind
            (made,) = world._builder._collision_shapes.values()
            body = engine.createMultiBody(0, made, physicsClientId=world._id)
        shapes = len(engine.getCollisionShapeData(body, -1, world._id))
        print(json.dumps([name, {"shapes": shapes, "box": box}]), flush=True)
"""


class Case(NamedTuple):
    """A file, and how a shape uses it."""

    name: str
    use: str
    suffix: str
    data: bytes


def damages(kind: str) -> Iterator[tuple[str, bytes]]:
    """Yield damaged files of a kind, by the damage."""
    _, sound = SOUND[kind]
    yield "sound", sound
    yield "empty", b""
    yield "line", b"\n"
    yield "begun", sound[:20]
    yield "halved", sound[: len(sound) // 2]
    yield "shortened", sound[:-9]
    yield "lengthened", sound + b"more"
    yield "zeros", bytes(len(sound))
    yield "noise", np.random.default_rng(7).bytes(300)
    yield "page", b"<html><body/></html>"
    if kind == "binary":
        yield "miscounted", sound[:80] + b"\x28\x6b\xee\x00" + sound[84:]
        yield "none", sound[:80] + bytes(4)
        yield "not a number", sound.replace(np.float32(3).tobytes(), np.float32(np.nan).tobytes())
        yield "infinite", sound.replace(np.float32(3).tobytes(), np.float32(np.inf).tobytes())
        yield "flat", stl(TRIANGLES * [1, 1, 0])
        return
    yield "not a number", sound.replace(b"3 ", b"nan ")
    yield "infinite", sound.replace(b"3 ", b"1e400 ")
    yield "comma", sound.replace(b"3 ", b"3,5 ")
    yield (
        "flat",
        {
            "ascii": sound.replace(b" 1\n", b" 0\n"),
            "obj": sound.replace(b" 1\n", b" 0\n", 2),
            "collada": sound.replace(b"0 0 1 0 2 1", b"0 0 0 0 2 0"),
        }[kind],
    )
    if kind == "ascii":
        yield "unclosed", sound.replace(b"endloop", b"", 1)
        yield "quadrangle", sound.replace(b"endloop", b"vertex 1 1 1\nendloop", 1)
    if kind == "obj":
        yield "beyond", sound + b"f 1 2 9\n"
        yield "far beyond", sound + b"f 1 2 999999999\n"
        yield "before", sound + b"f 1 2 -9\n"
        yield "zero", sound + b"f 0 1 2\n"
        yield "huge", sound + b"f 1 2 99999999999999999999\n"
        yield "two corners", sound + b"f 1 2\n"
        yield "marked", b"\xef\xbb\xbf" + sound
        yield "continued", sound.replace(b"f 1 3", b"f 1 \\\n 3")
        other = sound.split(b"f ")[0].replace(b"v 0", b"v -2") + b"f 7 9 10\nf 7 8 11\nf 9 12 10\n"
        yield "two parts", sound + b"o other\n" + other
    if kind == "collada":
        yield "no scene", sound[: sound.index(b"<library_visual")] + b"</COLLADA>"
        yield "no geometry", b"<COLLADA/>"
        yield "beyond", sound.replace(b"<p>0 ", b"<p>9 ")
        yield "far beyond", sound.replace(b"<p>0 ", b"<p>999999999 ")
        yield "lost", sound.replace(b'url="#g"', b'url="#h"')
        yield "miscounted", sound.replace(b'count="8"', b'count="80"')
        yield "numbers miscounted", sound.replace(b'count="18"', b'count="180000"')
        yield "bomb", b"<!DOCTYPE a [<!ENTITY b '3'>]>" + sound
        yield "deep", sound.replace(b"<node ", b"<node>" * 200 + b"<node ").replace(b"</node>", b"</node>" * 201)


def cases() -> list[Case]:
    """All combinations of damage, kind of file and use."""
    return [
        Case(f"{use} {kind} {damage}", use, SOUND[kind][0], data)
        for kind in SOUND
        for damage, data in damages(kind)
        for use in USES
        if not (use == "mesh" and kind == "collada")  # the schema has no mesh shape of such a file
    ]


def mutated(count: int) -> list[Case]:
    """Sound files with a few bytes changed, inserted or lost."""
    chance, found = np.random.default_rng(11), []
    for number in range(count):
        kind = list(SOUND)[number % 4]
        suffix, sound = SOUND[kind]
        data = bytearray(sound)
        for _ in range(int(chance.integers(1, 4))):
            at = int(chance.integers(len(data)))
            if chance.random() < 0.5:
                data[at] = int(chance.integers(256))
            elif chance.random() < 0.5:
                data.insert(at, data[int(chance.integers(len(data)))])
            else:
                del data[at]
        uses = USES[1:] if kind == "collada" else USES
        use = uses[int(chance.integers(len(uses)))]
        found.append(Case(f"{use} {kind} mutant {number}", use, suffix, bytes(data)))
    return found


def outcomes(tried: list[Case], folder: Path) -> dict[str, Any]:
    """Build a world with each file in a child process."""
    lines = []
    for number, case in enumerate(tried):
        file = f"{number}{case.suffix}"
        (folder / file).write_bytes(case.data)
        shape: dict[str, Any] = {"mesh": {"file": file, "radius": 4.0}}
        if case.use != "mesh":
            shown = f'<{case.use}><geometry><mesh filename="{file}"/></geometry></{case.use}>'
            (folder / f"{number}.urdf").write_text(f'<robot name="r"><link name="a">{INERTIAL}{shown}</link></robot>')
            shape = {"urdf": {"file": f"{number}.urdf", "radius": 4.0}}
        lines.append(json.dumps([case.name, shape]))
    child = subprocess.run(
        [sys.executable, "-c", CHILD, str(folder)], input="\n".join(lines), capture_output=True, text=True, check=False
    )
    found = dict(json.loads(line) for line in child.stdout.splitlines() if line.startswith("["))
    begun = next((name for name, outcome in found.items() if outcome is None), "the end")
    assert child.returncode == 0, f"{begun}: {child.returncode}\n{child.stderr[-2000:]}"
    return found


def read_independently(case: Case, folder: Path) -> Any:
    """Return the bounding box of a file from trimesh; None if trimesh cannot read it."""
    import trimesh

    path = folder / f"independent{case.suffix}"
    # trimesh does not support byte order marks: it skips a line that begins with one.
    path.write_bytes(case.data.removeprefix(b"\xef\xbb\xbf"))
    try:
        return np.array(trimesh.load_scene(path, process=False).bounds)
    except Exception:  # errors of every kind: trimesh is not made for damaged files
        return None


def check(tried: list[Case], folder: Path, independent: bool) -> int:
    """Check the result of each file; return the number of boxes that were compared."""
    found, compared = outcomes(tried, folder), 0
    for number, case in enumerate(tried):
        outcome = found[case.name]
        if "refused" in outcome:
            file = f"{number}{case.suffix}"
            assert not case.name.endswith("sound"), f"{case.name}: {outcome}"
            assert file in outcome["refused"] or f"{number}.urdf:1:" in outcome["refused"], outcome
            continue
        # The engine counts the hulls of a mesh shape, and the `collision` elements of a robot.
        declared = {"mesh": 2 if case.name.endswith("two parts") else 1, "collision": 1, "visual": 0}
        assert outcome["shapes"] == declared[case.use], case.name
        if case.use == "visual":
            continue
        box = read_independently(case, folder) if independent else np.array(BOX)
        if box is None:
            continue
        compared += 1
        # The engine has a margin of 2 mm, which grows with the mesh.
        np.testing.assert_allclose(outcome["box"], box, atol=4e-3 * max(1.0, np.abs(box).max()), err_msg=case.name)
    return compared


def test_files_that_crash_the_engine_are_refused_or_read(tmp_path: Path) -> None:
    kept = {"sound", "empty", "miscounted", "beyond", "flat", "marked"}
    tried = [case for case in cases() if case.name.split(" ", 2)[2] in kept and case.use != "visual"]
    # Seven sound files, without a mesh shape of Collada, and an OBJ with a byte order mark in both uses.
    assert check(tried, tmp_path, independent=False) == 7 + 2


@pytest.mark.slow
def test_no_damage_to_a_file_goes_unnoticed(tmp_path: Path) -> None:
    (tmp_path / "table").mkdir()
    (tmp_path / "mutants").mkdir()
    assert check(cases(), tmp_path / "table", independent=True) >= 13
    assert check(mutated(150), tmp_path / "mutants", independent=True) > 10
