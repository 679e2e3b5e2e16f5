import itertools
import os
import runpy
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT

from symaware_cli import ScenarioError, load, open_log
from symaware_cli.knowledge.synthesis.game import Game
from symaware_cli.knowledge.synthesis.strategy import synthesise

SCENARIOS = CHECKOUT / "scenarios"


def events(log: Path, *names: str) -> list[tuple[float, str]]:
    return [(each.time / 1e9, each.name) for each in open_log(log).events() if each.name in names]


def run(name: str, log: Path, changes: Mapping[str, Any] | None = None) -> Path:
    assert load(SCENARIOS / name, changes).run(output=log).status == "finished"
    return log


def cells(points: np.ndarray) -> list[tuple[int, int]]:
    """The cells of side 1 that a path passes, without those that it only touches."""
    inner = points[(np.abs(points - np.round(points)) > 1e-5).all(axis=1)]
    found = [tuple(each) for each in np.floor(inner).astype(int).tolist()]
    return [each for place, each in enumerate(found) if not place or each != found[place - 1]]


def test_a_robot_passes_a_door_only_while_it_is_open_and_from_cell_to_cell(tmp_path: Path) -> None:
    log = run("door.yaml", tmp_path / "a.mcap")
    path = cells(open_log(log).series("robot", "state").values[:, :2])
    assert all(abs(a - c) + abs(b - d) == 1 for (a, b), (c, d) in itertools.pairwise(path))
    assert path.count((3, 2)) >= 3  # through the passage
    assert len(events(log, "goal-met")) >= 4
    assert not events(log, "assumption-broken", "cells-left", "cell-skipped", "touched")


def test_an_agent_that_perceives_nothing_of_a_label_says_what_it_waits_for(tmp_path: Path) -> None:
    blind = {"agents.robot.components.sense.use": "perception.self", "run.duration": 2.0}
    log = open_log(run("door.yaml", tmp_path / "a.mcap", blind))
    (missing,) = [each for each in log.events() if each.name == "beliefs-missing"]
    assert missing.source == "agents.robot.decide"
    assert missing.data["labels"] == ["open"]
    assert not np.ptp(log.series("robot", "state").values, axis=0).any()
    assert not events(run("door.yaml", tmp_path / "b.mcap", {"run.duration": 2.0}), "beliefs-missing")


@pytest.mark.parametrize("world", ["pymunk", "pybullet"])
def test_a_body_that_forces_move_skips_no_cell_of_the_strategy(world: str, tmp_path: Path) -> None:
    changes = {"environment.use": world, "agents.robot.components.steer.with.apart_from": ["door"]}
    log = run("door.yaml", tmp_path / "a.mcap", changes)
    path = cells(open_log(log).series("robot", "state").values[:, :2])
    assert all(abs(a - c) + abs(b - d) == 1 for (a, b), (c, d) in itertools.pairwise(path))
    assert path.count((3, 2)) >= 1  # through the passage
    assert len(events(log, "goal-met")) >= 2
    assert not events(log, "assumption-broken", "cells-left", "cell-skipped", "touched")


def test_a_strategy_chooses_from_when_on_something_holds_for_ever(tmp_path: Path) -> None:
    log = open_log(run("dock.yaml", tmp_path / "a.mcap"))
    final = {each.source: each.name for each in log.events() if each.source.startswith("specifications.")}
    assert final == {"specifications.docked": "satisfied", "specifications.inspected": "satisfied"}
    settled = load(SCENARIOS / "dock.yaml").knowledge_models()["deciding"].system.labels["settled"]
    chosen = [int(cell) in settled for cell in log.series("robot", "decide.plan").values[:, 0]]
    assert chosen == sorted(chosen)
    assert chosen[-1]
    assert not chosen[0]


def test_a_door_that_never_opens_is_reported_as_overdue_and_keeps_the_robot_out(tmp_path: Path) -> None:
    log = run("locked.yaml", tmp_path / "a.mcap")
    assert [name for _, name in events(log, "assumption-overdue", "assumption-broken")] == ["assumption-overdue"]
    assert (3, 2) not in cells(open_log(log).series("robot", "state").values[:, :2])


def test_two_robots_share_a_crossing_and_neither_breaks_what_the_other_assumes(tmp_path: Path) -> None:
    log = run("corridor.yaml", tmp_path / "a.mcap")
    assert not events(log, "assumption-broken", "cells-left", "cell-skipped", "touched")
    by_both = [each.source for each in open_log(log).events() if each.name == "goal-met"]
    assert min(by_both.count(f"agents.{each}.decide") for each in ("courier", "loader")) >= 4


