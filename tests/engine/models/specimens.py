"""One of every model that ships with SymAware, in every number of dimensions."""

import numpy as np
from numpy.typing import NDArray
from simulating import made

from symaware_cli import Model
from symaware_cli.engine.models.aircraft import DubinsAircraft
from symaware_cli.engine.models.articulated import ArticulatedRobot
from symaware_cli.engine.models.bicycle import Bicycle
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.linear import Linear
from symaware_cli.engine.models.quadrotor import Quadrotor
from symaware_cli.engine.models.racecar import Racecar
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.models.wheeled import AckermannDrive, DifferentialDrive

#: x+ = x + u + w, the robots of the warehouse in /docs/models.md.
WALK = {
    "time_step": 1.0,
    "state": {"x": "m", "y": "m"},
    "control_input": {"step_x": "m", "step_y": "m"},
    "A": [[1.0, 0.0], [0.0, 1.0]],
    "B": [[1.0, 0.0], [0.0, 1.0]],
    "W": [[0.01, 0.0], [0.0, 0.01]],
    "max_input": 7.0,
}
#: Nothing about it is simple: every entry counts, and the noise of one element comes with that of another.
COUPLED = {
    "time_step": 0.25,
    "state": {"speed": "m/s", "x": "m", "load": "kg", "y": "m"},
    "control_input": {"push": "N", "pull": "N", "tilt": "rad"},
    "A": [[0.9, 0.1, -0.2, 0.3], [0.25, 1.0, 0.0, 0.7], [0.1, 0.2, 0.3, 0.4], [-0.7, 0.3, 0.11, 0.83]],
    "B": [[0.1, 0.2, 0.3], [0.7, -0.3, 0.9], [1.1, 0.0, -0.6], [0.31, 0.17, 0.13]],
    "W": [[0.5, 0.2, 0.0, 0.1], [0.2, 0.4, 0.1, 0.0], [0.0, 0.1, 0.3, 0.05], [0.1, 0.0, 0.05, 0.2]],
    "position": [1, 3],
    "max_input": [1.0, 2.0, 0.5],
}

SPECIMENS = {
    "single-integrator": made(SingleIntegrator, max_speed=1.3),
    "single-integrator 3": made(SingleIntegrator, max_speed=1.3, dimensions=3),
    "double-integrator": made(DoubleIntegrator, max_acceleration=2.0, max_speed=1.3),
    "double-integrator 3": made(DoubleIntegrator, max_acceleration=2.0, max_speed=1.3, dimensions=3),
    "unicycle": made(Unicycle, max_speed=1.3, min_speed=-0.4),
    "bicycle": made(Bicycle, max_speed=1.3, min_speed=-0.4),
    "dubins-aircraft": made(DubinsAircraft, min_speed=6.0, max_speed=9.0, max_turn_rate=0.1),
    "dubins-aircraft 3": made(
        DubinsAircraft, min_speed=6.0, max_speed=9.0, max_turn_rate=0.1, max_climb_rate=2.0, dimensions=3
    ),
    "linear": made(Linear, **WALK),
    "linear, coupled": made(Linear, **COUPLED),
}

#: Those that have no closed form, whose velocity is part of their state, and that are told what turns their wheels or
#: rotors.
VEHICLES = {
    "racecar": made(Racecar, max_speed=1.3, min_speed=-0.4),
    "quadrotor": made(Quadrotor),
    "differential-drive": made(DifferentialDrive, left=("left",), right=("right",)),
    "ackermann-drive": made(AckermannDrive, driven=("left", "right"), steered=("port", "starboard")),
    "articulated": made(ArticulatedRobot, joints=("shoulder", "elbow")),
    "articulated, by positions": made(ArticulatedRobot, joints=("shoulder", "elbow"), drive="position"),
}


def step_of(model: Model) -> float:
    """A step that the model can take [s]."""
    return model.time_step or 0.05


def numbers(random: np.random.Generator, count: int, width: int) -> NDArray[np.float64]:
    """Numbers of many magnitudes, with zeros among them."""
    scale = random.choice([0.0, 1e-12, 0.1, 1.0, 10.0, 1e3], size=(count, width))
    result: NDArray[np.float64] = random.normal(size=(count, width)) * scale
    return result


def states_and_inputs(model: Model, count: int, seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ordinary states, and control inputs within the limits."""
    random = np.random.default_rng(seed)
    state = random.normal(size=(count, len(model.state))) * 3.0
    return state, model.limit(random.normal(size=(count, len(model.control_input))) * 2.0)
