import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import yaml
from checkout import CHECKOUT

from symaware_cli import KnowledgeModel, ScenarioError, load, open_log

SCENARIOS = CHECKOUT / "scenarios"
FETCH = SCENARIOS / "fetch.yaml"


def models_of(folder: Path, parts: Mapping[str, object]) -> Mapping[str, KnowledgeModel]:
    """The knowledge models of the scenario `fetch`, with others besides."""
    document = yaml.safe_load(FETCH.read_text())
    document["knowledge_models"] |= parts
    (folder / "gripper.dot").write_text((SCENARIOS / "gripper.dot").read_text())
    (folder / "lamp.yaml").write_text("transitions: {red: [green], green: [red]}\ninitial: [red]\n")
    (folder / "free.yaml").write_text("transitions: {lit: [dark], dark: [lit]}\n")
    (folder / "twice.yaml").write_text("transitions: {lit: [lit]}\nlabels: {lit: [lit]}\n")
    (folder / "fetch.yaml").write_text(yaml.safe_dump(document))
    return load(folder / "fetch.yaml").knowledge_models()


def states(file: str) -> dict[str, object]:
    return {"use": "abstraction.file", "with": {"graph": {"file": file}, "places": False}}


def product(*names: str) -> dict[str, object]:
    return {"use": "abstraction.product", "with": {"models": list(names)}}


def test_a_state_of_a_product_has_the_cell_of_one_part_and_the_labels_of_all() -> None:
    models = load(FETCH).knowledge_models()
    floor, gripper, carrier = (models[name] for name in ("floor", "gripper", "carrier"))
    assert carrier.system == floor.system.product(gripper.system)
    for state, name in enumerate(carrier.system.states):
        cell, held = name.split(",")
        place = floor.system.states.index(cell)
        assert np.array_equal(carrier.bounds[state], floor.bounds[place])
        assert carrier.system.labels_in(state) == floor.system.labels_in(place) | {held}


def test_an_agent_begins_in_the_initial_states_of_the_parts_without_cells() -> None:
    carrier = load(FETCH).knowledge_models()["carrier"]
    cells = carrier.cells(np.array([[0.5, 0.5], [5.5, 3.5], [2.5, 2.5], [9.0, 0.5]]))
    assert [carrier.system.states[cell] for cell in cells[:2]] == ["c0_0,empty", "c5_3,empty"]
    assert cells[2:].tolist() == [-1, -1]  # an obstacle, and outside


def test_products_of_products_are_made_whatever_the_order_in_the_file(tmp_path: Path) -> None:
    parts = {"all": product("tools", "floor"), "tools": product("gripper", "lamp"), "lamp": states("lamp.yaml")}
    models = models_of(tmp_path, parts)
    whole, floor = models["all"], models["floor"]
    assert len(whole.system.states) == 2 * 2 * len(floor.system.states)
    state = int(whole.cells(np.array([[0.5, 0.5]]))[0])
    assert whole.system.states[state] == "empty,red,c0_0"
    assert np.array_equal(whole.bounds[state], floor.bounds[0])
    after = {whole.system.states[each].split(",")[1] for each in whole.system.successors[state]}
    assert after == {"green"}


@pytest.mark.parametrize(
    ("parts", "place", "said"),
    [
        ({"bad": product("floor", "griper")}, "bad.with.models[1]", "there is no knowledge model `griper`"),
        ({"bad": product("floor", "bad")}, "bad.with.models[1]", "cannot be made from itself"),
        (
            {"bad": product("floor", "other"), "other": product("bad", "gripper"), "more": product("bad", "gripper")},
            "bad.with.models[1] other.with.models[0]",
            "made from it",
        ),
        ({"two": product("floor", "carrier")}, "two.with.models[1]", "both `floor` and `carrier` have cells"),
        ({"bad": product("floor", "floor")}, "bad.with.models", "once"),
        ({"bad": product("carrier", "gripper")}, "bad.with.models", "both have the label `empty`"),
        ({"free": states("free.yaml"), "bad": product("floor", "free")}, "free.with.graph", "one state"),
        ({"twice": states("twice.yaml")}, "twice.with.graph", "`lit` is a state"),
    ],
)
def test_an_invalid_product_is_refused_at_its_place(
    tmp_path: Path, parts: Mapping[str, object], place: str, said: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        models_of(tmp_path, parts)
    places = [f"knowledge_models.{each}" for each in place.split()]
    assert [each.path for each in caught.value.problems] == places
    assert all(said in each.message for each in caught.value.problems)


def test_a_product_of_too_many_transitions_is_refused(tmp_path: Path) -> None:
    named = [f"lamp{number}" for number in range(14)]
    for name in named:
        text = f"transitions: {{{name}a: [{name}a, {name}b], {name}b: [{name}a, {name}b]}}\ninitial: [{name}a]\n"
        (tmp_path / f"{name}.yaml").write_text(text)
    with pytest.raises(ScenarioError, match="268,435,456 transitions"):
        models_of(tmp_path, {**{name: states(f"{name}.yaml") for name in named}, "bad": product(*named)})


def test_strategies_and_controllers_need_cells() -> None:
    changed = {"agents.robot.components.decide.with.model": "gripper"}
    with pytest.raises(ScenarioError, match="the states of `gripper` have no places"):
        load(FETCH, changed)


def test_the_state_of_another_agent_in_a_product_cannot_be_told_from_where_it_is() -> None:
    with pytest.raises(ScenarioError, match="does not tell all of its state in a product"):
        load(FETCH, {"agents.robot.components.decide.with.labels.other": {"cell_of": "customer"}})


def test_the_robot_loads_at_the_store_only_and_unloads_at_the_hatch_while_it_is_served(tmp_path: Path) -> None:
    """Whatever the strategy writes, where the robot truly is at each change of its gripper is read from the world."""
    assert load(FETCH).run(output=tmp_path / "a.mcap").status == "finished"
    log = open_log(tmp_path / "a.mcap")
    names = load(FETCH).knowledge_models()["carrier"].system.states
    plan = log.series("robot", "decide.plan")
    robot, customer = (log.series(name, "state") for name in ("robot", "customer"))
    held = [names[int(cell)].split(",")[1] for cell in plan.values[:, 0]]
    changes = [(after, at) for at, (before, after) in enumerate(itertools.pairwise(held), 1) if before != after]
    assert [after for after, _ in changes] == ["loaded", "empty", "loaded"]
    for after, at in changes:
        decided, over = plan.times[at - 1], plan.times[at]
        places = robot.values[(robot.times >= decided) & (robot.times <= over), :2]
        low = np.array([0.0, 0.0] if after == "loaded" else [5.0, 3.0])
        assert ((low <= places) & (places <= low + 1.0)).all()
        if after == "empty":
            x, y = customer.values[customer.times == decided][0]
            assert 5.0 < x < 6.0
            assert 4.2 < y < 5.2
