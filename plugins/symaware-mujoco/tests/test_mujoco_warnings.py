"""Warnings of `validate` about the world of MuJoCo: inexact elasticities, and meshes that are not convex."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from symaware_mujoco.bounce import TOLERANCE, rebound_range

import symaware_cli as sa

pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

BALL = {"circle": {"radius": 0.1}}
#: Two tetrahedra that share a corner: one surface, with a waist.
WAIST = (
    "v 0 0 0\nv 1 0 1\nv -1 1 1\nv -1 -1 1\nv 1 0 -1\nv -1 1 -1\nv -1 -1 -1\n"
    "f 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\nf 1 6 5\nf 1 7 6\nf 1 5 7\nf 5 6 7\n"
)
ROBOT = """<robot name="post"><link name="base">
<inertial><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
<collision><geometry><mesh filename="waist.obj"/></geometry></collision></link></robot>"""


def warnings(folder: Path, entities: dict[str, Any], **given: Any) -> list[tuple[str, str]]:
    """The codes and the paths of all warnings of a scenario; each has its place in the file."""
    scenario = {
        "symaware": 1,
        "name": "s",
        "run": {"duration": 1.0},
        "environment": {"use": "mujoco", "entities": entities, **given},
    }
    (folder / "s.yaml").write_text(yaml.safe_dump(scenario))
    found = sa.load(folder / "s.yaml").validate().warnings
    assert all(each.span for each in found)
    return [(each.code, each.path) for each in found]


def ball(x: float, elasticity: float) -> dict[str, Any]:
    return {"shape": BALL, "position": [x, 0, 1], "mass": 1.0, "elasticity": elasticity}


@pytest.mark.parametrize("elasticity", [0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
def test_no_collision_leaves_another_part_of_the_speed_by_more_than_a_twentieth(elasticity: float) -> None:
    assert rebound_range(elasticity) == pytest.approx((elasticity, elasticity), abs=TOLERANCE)


def test_an_elasticity_that_is_kept_within_five_per_cent_gives_no_warning(tmp_path: Path) -> None:
    assert warnings(tmp_path, {"a": ball(0, 0.7), "b": ball(1, 0.0), "c": ball(2, 1.0)}) == []


def test_a_smaller_elasticity_gives_one_warning_for_each_product(tmp_path: Path) -> None:
    found = warnings(tmp_path, {"a": ball(0, 0.3), "b": ball(1, 0.3), "c": ball(2, 0.9)})
    where = "environment.entities.a.elasticity"
    # With the ground, which is elastic, with each other, and with `c`.
    assert found == [("inexact-elasticity", where)] * 3
    assert warnings(tmp_path, {"a": ball(0, 0.3)}, **{"with": {"ground": None}}) == []


def test_a_mesh_that_is_not_convex_gives_a_warning_where_it_is_named(tmp_path: Path) -> None:
    (tmp_path / "waist.obj").write_text(WAIST)
    (tmp_path / "post.urdf").write_text(ROBOT)
    entities = {
        "mesh": {"shape": {"mesh": {"file": "waist.obj", "radius": 1.0}}, "position": [0, 0, 2], "mass": 1.0},
        "robot": {"shape": {"urdf": {"file": "post.urdf", "radius": 1.0}}, "position": [5, 0, 2], "mass": 1.0},
    }
    assert warnings(tmp_path, entities) == [
        ("concave", "environment.entities.mesh.shape.mesh.file"),
        ("concave", "environment.entities.robot.shape.urdf.file"),
    ]
