"""The requirements of components on their world, and the bodies that they name."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli.engine.components.perception_camera import Camera
from symaware_cli.language.build import build
from symaware_cli.language.problem import ScenarioError

SCENARIO = {
    "symaware": 1,
    "name": "watched",
    "run": {"duration": 0.2},
    "environment": {
        "use": "pybullet",
        "entities": {"tower": {"shape": {"circle": {"radius": 0.5}}, "position": [2, 0]}},
    },
    "agents": {
        "robot": {
            "count": 2,
            "model": {"use": "unicycle"},
            "state": {"all": [0, 0, 0]},
            "components": {"eye": {"use": "perception.camera", "with": {"look_at": "tower"}}},
        }
    },
}


def problems(path: Path, *overrides: Any) -> Any:
    path = path / "watched.yaml"
    path.write_text(yaml.safe_dump(SCENARIO))
    try:
        build(path, overrides).simulation.environment.close()
    except ScenarioError as error:
        return [(problem.code, problem.path) for problem in error.problems]
    return []


@pytest.mark.parametrize("whom", ["tower", "robot.1", "[1, 2, 3]", "null"])
def test_a_plugin_with_its_requirements_is_created(whom: str, tmp_path: Path) -> None:
    assert problems(tmp_path, f"agents.robot.components.eye.with.look_at={whom}") == []


def test_an_unknown_body_is_reported_where_it_is_named(tmp_path: Path) -> None:
    found = problems(tmp_path, "agents.robot.components.eye.with.look_at=robot")
    assert found == [("unknown-target", "agents.robot.components.eye.with.look_at")]


@pytest.mark.parametrize("world", ["kinematic", "pymunk"])
def test_a_world_that_lacks_a_required_feature_is_reported_before_the_run(world: str, tmp_path: Path) -> None:
    assert problems(tmp_path, f"environment.use={world}") == [("unsuitable", "agents.robot.components.eye")]


def test_a_component_that_names_a_missing_parameter_is_reported_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Camera, "bodies", {"nowhere": "agent or entity"})
    assert problems(tmp_path) == [("broken-plugin", "agents.robot.components.eye")]


DRONE = {"use": "quadrotor", "with": {"ground_effect": True, "downwash": True}}


def flown(path: Path, *overrides: Any, **entity: Any) -> Any:
    drone = {"model": DRONE, "state": [0, 0, 1, *[0] * 9], "entity": entity}
    return problems(path, f"agents={yaml.safe_dump({'drone': drone}, default_flow_style=True)}", *overrides)


def test_effects_of_air_are_refused_in_worlds_without_vehicles(tmp_path: Path) -> None:
    where = [("unsuitable", f"agents.drone.model.with.{name}") for name in ("downwash", "ground_effect")]
    assert flown(tmp_path) == []
    assert flown(tmp_path, "environment.use=kinematic") == where
    assert flown(tmp_path, "environment.use=kinematic", "agents.drone.model.with={}") == []


def test_only_the_outline_of_a_body_that_comes_with_the_model_can_be_set(tmp_path: Path) -> None:
    assert flown(tmp_path, shape={"circle": {"radius": 0.3}}) == []
    found = flown(tmp_path, shape={"circle": {"radius": 0.3}}, mass=0.5, max_force=1.0)
    assert found == [("unsuitable", f"agents.drone.entity.{name}") for name in ("mass", "max_force")]


def test_the_gravity_of_a_vehicle_is_that_of_the_world(tmp_path: Path) -> None:
    moon = "environment.with.gravity=[0, 0, -1.62]"
    assert flown(tmp_path, moon) == [("unsuitable", "agents.drone.model.with.gravity")]
    assert flown(tmp_path, moon, "agents.drone.model.with.gravity=1.62") == []
