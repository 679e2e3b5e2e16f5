"""A prediction is what happens: the same motion for symbols, for arrays and in the world."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import untyped

from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.world.integration import Integrator

casadi = pytest.importorskip("casadi", reason="CasADi is an extra")

from simulating import Team, execute, simulation  # noqa: E402

from symaware_cli import Controller, Model, Quantity, TimeSeries  # noqa: E402
from symaware_cli.engine.environments.kinematic import KinematicEnvironment  # noqa: E402
from symaware_cli.engine.models.aircraft import DubinsAircraft  # noqa: E402
from symaware_cli.engine.models.bicycle import Bicycle  # noqa: E402
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator  # noqa: E402
from symaware_cli.engine.models.linear import Linear  # noqa: E402
from symaware_cli.engine.models.unicycle import Unicycle  # noqa: E402
from symaware_cli.planning.optimal_control import Dynamics, OptimalControlProblem, Solver  # noqa: E402


class Pendulum(Model):
    """A cart that swings, without a closed form."""

    state = (Quantity("x", "m"), Quantity("y", "m"), Quantity("rate", "m/s"))
    control_input = (Quantity("push", "m/s^2"),)

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        return (state[2], 0.1 * math.cos(state[0]), control_input[0] - 9.81 * math.sin(state[0]))


LINEAR = Linear(
    Linear.Parameters(
        time_step=0.05,
        state={"x": "m", "y": "m"},
        control_input={"push": "m"},
        A=[[1.0, 0.1], [-0.2, 0.9]],
        B=[[0.0], [1.0]],
    )
)
MODELS = {
    "single": SingleIntegrator(),
    "double in space": DoubleIntegrator(DoubleIntegrator.Parameters(dimensions=3)),
    "unicycle": Unicycle(),
    "bicycle": Bicycle(),
    "aircraft": DubinsAircraft(DubinsAircraft.Parameters(min_speed=1.0, max_speed=2.0, max_turn_rate=1.0)),
    "pendulum": Pendulum(),
    "linear": LINEAR,
}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
every_integrator = pytest.mark.parametrize("integrator", ["exact", "rk4", "euler"])


def some(model: NoisyModel, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    random = np.random.default_rng(3)
    return random.normal(size=(count, len(model.state))), random.normal(size=(count, len(model.control_input)))


@every_integrator
@every_model
def test_symbols_move_as_arrays_do(model: NoisyModel, integrator: Integrator) -> None:
    dynamics = Dynamics(model, 0.2, integrator, substeps=4)
    x, u = casadi.SX.sym("x", len(model.state)), casadi.SX.sym("u", len(model.control_input))
    compiled = casadi.Function("step", [x, u], [dynamics.symbolic(x, u)])
    state, control_input = some(model, 10)
    symbolic = np.array([np.array(compiled(*each)).ravel() for each in zip(state, control_input, strict=True)])
    assert np.allclose(symbolic, dynamics(state, control_input), rtol=1e-12, atol=1e-12)


class Replay(Controller):
    """Requests control inputs from a list, one at each step."""

    def __init__(self, inputs: NDArray[np.float64]) -> None:
        self._inputs = list(inputs)

    def _compute(self) -> tuple[NDArray[np.float64], TimeSeries]:
        return self._inputs.pop(0), TimeSeries()


@every_integrator
@every_model
def test_an_open_loop_plan_is_what_the_kinematic_world_does(model: NoisyModel, integrator: Integrator) -> None:
    # The plan holds each input for two steps of the world, which halves its own step once more where it integrates.
    problem = OptimalControlProblem(
        model, steps=5, time_step=0.1, integrator=integrator, substeps=2 if model.time_step else 4
    )
    x, u = problem.state, problem.control_input
    problem.add_cost(casadi.sumsqr(x[:2] - 0.3) + 0.1 * casadi.sumsqr(u))
    problem.bound_input(-0.9, 0.9 if len(model.control_input) == 1 else np.inf)
    start, _ = some(model, 1)
    solution = Solver(problem, tolerance=1e-9).solve(start[0])
    assert solution.solved
    plan = solution.plan
    parameters = KinematicEnvironment.Parameters(time_step=0.05, integrator=integrator, substeps=2)
    inputs = np.repeat(plan.inputs, 2, axis=0)
    team = Team({"steer": lambda: Replay(inputs)}, model=model, state=start.tolist())
    ready = simulation({"agent": team}, environment=KinematicEnvironment(parameters))
    execute(ready, 10)
    assert np.allclose(ready.environment.state(ready.groups[0])[0], plan.states[-1], atol=1e-7)


def test_a_rollout_goes_step_by_step() -> None:
    dynamics = Dynamics(SingleIntegrator(), 0.5)
    assert dynamics.rollout([1.0, 2.0], [[1.0, 0.0], [0.0, -2.0]]).tolist() == [[1, 2], [1.5, 2], [1.5, 1]]


@pytest.mark.parametrize(("step", "substeps"), [(0.0, 1), (-1.0, 1), (np.nan, 1), (0.1, 0)])
def test_there_is_no_empty_step(step: float, substeps: int) -> None:
    with pytest.raises(ValueError, match="invalid step"):
        Dynamics(Unicycle(), step, substeps=substeps)


def test_an_unknown_integrator_is_refused() -> None:
    with pytest.raises(ValueError, match="one of exact, rk4, euler, not verlet"):
        Dynamics(Unicycle(), 0.1, untyped("verlet"))
