"""Images of a world, from where the camera is, of what stands there."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from simulating import STEP, Team, present, simulation

from symaware_cli import Entity, Obstacle
from symaware_cli.core import Frame
from symaware_cli.engine.components.perception_camera import Camera
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.failure import RunError
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.worlds.spatial import PyBulletEnvironment

DISC = Entity(shape={"cylinder": {"radius": 0.2, "height": 1.0}})
CRATE = {"crate": {"shape": {"box": {"length": 1.0, "width": 1.0, "height": 1.0}}, "position": [4, 0]}}

#: What the crate, the ground and the other agent are in `segments`, where there are two agents and one entity.
OTHER, THE_CRATE, GROUND = 2, 3, 4


def begun(
    parameters: Mapping[str, Any],
    *,
    states: tuple[tuple[float, float, float], tuple[float, float, float]] = ((0.0, 0.0, 0.0), (0.0, 3.0, 0.0)),
    obstacles: Mapping[str, Any] = CRATE,
    environment: KinematicEnvironment | None = None,
    seed: int = 7,
) -> Simulation:
    team = Team(
        {"look": lambda: Camera(Camera.Parameters(**{"width": 64, "height": 48, **parameters}))},
        len(states),
        [list(state) for state in states],
        model=Unicycle(),
        entity=DISC,
    )
    made = {name: Obstacle.model_validate(each) for name, each in obstacles.items()}
    world = environment or PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=STEP / 1e9))
    ready = simulation({"robot": team}, environment=world, obstacles=made, seed=seed)
    ready.initialise()
    return ready


def frame(parameters: Mapping[str, Any], **options: Any) -> Frame:
    ready = begun(parameters, **options)
    with ready.environment:
        return present(turn(ready))


def turn(ready: Simulation) -> Frame | None:
    for entry in ready.entries:
        for component in entry.components:
            component.compute_and_update()
    found = ready.groups[0].awareness.readings.get("look")
    assert found is None or isinstance(found, Frame)
    return found


def test_it_looks_forwards_and_measures_distances_to_bodies() -> None:
    image = frame({}).images[0]
    assert image is not None
    assert image.colour.shape == (48, 64, 3)
    assert image.segments[24, 32] == THE_CRATE
    assert image.depth[24, 32] == pytest.approx(3.5, rel=0.01)
    assert np.isinf(image.depth[0]).all()
    assert (image.segments[0] == 0).all()
    assert image.segments[-1, 0] == GROUND


def test_the_sizes_of_seen_bodies_follow_from_the_field_of_view() -> None:
    wide, narrow = (
        (present(frame({"field_of_view": view, "width": 256, "height": 192}).images[0]).segments == THE_CRATE).sum()
        for view in (1.2, 0.6)
    )
    assert narrow / wide == pytest.approx((math.tan(0.6) / math.tan(0.3)) ** 2, rel=0.1)


@pytest.mark.parametrize("whom", ["robot.1", [0.0, 3.0, 0.5]])
def test_it_keeps_somebody_or_a_point_in_the_middle(whom: list[float] | str) -> None:
    seen = frame({"look_at": whom})
    assert present(seen.images[0]).segments[24, 32] == OTHER
    np.testing.assert_allclose(seen.targets[0], [0, 3, 0.5], atol=1e-6)


def test_it_looks_down_and_from_where_it_is_mounted() -> None:
    seen = frame({"pitch": -1.5, "position": (0.5, 0.0, 1.0)})
    assert (present(seen.images[0]).segments[24:] == GROUND).mean() > 0.85
    np.testing.assert_allclose(seen.positions[0], [0.5, 0, 1.5], atol=1e-6)


def test_agents_have_colours_of_their_own() -> None:
    image = frame({"look_at": "robot.1"}).images[0]
    assert image is not None
    colour = image.colour[24, 32].astype(int)
    assert np.ptp(colour) > 50


def test_noise_has_its_deviation_and_is_repeated_with_the_seed() -> None:
    exact, one, same, other = (
        present(frame({"depth_noise": deviation, "colour_noise": 5 * deviation}, seed=seed).images[0])
        for deviation, seed in ((0.0, 1), (0.1, 1), (0.1, 1), (0.1, 2))
    )
    crate = exact.segments == THE_CRATE
    assert np.std(one.depth[crate] - exact.depth[crate]) == pytest.approx(0.1, rel=0.2)
    np.testing.assert_array_equal(one.depth, same.depth)
    np.testing.assert_array_equal(one.colour, same.colour)
    assert (one.depth[crate] != other.depth[crate]).any()


def test_a_camera_that_drops_out_has_no_image() -> None:
    ready = begun({"dropout": 0.5, "width": 4, "height": 4})
    with ready.environment:
        lost = [image is None for _ in range(100) for image in present(turn(ready)).images]
    assert np.mean(lost) == pytest.approx(0.5, abs=0.12)


def test_a_late_image_is_that_of_then() -> None:
    ready = begun({"delay": 0.1})
    with ready.environment:
        assert turn(ready) is None
        ready.groups[0].control_input = [[2.0, 0.0]] * 2
        for _ in range(2):
            ready.environment.step()
            ready.clock.now += STEP
            late = turn(ready)
    assert late is not None
    assert late.time == 0
    assert present(late.images[0]).depth[24, 32] == pytest.approx(3.5, rel=0.01)


def test_taking_images_changes_nothing_in_the_world() -> None:
    after = []
    for parameters in ({}, {"width": 8, "height": 8}):
        ready = begun(parameters)
        with ready.environment:
            for _ in range(5):
                turn(ready)
                ready.environment.step()
            after.append(ready.environment.snapshot().positions)
    np.testing.assert_array_equal(after[0], after[1])


def test_a_world_without_images_is_refused() -> None:
    from symaware_cli.engine.environments.kinematic import KinematicEnvironment

    with pytest.raises(RunError, match="this world has no images"):
        begun({}, environment=KinematicEnvironment())


def test_nobody_to_look_at_is_refused() -> None:
    with pytest.raises(RunError, match="`look_at` names `moon`"):
        begun({"look_at": "moon"})
