"""Meshes and upright bodies stand in a replay as in the world."""

import numpy as np
import pytest
from plot_logs import log_of
from rerun_files import saved

TETRAHEDRON = """v 0 0 0
v 0.4 0 0
v 0 0.4 0
v 0 0 0.4
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""

SCENARIO = """
symaware: 1
name: surfaces
seed: 1
run: {duration: 0.1}
environment:
  use: pybullet
  with: {time_step: 0.05}
  entities:
    rock: {shape: {mesh: {file: rock.obj, radius: 0.4, scale: 2.0}}, position: [1, 2, 3], heading: 0.5}
    post: {shape: {cylinder: {radius: 0.2, height: 1.5}}, position: [-1, 0]}
    tank: {shape: {cylinder: {radius: 0.2, height: 1.5}}, position: [-3, 0, 4]}
agents:
  drone:
    model: {use: quadrotor}
    state: [[0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]]
    components:
      sense: {use: perception.self}
"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("surfaces")
    (folder / "rock.obj").write_text(TETRAHEDRON)
    log = log_of(folder, SCENARIO)
    (folder / "rock.obj").unlink()
    return saved(log, folder)


def test_a_mesh_is_that_of_the_file_which_the_log_brings_along(recording):
    (blob,) = recording.static("/world/scenery/rock/0", "Asset3D:blob")
    assert bytes(blob).decode() == TETRAHEDRON
    assert recording.static("/world/scenery/rock/0", "Transform3D:scale") == [[2.0, 2.0, 2.0]]
    assert recording.values("/world/scenery/rock", "Transform3D:translation") == [[[1, 2, 3]]]


@pytest.mark.parametrize(("name", "low", "high"), [("post", 0.0, 1.5), ("tank", -0.75, 0.75)])
def test_what_has_no_height_stands_on_the_ground_and_else_around_its_middle(recording, name, low, high):
    vertices = np.array(recording.static(f"/world/scenery/{name}/0", "Mesh3D:vertex_positions"))
    assert (vertices[:, 2].min(), vertices[:, 2].max()) == (low, high)
