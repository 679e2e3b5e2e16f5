"""Contact episodes begin and end once, in every world, however often an engine separates the bodies in between."""

import itertools
import random
from pathlib import Path

import pytest
import yaml

import symaware_cli as sa
from symaware_cli.core import Contact
from symaware_cli.engine.runtime.contact_episodes import ContactEpisodes

#: What each world needs so that bodies move in a horizontal plane.
WORLDS = {"kinematic": {}, "pymunk": {}, "pybullet": {"gravity": [0, 0, 0], "ground": None}}
BALL = {"circle": {"radius": 0.3}}
CRATE = {"box": {"length": 1.0, "width": 1.0, "height": 1.0}}


def robots(*starts: list[float], goals: list[list[float]], **entity: object) -> dict[str, object]:
    return {
        "count": len(starts),
        "entity": {"shape": BALL, "mass": 5.0, "max_force": 20.0, **entity},
        "model": {"use": "single-integrator", "with": {"max_speed": 1.0}},
        "state": list(starts),
        "knowledge": {"goal": goals},
        "components": {
            "sense": {"use": "perception.self"},
            "steer": {"use": "control.go-to-goal", "with": {"speed": 0.8}},
        },
    }


#: The number of episodes, the worlds that can, the entities, the robots and the parameters of the world. The kinematic
#: world has no forces, so nothing is pushed or bounces there.
SCENES: dict[str, tuple[int, list[str], dict[str, object], dict[str, object], dict[str, object]]] = {
    "two robots push crates, one of which is too heavy": (
        2,
        ["pymunk", "pybullet"],
        {
            "crate": {"shape": CRATE, "position": [3, 0], "mass": 4.0},
            "heavy": {"shape": CRATE, "position": [3, 3], "mass": 400.0},
        },
        robots([0, 0], [0, 3], goals=[[7, 0], [7, 3]]),
        {"damping": 0.9},
    ),
    "a robot drives at a wall": (
        1,
        ["kinematic", "pymunk", "pybullet"],
        {"wall": {"shape": {"wall": {"points": [[3, -2], [3, 2]], "thickness": 0.2}}}},
        robots([0, 0], goals=[[3.3, 0]]),
        {},
    ),
    "two robots drive at each other": (
        1,
        ["kinematic", "pymunk", "pybullet"],
        {},
        robots([-2, 0], [2, 0], goals=[[0.1, 0], [-0.1, 0]]),
        {},
    ),
    "a ball between two cushions": (
        10,
        ["pymunk", "pybullet"],
        {
            "left": {"shape": {"wall": {"points": [[-2, -1], [-2, 1]], "thickness": 0.2}}, "elasticity": 1.0},
            "right": {"shape": {"wall": {"points": [[2, -1], [2, 1]], "thickness": 0.2}}, "elasticity": 1.0},
            "ball": {"shape": BALL, "position": [0, 0], "mass": 1.0, "velocity": [2.0, 0.0], "elasticity": 1.0},
        },
        robots([0, 9], goals=[[0, 9]]),
        {},
    ),
    "a ball comes to rest on a floor in ever shorter leaps": (
        12,
        ["pymunk", "pybullet"],
        {
            "floor": {"shape": {"wall": {"points": [[-2, 0], [2, 0]], "thickness": 0.2}}, "elasticity": 1.0},
            "ball": {"shape": BALL, "position": [0, 1.4], "mass": 1.0, "elasticity": 0.8},
        },
        robots([0, 9], goals=[[0, 9]]),
        {"gravity": -9.81},
    ),
}


@pytest.mark.parametrize("scene", SCENES)
def test_the_worlds_agree_on_the_episodes_of_a_scene(scene: str, tmp_path: Path) -> None:
    """To one episode, or to a fifth of them."""
    expected, worlds, entities, agents, parameters = SCENES[scene]
    counts = {}
    for world in worlds:
        own = {"time_step": 0.05, **WORLDS[world], **parameters}
        if "gravity" in parameters:
            down = parameters["gravity"]
            own["gravity"] = [0, down] if world == "pymunk" else [0, down, 0]
        environment = {"use": world, "with": own, "entities": entities}
        document = {"symaware": 1, "name": "scene", "run": {"duration": 15.0}, "environment": environment}
        path = tmp_path / f"{world}.yaml"
        path.write_text(yaml.safe_dump(document | {"agents": {"robot": agents}}))
        run = sa.load(path).run(output=tmp_path / f"{world}.mcap")
        counts[world] = run.summary.contacts
        events = [event for event in run.events if event.name == "contact"]
        assert sum(event.data["begins"] for event in events) == counts[world]
        # Of each pair, episodes begin and end in turn.
        for pair in {(event.data["first"], event.data["second"]) for event in events}:
            stages = [event.data["begins"] for event in events if (event.data["first"], event.data["second"]) == pair]
            assert stages == [not number % 2 for number in range(len(stages))]
    tolerance = max(1, 0.2 * expected)
    assert all(abs(count - expected) <= tolerance for count in counts.values()), counts
    assert max(counts.values()) - min(counts.values()) <= tolerance, counts


def test_all_contacts_of_the_engine_remain_in_the_log(tmp_path: Path) -> None:
    _, _, entities, agents, parameters = SCENES["two robots push crates, one of which is too heavy"]
    environment = {"use": "pymunk", "with": {"time_step": 0.05, **parameters}, "entities": entities}
    document = {"symaware": 1, "name": "push", "run": {"duration": 12.0}, "environment": environment}
    path = tmp_path / "push.yaml"
    path.write_text(yaml.safe_dump(document | {"agents": {"robot": agents}}))
    run = sa.load(path).run(output=tmp_path / "push.mcap")
    stages = [contact.stage for contact in sa.open_log(tmp_path / "push.mcap").contacts()]
    assert run.summary.contacts == stages.count("BEGIN") == 2
    assert stages.count("RESUME") > 20
    every = sa.load(path, {"environment.with.debounce": 0.0}).run(output=tmp_path / "every.mcap")
    assert every.summary.contacts == stages.count("BEGIN") + stages.count("RESUME")
    assert {contact.stage for contact in sa.open_log(tmp_path / "every.mcap").contacts()} == {"BEGIN", "END"}


@pytest.mark.parametrize("debounce", [0, 1, 3, 10])
@pytest.mark.parametrize("seed", range(5))
def test_episodes_are_those_of_a_direct_definition(debounce: int, seed: int) -> None:
    """Bodies touch at random instants; gaps of fewer than `debounce` instants are filled in."""
    draw = random.Random(seed)
    touching = [draw.random() < 0.4 for _ in range(200)] + [False] * (debounce + 1)
    episodes = ContactEpisodes(debounce)
    begun: list[int] = []
    ended: list[int] = []
    for now, (before, present) in enumerate(zip([False, *touching], touching, strict=False)):
        ended += [now for _ in episodes.ended(now)]
        if before != present:
            contact, is_announced = episodes.follow(Contact("a", "b", (0.0, 0.0), 0.0, present), now)
            if is_announced:
                (begun if contact.begins else ended).append(now)
            assert contact.resumes == (present and not is_announced)
    instants = [now for now, present in enumerate(touching) if present]
    first = instants[:1] + [
        later for earlier, later in itertools.pairwise(instants) if later - earlier - 1 >= max(debounce, 1)
    ]
    last = [
        earlier for earlier, later in itertools.pairwise(instants) if later - earlier - 1 >= max(debounce, 1)
    ] + instants[-1:]
    assert begun == first
    assert ended == [instant + 1 + debounce for instant in last]
