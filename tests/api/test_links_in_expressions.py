"""Positions of links of robots in specifications, conditions, logs, and the independent evaluation of these."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from symaware_cli import ScenarioError, SimulationState, check_log, load
from symaware_cli.assets import AssetFolders, Mechanism
from symaware_cli.core import Entity, Model
from symaware_cli.engine.models.articulated import ArticulatedRobot
from symaware_cli.engine.models.wheeled import AckermannDrive, DifferentialDrive
from symaware_cli.evidence.link_here import link_here
from symaware_cli.evidence.log_evaluation import evaluate_log
from symaware_cli.geometry import Articulation, Link, rotated
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.planning.optimal_control.affine_predicate import Affine, predicate_sets
from symaware_cli.planning.risk.predicate_bounds import NotLinearError, predicate_bound
from symaware_cli.specification.columns import ARGUMENTS
from symaware_cli.specification.formulation import formulate
from symaware_cli.specification.parser import parse
from symaware_cli.specification.token import ExpressionError

pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")


def joint(name: str, kind: str, parent: str, child: str, place: str, axis: str, turned: str = "0 0 0") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}" rpy="{turned}"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" effort="9" velocity="2"/></joint>'
    )


def robot(names: str, *joints: str, shape: str = "") -> str:
    links = [f'<link name="{name}">{shape}</link>' for name in names.split()]
    return f'<robot name="robot">{"".join([*links, *joints])}</robot>'


#: An arm that turns and slides, with a finger that moves freely.
ARM = robot(
    "base upper fore gripper finger tip",
    joint("shoulder", "revolute", "base", "upper", "0 0.1 0.3", "0 1 0", "0.1 0 0.2"),
    joint("elbow", "prismatic", "upper", "fore", "0.4 0 0", "1 0 0"),
    joint("wrist", "fixed", "fore", "gripper", "0.3 0 0.05", "1 0 0"),
    joint("loose", "continuous", "gripper", "finger", "0.01 0 0", "0 0 1"),
    joint("end", "fixed", "finger", "tip", "0.02 0 0", "1 0 0"),
)
WHEEL = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
#: Two driven wheels behind, two steered ones ahead with a sensor beside each.
CAR = robot(
    "base rear_left rear_right left right lamp",
    joint("rear_left_joint", "continuous", "base", "rear_left", "-0.1 0.2 0.05", "0 1 0"),
    joint("rear_right_joint", "continuous", "base", "rear_right", "-0.1 -0.2 0.05", "0 1 0"),
    joint("left_hinge", "revolute", "base", "left", "0.4 0.2 0.05", "0 0 1"),
    joint("right_hinge", "revolute", "base", "right", "0.4 -0.2 0.05", "0 0 -1"),
    joint("arm", "fixed", "left", "lamp", "0.1 0 0", "1 0 0"),
    shape=WHEEL,
)
MODELS: dict[str, tuple[Model, str]] = {
    "fixed": (ArticulatedRobot(ArticulatedRobot.Parameters(joints=("elbow", "shoulder"))), ARM),
    "free": (ArticulatedRobot(ArticulatedRobot.Parameters(joints=("shoulder", "elbow"), base="free")), ARM),
    "differential": (
        DifferentialDrive(DifferentialDrive.Parameters(left=("rear_left_joint",), right=("rear_right_joint",))),
        CAR,
    ),
    "car": (
        AckermannDrive(
            AckermannDrive.Parameters(
                driven=("rear_left_joint", "rear_right_joint"), steered=("left_hinge", "right_hinge")
            )
        ),
        CAR,
    ),
}


def fitted(name: str, folder: Path) -> Model:
    model, text = MODELS[name]
    (folder / "robot.urdf").write_text(text)
    model.fit(Entity(shape={"urdf": {"file": "robot.urdf", "radius": 0.5}}), AssetFolders(folder), "agents", "robot")
    return model


def drawn(model: Model) -> NDArray[np.float64]:
    return np.random.default_rng(1).uniform(-1.0, 1.0, (7, len(model.state)))


def all_joints(tree: Articulation, mechanism: Mechanism, known: NDArray[np.float64]) -> NDArray[np.float64]:
    """The positions of all joints of a tree, of which those that are not known are 0."""
    columns = {name: known[:, column] for column, name in enumerate(mechanism.joints)}
    return np.stack([columns.get(name, np.zeros(len(known))) for name in tree.joints], axis=1)


# -- kinematics


@pytest.mark.parametrize("name", MODELS)
def test_the_independent_evaluation_finds_a_link_where_the_model_has_it_to_the_bit(name: str, tmp_path: Path) -> None:
    model = fitted(name, tmp_path)
    assert model.links is not None
    states, mechanism = drawn(model), model.mechanism()
    for link in model.links.names:
        found = model.links.positions(states, link)
        assert found.shape == (7, len(model.position))
        places = mechanism.placed(states)
        inner, _ = model.links.tree.frames(all_joints(model.links.tree, mechanism, places.joints))
        number = [each.name for each in model.links.tree.links].index(link)
        outer = places.positions + rotated(places.orientations, inner[:, number])
        assert np.array_equal(found, outer[:, : found.shape[1]])
        for row, state in enumerate(states):
            posture = mechanism.posture(state)
            joints = dict(zip(mechanism.joints, posture.joints, strict=True))
            own = link_here(model.links.tree, link, joints, posture.position, posture.orientation)
            assert found[row].tolist() == own[: found.shape[1]]
            assert np.array_equal(model.links.positions(states[row : row + 1], link), found[row : row + 1])


@pytest.mark.parametrize("name", MODELS)
def test_robots_are_placed_at_once_as_one_after_the_other(name: str, tmp_path: Path) -> None:
    model = fitted(name, tmp_path)
    mechanism, states = model.mechanism(), drawn(model)
    for found, expected in zip(mechanism.placed(states), Mechanism.placed(mechanism, states), strict=True):
        assert np.array_equal(found, expected)


def test_links_of_an_arm_are_where_trigonometry_says(tmp_path: Path) -> None:
    model = fitted("fixed", tmp_path)
    assert model.links is not None
    heading, elbow, shoulder = 0.3, 0.1, 0.2
    state = np.array([[2.0, 3.0, 0.5, heading, elbow, shoulder, 0.0, 0.0]])

    def turn(axis: int, angle: float) -> NDArray[np.float64]:
        matrix = np.eye(3)
        one, other = (axis + 1) % 3, (axis + 2) % 3
        matrix[one, one] = matrix[other, other] = np.cos(angle)
        matrix[other, one], matrix[one, other] = np.sin(angle), -np.sin(angle)
        return matrix

    base, upper = turn(2, heading), turn(2, 0.2) @ turn(0, 0.1) @ turn(1, shoulder)
    gripper = [2.0, 3.0, 0.5] + base @ ([0.0, 0.1, 0.3] + upper @ [0.7 + elbow, 0.0, 0.05])
    assert model.links.positions(state, "gripper")[0] == pytest.approx(gripper, abs=1e-12)


def test_a_lamp_on_a_steered_wheel_moves_with_it(tmp_path: Path) -> None:
    model = fitted("car", tmp_path)
    assert model.links is not None
    straight, turned = (model.links.positions(np.array([[0, 0, 0, 0, angle]]), "lamp")[0] for angle in (0.0, 0.3))
    left = np.arctan(0.5 * np.tan(0.3) / (0.5 - 0.2 * np.tan(0.3)))
    assert straight == pytest.approx([0.6, 0.2], abs=1e-12), "the position of a car is the middle of its rear axle"
    assert turned == pytest.approx([0.5 + 0.1 * np.cos(left), 0.2 + 0.1 * np.sin(left)], abs=1e-12)


def test_a_link_is_unknown_behind_a_joint_that_the_state_does_not_have(tmp_path: Path) -> None:
    arm, car = fitted("fixed", tmp_path).links, fitted("car", tmp_path).links
    assert arm is not None
    assert car is not None
    assert arm.names == ("base", "upper", "fore", "gripper", "finger")
    assert list(arm.unknown) == ["tip"]
    assert car.names == ("base", "rear_left", "rear_right", "left", "right", "lamp"), "a wheel turns about its origin"


def test_a_chain_with_several_branches_has_its_own_joints() -> None:
    first = Link(name="a", parent=0, joint="one", motion="slide", axis=(1.0, 0.0, 0.0))
    tree = Articulation(
        name="t", links=(Link(name="base"), first, first.model_copy(update={"name": "b", "joint": "two"}))
    )
    assert link_here(tree, "b", {"one": 9.0, "two": 0.5}, [0, 0, 0], [0, 0, 0, 1]) == [0.5, 0.0, 0.0]


# -- expressions

SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "arms",
    "run": {"duration": 0.6},
    "environment": {
        "use": "kinematic",
        "with": {"time_step": 0.05},
        "entities": {"post": {"shape": {"circle": {"radius": 0.1}}, "position": [9.0, 9.0]}},
    },
    "regions": {"shelf": {"circle": {"centre": [0.6, 0.1, 0.3], "radius": 0.3}}},
    "agents": {
        "arm": {
            "count": 2,
            "model": {"use": "articulated", "with": {"joints": ["elbow", "shoulder"]}},
            "entity": {"shape": {"urdf": {"file": "robot.urdf", "radius": 0.5}}},
            "knowledge": {"target": [0.5, 0.0, 0.5]},
            "state": {"each": [[0, 0, 0, 0.3, 0.1, 0.2, 0, 0], [1, 0, 0.2, -0.5, 0, 0.5, 0.1, 0.1]]},
            "components": {
                "see": {"use": "perception.self"},
                "go": {
                    "use": "control.schedule",
                    "with": {"inputs": [{"time": 0, "input": [0.2, -0.7]}, {"time": 0.3, "input": [0.1, 0.4]}]},
                },
            },
        },
        "cart": {"model": {"use": "single-integrator"}, "state": [5.0, 5.0]},
    },
}
SPECIFICATIONS: dict[str, dict[str, Any]] = {
    "each": {"each": "arm", "formula": "always (norm(link.gripper - target) > 0.05 and link.finger[2] < 2)"},
    "believed": {"each": "arm", "of": "belief", "formula": 'always norm(link["gripper"] - position) < 2'},
    "world": {
        "formula": 'always not inside(link["arm.0"].gripper, shelf) or '
        'eventually distance(link["arm.0"].gripper, link["arm.1"].fore) > 0.1'
    },
    "pairs": {
        "pairs": "arm",
        "formula": 'always distance(link["first"].gripper, link["second"].fore) > 0.1 and link["second"].base[2] > 0.1',
    },
    "uneven": {"pairs": [["cart", "arm"]], "formula": 'always distance(link["second"].gripper, position["first"]) > 1'},
    "group": {"formula": 'always all(link["arm"].gripper < 3)'},
}


def written(folder: Path, **changes: Any) -> Path:
    (folder / "robot.urdf").write_text(ARM)
    path = folder / "arms.yaml"
    path.write_text(yaml.safe_dump({**SCENARIO, **changes}, sort_keys=False))
    return path


def test_a_run_its_log_alone_and_the_independent_evaluation_agree(tmp_path: Path) -> None:
    path, log = written(tmp_path, specifications=SPECIFICATIONS), tmp_path / "log.mcap"
    summary = execute(build(path), log)
    for each in tmp_path.iterdir():
        if each != log:
            each.unlink()
    assert [each.to_json() for each in check_log(log).specifications] == [
        each.to_json() for each in summary.specifications
    ]
    evaluated = evaluate_log(log)
    assert not evaluated.left_out
    assert [(each.name, each.verdict, each.robustness) for each in evaluated.specifications] == [
        (each.name, each.verdict, each.robustness) for each in summary.specifications
    ]
    new = {"reaches": {"each": "arm", "formula": "eventually inside(link.fore, shelf)"}}
    assert [each.verdict for each in check_log(log, new).specifications] == ["violated"]


def test_the_robustness_is_that_of_the_positions_in_the_log(tmp_path: Path) -> None:
    stated = {"low": {"each": "arm", "formula": "always link.gripper[2] < 1"}}
    model, heights = fitted("fixed", tmp_path), []
    assert model.links is not None
    with load(written(tmp_path, specifications=stated)).start() as simulation:
        heights.append(model.links.positions(simulation.state("arm"), "gripper")[:, 2].max())
        while not simulation.done:
            simulation.step()
            heights.append(model.links.positions(simulation.state("arm"), "gripper")[:, 2].max())
        assert simulation.finish().summary.specifications[0].robustness == 1.0 - max(heights)


def test_a_run_ends_where_a_link_arrives_and_components_work_on_where_it_is_believed(tmp_path: Path) -> None:
    agents = yaml.safe_load(yaml.safe_dump(SCENARIO["agents"]))
    agents["arm"]["components"]["go"]["condition"] = "link.gripper[0] < 5"
    until = 'link["arm.0"]["gripper"][2] > 0.3'
    summary = execute(build(written(tmp_path, run={"duration": 1.0, "until": until}, agents=agents)), None)
    assert 0.0 < summary.simulated_time < 1.0


@pytest.mark.parametrize(
    ("text", "said", "nearest"),
    [
        ('link["griper"][0] > 1', "there is no link `griper`", "gripper"),
        (
            "link.tip[0] > 1",
            "the state does not say where the link `tip` is: it has no position of the joint `loose`",
            None,
        ),
        ("link > 1", 'say which: link["base"]', None),
        ("link[0] > 1", "`link` takes a name in quotes", None),
        ("link.gripper > x + 1 and link.gripper[0] / 1 > speed", "this compares m with m/s", None),
    ],
)
def test_an_unknown_link_is_reported_where_it_stands(tmp_path: Path, text: str, said: str, nearest: str | None) -> None:
    stated = {"here": {"each": "arm", "formula": f"always ({text})"}}
    with pytest.raises(ScenarioError) as caught:
        load(written(tmp_path, specifications=stated))
    (problem,) = caught.value.problems
    assert said in problem.message
    assert problem.suggestion == nearest


@pytest.mark.parametrize(
    ("text", "said", "nearest"),
    [
        ('link["arm.0"].griper[0] > 1', "there is no link `griper`", "gripper"),
        ('link["amr"].gripper[0] > 1', "there is no agent or group with links `amr`", "arm"),
        ('link["arm.0"][0] > 1', '`link["arm.0"]` takes a name in quotes: link["arm.0"]["base"]', None),
        ('norm(link["arm.0"]) > 1', 'say which: link["arm.0"]["base"]', None),
        ("norm(link) > 1", 'say whose: link["arm.0"]["base"]', None),
        ('link["cart"].gripper[0] > 1', "`cart` has no links: its model drives no joints", None),
        ('link["post"].gripper[0] > 1', "`post` has no joints with motors", None),
    ],
)
@pytest.mark.parametrize("place", ["until", "specification"])
def test_an_unknown_link_of_an_agent_is_reported_where_it_stands(
    tmp_path: Path, place: str, text: str, said: str, nearest: str | None
) -> None:
    if place == "until":
        path = written(tmp_path, run={"duration": 1.0, "until": text})
    else:
        path = written(tmp_path, specifications={"there": {"formula": f"always ({text})"}})
    with pytest.raises(ScenarioError) as caught:
        load(path)
    (problem,) = caught.value.problems
    assert said in problem.message
    assert problem.suggestion == nearest


@pytest.mark.parametrize(
    ("pairs", "text", "said", "nearest"),
    [
        ("arm", 'link["first"].griper[0] > 1', "there is no link `griper`", "gripper"),
        ("arm", 'link["third"].gripper[0] > 1', "there is no agent of the pair `third`", None),
        ("arm", 'link["first"].tip[0] > 1', "the state does not say where the link `tip` is", None),
        ([["arm", "cart"]], 'link["second"].base[0] > 1', "not all of the second agents have links", None),
        ([["cart", "cart2"]], 'link["second"].base[0] > 1', "there are no links here", None),
    ],
)
def test_an_unknown_link_of_a_pair_is_reported_where_it_stands(
    tmp_path: Path, pairs: Any, text: str, said: str, nearest: str | None
) -> None:
    stated = {"there": {"pairs": pairs, "formula": f"always ({text})"}}
    agents = {**SCENARIO["agents"], "cart2": SCENARIO["agents"]["cart"] | {"state": [7.0, 7.0]}}
    with pytest.raises(ScenarioError) as caught:
        load(written(tmp_path, specifications=stated, agents=agents))
    (problem,) = caught.value.problems
    assert said in problem.message
    assert problem.suggestion == nearest


@pytest.mark.parametrize("text", ['link["gripper"][0] > 1', "link.gripper[0] > 1", 'norm(link("gripper")) > 1'])
def test_agents_without_a_robot_have_no_links(tmp_path: Path, text: str) -> None:
    stated = {"here": {"each": "cart", "formula": f"always ({text})"}}
    with pytest.raises(ScenarioError, match="there are no links here: `link` is of robots from files"):
        load(written(tmp_path, specifications=stated))


def test_what_else_is_called_link_keeps_its_name(tmp_path: Path) -> None:
    stated = {"shown": {"each": "arm", "formula": "always inside(position, link)"}}
    regions = {**SCENARIO["regions"], "link": {"box": [-9, 9, -9, 9]}}
    summary = execute(build(written(tmp_path, specifications=stated, regions=regions)), None)
    assert summary.specifications[0].verdict == "satisfied"


def test_a_run_that_watches_a_link_goes_on_from_its_state(tmp_path: Path) -> None:
    until = 'link["arm.0"].gripper[2] > 9'
    agents = yaml.safe_load(yaml.safe_dump(SCENARIO["agents"]))
    agents["arm"]["components"]["go"]["condition"] = "link.gripper[0] < 5"
    run = {"duration": 0.6, "until": until}
    scenario = load(written(tmp_path, specifications=SPECIFICATIONS, run=run, agents=agents))
    with scenario.start() as simulation:
        simulation.step(5)
        state = SimulationState.from_bytes(simulation.capture().to_bytes())
        first = simulation.finish().summary.specifications
    with scenario.start() as simulation:
        simulation.restore(state)
        assert simulation.finish().summary.specifications == first


def test_planners_that_need_what_is_linear_refuse_links() -> None:
    tree = parse('link["gripper"][0] > 1', {"link": None, "position": None}, ARGUMENTS)
    with pytest.raises(NotLinearError):
        predicate_bound(tree, {"position"}, {})
    with pytest.raises(ExpressionError):
        predicate_sets(formulate(tree, 10**9), {"position": Affine(np.eye(2))}, {})