def test_every_request_is_answered(tmp_path: Path) -> None:
    log = open_log(run("deliver.yaml", tmp_path / "a.mcap"))
    customer = log.series("customer", "state").values
    robot = log.series("robot", "state").values
    here = np.asarray(np.abs(customer - [5.5, 4.7]).max(axis=1) <= 0.5)
    at_hatch = np.asarray((robot[:, :2] - [5.0, 3.0]).min(axis=1) >= -1e-6)
    begins = np.flatnonzero(here[1:] & ~here[:-1]) + 1
    assert len(begins) >= 2
    assert all(at_hatch[each : each + 250].any() for each in begins[:2])


@pytest.mark.parametrize("fallback", ["stop", "resume", "weaken"])
def test_a_broken_assumption_is_reported_at_that_step_and_the_agent_stays_or_goes_on(
    tmp_path: Path, fallback: str
) -> None:
    decide = "agents.robot.components.decide.with"
    changes = {
        f"{decide}.assumptions": ["always not open"],  # a lie
        f"{decide}.guarantees": ["always eventually desk", "always eventually door_side"],
        f"{decide}.on_violation": fallback,
        "regions.door_side": {"box": [2, 3, 0, 1]},
    }
    log = run("door.yaml", tmp_path / "a.mcap", changes)
    found = events(log, "assumption-broken", "goal-met")
    broken = next(when for when, name in found if name == "assumption-broken")
    door = open_log(log).series("door", "state")
    opened = next(when / 1e9 for when, at in zip(door.times.tolist(), door.values, strict=True) if at[1] - 3.2 >= 0)
    assert opened <= broken <= opened + 2.0  # at the next turn at which the robot is in its next cell
    goes_on = any(when > broken for when, name in found if name == "goal-met")
    assert goes_on == (fallback != "stop")


def test_a_gatekeeper_opens_again_and_again_and_never_while_the_robot_could_pass(tmp_path: Path) -> None:
    log = run("gatekeeper.yaml", tmp_path / "a.mcap")
    moves = [each.text for each in open_log(log).events() if each.name == "environment-moved"]
    assert sum("open true" in each for each in moves) > 5
    assert not any("cell c2_1, open true" in each for each in moves)
    path = cells(open_log(log).series("robot", "state").values[:, :2])
    assert (2, 1) in path  # the robot tries
    assert not any(column > 2 for column, _ in path)


def test_an_environment_that_leaves_no_choice_makes_the_robot_break_a_guarantee(tmp_path: Path) -> None:
    changes = {"agents.robot.components.decide.with.guarantees": ["always not open"]}
    log = run("gatekeeper.yaml", tmp_path / "a.mcap", changes)
    assert [name for _, name in events(log, "guarantee-broken")] == ["guarantee-broken"]


LIGHTS = """
symaware: 1
name: lights
run: {duration: 6000.0}
environment: {use: kinematic, with: {time_step: 0.5}}
regions:
  arena: {box: [0, 5, 0, 1]}
  gate: {box: [2, 3, 0, 1]}
  west: {box: [0, 1, 0, 1]}
  east: {box: [4, 5, 0, 1]}
  lit: {box: [-0.5, 0.5, 2.5, 3.5]}
knowledge_models:
  floor: {use: abstraction.grid, with: {cell: 1.0, region: arena}}
agents:
  green: {model: {use: single-integrator, with: {max_speed: 10}}, state: [0, 2], components: {}}
  red: {model: {use: single-integrator, with: {max_speed: 10}}, state: [0, 3], components: {}}
  robot:
    model: {use: single-integrator, with: {max_speed: 1.0}}
    state: [0.5, 0.5]
    components:
      sense: {use: perception.omniscient}
      decide:
        use: knowledge.strategy
        with:
          model: floor
          labels: {green: {agent: green, inside: lit}, red: {agent: red, inside: lit}}
          assumptions: [always not (green and red), always eventually green]
          guarantees:
            - always (not green and not gate implies not next gate)
            - always (gate implies not next gate)
            - always eventually west
            - always eventually east
      steer: {use: control.cells, with: {model: floor, speed: 1.0}}
"""


def lights(folder: Path, steps: int) -> tuple[list[str], list[float], list[float]]:
    """Run a robot at a gate with two lights that change at random, and are both lit in the last steps only.

    Returns:
        The names of its events, the times at which it decided to enter the gate although it was not green, and those of
        broken assumptions [s].
    """
    (folder / "lights.yaml").write_text(LIGHTS)
    draw, shown = np.random.default_rng(1), [(0, 1)]
    with load(folder / "lights.yaml").start(output=folder / "a.mcap") as simulation:
        for number in range(steps):
            wanted = (1, 1) if number >= steps - 3 else ((0, 1), (1, 0), (0, 0))[int(draw.integers(3))]
            for name, now, before in zip(("green", "red"), wanted, shown[-1], strict=True):
                simulation.set_control(name, [0.0, 2.0 * (now - before)])
            simulation.step()
            shown.append(wanted)
    log = open_log(folder / "a.mcap")
    plan = log.series("robot", "decide.plan")
    wrong = []
    for (_, before), (time, after) in itertools.pairwise(zip(plan.times.tolist(), plan.values.tolist(), strict=True)):
        if before != after and after[0] != 2 == after[1] and not shown[round(time / 5e8)][0]:
            wrong.append(time / 1e9)
    named = [each for each in log.events() if each.source == "agents.robot.decide"]
    return [each.name for each in named], wrong, [each.time / 1e9 for each in named if each.name == "assumption-broken"]


