"""The files beside a composed scenario: a mesh, a robot, transition systems, and a table of errors of predictions."""

from __future__ import annotations

import io
from collections.abc import Mapping
from functools import cache
from pathlib import Path

#: Where the shipped scenarios are, whose transition systems composed ones refer to as well.
SCENARIOS = Path(__file__).parent.parent / "scenarios"

#: What a text `file` may be, by the definition that has it.
NAMES: Mapping[str, list[str]] = {
    "Mesh": ["wedge.obj", "tetrahedron.stl", "duck_vhacd.obj"],
    "Urdf": ["arm.urdf", "pybullet_data/cube_small.urdf"],
    "abstraction:abstraction.file:GraphName": ["halls.yaml", "halls.dot", "gripper.dot", "rooms.dot"],
    "component:control.policy:PolicyFile": ["policies/goal.onnx"],
    "component:uncertainty.conformal:CalibrationFile": ["errors.parquet"],
}

#: A folder of further assets, which a scenario may name.
ASSETS = "robots"

_WEDGE = """\
v -0.3 -0.2 0.0
v 0.3 -0.2 0.0
v 0.3 0.2 0.0
v -0.3 0.2 0.0
v -0.3 -0.2 0.4
v -0.3 0.2 0.4
f 1 3 2
f 1 4 3
f 1 2 5
f 4 6 3
f 2 3 6
f 2 6 5
f 1 5 6
f 1 6 4
"""

_TETRAHEDRON = [(0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 0.4)]

_LINK = """\
  <link name="{name}">
    <inertial>
      <mass value="{mass}"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual>{geometry}</visual>
    <collision>{geometry}</collision>
  </link>
"""

_JOINT = """\
  <joint name="hinge" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 0.25"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="5"/>
    <dynamics damping="0.1" friction="0.05"/>
  </joint>
"""

#: The graph of two halls, which are regions of composed scenarios, in both notations.
_YAML = """\
transitions:
  hall: [hall, lab]
  lab: [lab, hall]
initial: [hall, lab]
labels: {public: [hall, lab]}
"""
_DOT = """\
digraph {
  hall [labels="public"];
  lab [labels="public"];
  init -> hall;
  init -> lab;
  hall -> hall;
  hall -> lab;
  lab -> lab;
  lab -> hall;
}
"""


@cache
def side_files() -> Mapping[str, bytes]:
    """The content of each file, by its path relative to the scenario's folder."""
    box = '<geometry><box size="0.3 0.2 0.2"/></geometry>'
    wedge = '<geometry><mesh filename="package://arm/wedge.obj"/></geometry>'
    links = _LINK.format(name="base", mass=1.0, geometry=box) + _LINK.format(name="upper", mass=0.3, geometry=wedge)
    graphs = {path.name: path.read_bytes() for path in sorted(SCENARIOS.glob("*.dot"))}
    return {
        **graphs,
        "halls.yaml": _YAML.encode(),
        "halls.dot": _DOT.encode(),
        "wedge.obj": _WEDGE.encode(),
        "tetrahedron.stl": _stl().encode(),
        "arm.urdf": f'<robot name="arm">\n{links}{_JOINT}</robot>\n'.encode(),
        "arm/wedge.obj": _WEDGE.encode(),
        f"{ASSETS}/duck_vhacd.obj": _WEDGE.encode(),
        "errors.parquet": _errors(),
        "policies/goal.onnx": (SCENARIOS / "policies" / "goal.onnx").read_bytes(),
    }


def write_side_files(folder: Path) -> None:
    """Write all files into the folder of a scenario."""
    for name, content in side_files().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def _stl() -> str:
    facets = []
    for corners in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)):
        vertices = "\n".join("vertex {} {} {}".format(*_TETRAHEDRON[corner]) for corner in corners)
        facets.append(f"facet normal 0 0 0\nouter loop\n{vertices}\nendloop\nendfacet")
    return "solid tetrahedron\n" + "\n".join(facets) + "\nendsolid tetrahedron\n"


def _errors() -> bytes:
    """The errors of 60 runs, for the horizon and step that `uncertainty.conformal` has by default."""
    import pyarrow
    from pyarrow import parquet

    ahead = [0.25 * (place + 1) for place in range(8)]
    rows = [[{"time": time, "value": 0.01 * (run + 1) * time} for time in ahead] for run in range(60)]
    file = io.BytesIO()
    parquet.write_table(pyarrow.table({"prediction_error": rows}), file)
    return file.getvalue()