def check_lights(folder: Path, steps: int) -> None:
    names, wrong, broken = lights(folder, steps)
    assert not wrong
    assert names.count("goal-met") > steps / 15
    assert names.count("assumption-broken") >= 1
    assert (steps - 2) * 0.5 <= min(broken) <= (steps - 1) * 0.5  # while both are lit, and never before


def test_in_a_random_legal_environment_all_goals_are_met_and_an_illegal_step_is_reported(tmp_path: Path) -> None:
    check_lights(tmp_path, 600)


@pytest.mark.slow
def test_in_2000_steps_of_a_random_legal_environment_all_goals_are_met_again_and_again(tmp_path: Path) -> None:
    check_lights(tmp_path, 2000)


SCRIPT = """
import runpy, sys
from symaware_cli.knowledge.synthesis.strategy import synthesise
print(synthesise(runpy.run_path(sys.argv[1])["game"](10), [0]).digest)
"""


def test_strategies_do_not_depend_on_hash_seeds() -> None:
    found = set()
    for seed in ("1", "2", "3"):
        command = [sys.executable, "-c", SCRIPT, str(SCENARIOS.parent / "benchmarks" / "synthesis.py")]
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        found.add(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)
    assert [len(each.strip()) for each in found] == [64]


def test_random_legal_environments_never_lead_to_a_violation() -> None:
    game: Game = runpy.run_path(str(SCENARIOS.parent / "benchmarks" / "synthesis.py"))["game"](10)
    strategy = synthesise(game, [0])
    draw = np.random.default_rng(1)
    goals = game.goals(game.guarantees)
    fair = game.goals(game.assumptions)
    values, possible = game.starts([0])
    state, goal, met = int(game.starting(values)[np.flatnonzero(possible)[0]]), 0, [0, 0]
    following = game.vocabulary.cell.following
    for _ in range(10_000):
        cell, after = strategy.choice(state, goal)
        choice = following[game.values["cell"][state]].index(cell)
        answers = game.moves[choice][:, state]
        assert (answers != game.size + 1).all()
        legal = answers[answers < game.size]
        met = [number + bool(each[state]) for number, each in zip(met, goals, strict=True)]
        # A random environment is fair, as it meets each assumption again and again.
        state, goal = int(legal[draw.integers(len(legal))]), after
    assert min(met) > 100
    assert fair[0].any()


LOADED = {
    "agents.robot.knowledge": {"loaded": 0},
    "agents.robot.components.decide.with.knowledge": {"loaded": "loaded"},
}


def test_an_agent_knows_the_state_of_what_has_no_place_and_components_and_messages_read_it(tmp_path: Path) -> None:
    changes = {
        **LOADED,
        "topology": {"use": "complete"},
        "agents.robot.components.tell": {"use": "communication.flooding", "with": {"names": ["loaded"]}},
        "agents.customer.components.hear": {"use": "communication.flooding"},
        "agents.robot.components.steer.with.certified": False,
        "agents.robot.components.steer.condition": "knowledge.loaded > 0",
    }
    log = open_log(run("fetch.yaml", tmp_path / "a.mcap", {**changes, "agents.robot.components.steer.condition": None}))
    states = load(SCENARIOS / "fetch.yaml").knowledge_models()["carrier"].system.states
    plan = log.series("robot", "decide.plan")
    loaded = [int(states[int(cell)].endswith(",loaded")) for cell in plan.values[:, 0]]
    known = [(each.time, each.values["loaded"]) for each in log.knowledge("robot")]
    changed = [place for place in range(1, len(loaded)) if loaded[place] != loaded[place - 1]]
    assert known[0] == (0, 0)
    assert known[1:] == [(int(plan.times[place]), loaded[place]) for place in changed]
    assert len(known) >= 3
    # A condition that reads it: the robot stands from where it would have to pick something up.
    still = open_log(run("fetch.yaml", tmp_path / "b.mcap", changes)).series("robot", "state").values
    assert (still == still[0]).all()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"agents.robot.components.decide.with.knowledge": {"loaded": "loaded"}}, "robot does not know `loaded`"),
        ({**LOADED, "agents.robot.components.decide.with.knowledge": {"loaded": "lodaed"}}, "no cell has the label"),
    ],
)
def test_required_elements_of_the_state_must_exist(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        load(SCENARIOS / "fetch.yaml", changes)
