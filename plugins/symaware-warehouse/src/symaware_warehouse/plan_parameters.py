"""The parameters of plans, and the planners that are made from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydantic import Field

from symaware_cli import AgentGroup, Parameters, nanoseconds, seconds
from symaware_cli.planning.optimal_control import LinearDynamics
from symaware_warehouse.planner import Planner
from symaware_warehouse.tube import Tube, TubeKind


class PlanParameters(Parameters):
    """The specifications that a robot plans for, and the settings of plans."""

    specifications: list[str] = Field(
        min_length=1, description="The specifications to satisfy: those in force, and those that may be accepted."
    )
    horizon: float = Field(40.0, gt=0, description="End of the planning horizon [s].")
    tube: TubeKind = Field(
        "chebyshev", description="The bound of the risk of a radius: `chebyshev` for any error, or `gaussian`."
    )
    least_risk: float = Field(0.01, gt=0, lt=0.6, description="beta: the least risk of each step.")
    greatest_radius: float | None = Field(
        None,
        gt=0,
        description="The greatest radius of a tube [m], whatever its risk: then robots with more noise have a higher "
        "risk. If null, the radius of `least_risk`, which is wider for robots with more noise.",
    )
    chords: int = Field(
        1, ge=1, le=20, description="Number of chords that approximate the bound of the risk from above."
    )
    feedback: float = Field(
        0.6180339887498949, gt=0, lt=2, description="K: the error e of a plan becomes (1 - K) e + w in a step."
    )
    variance: float | None = Field(
        None,
        gt=0,
        description="Variance of w along each axis [m^2]; that of the model's noise if null. Robots that know a "
        "`variance` have that one.",
    )
    max_input: float | None = Field(
        None,
        gt=0,
        description="Greatest magnitude of each element of u [m]; that of the model if null. Robots that know a "
        "`max_input` have that one.",
    )
    energy: float = Field(0.001, ge=0, description="Cost of the square of each element of u [1/m^2].")
    tangents: int = Field(3, ge=3, le=101, description="Number of tangents that approximate these squares in a search.")
    gap: float = Field(0.05, ge=0, description="Greatest excess of the cost of a plan over the best one.")
    nodes: int = Field(5_000, ge=1, description="Limit of a search: the nodes of its tree.")
    bids: bool = Field(True, description="Whether to bid on offered specifications.")
    step: float | None = Field(
        None,
        gt=0,
        description="Duration of a step of the plan [s], for a robot with another model that `warehouse.track` "
        "moves along the plan; give the component the same `period`. By default a step of the world, and the first "
        "u of the plan is the control input.",
    )
    margin: float = Field(
        0.0,
        ge=0,
        description="Margin by which specifications hold beyond the tube [m]: for the body, and for deviations from "
        "the straight line between two steps.",
    )
    separation: float | None = Field(
        None,
        ge=0,
        description="Distance between its tube and those of robots of its group with a lower index [m], along x or "
        "along y, if they send it their plans: by `communication.broadcast` and `communication.inbox`. By "
        "default the robots do not avoid each other.",
    )
    notice: float = Field(
        0.0,
        ge=0,
        description="Time from a bid to its possible acceptance [s]. The bid assumes that the robot follows its "
        "present plan until then.",
    )

    def planner(self, group: AgentGroup, row: int, step: float, origin: int) -> Planner:
        """Return the planner of one robot of a group.

        Args:
            group: The group.
            row: The row of the robot.
            step: Duration of a step of the plan [s].
            origin: The step at which the robot begins.

        Raises:
            ValueError: The model is not x+ = x + u + w, or limits or noise are not known.
        """
        model = group.model
        unit = np.eye(2)
        if self.step is not None:
            free = np.full(2, np.inf)
            dynamics = LinearDynamics(unit, unit, np.zeros(2), -free, free, np.zeros((0, 2)), np.zeros(0))
        else:
            dynamics = LinearDynamics.of(model, step)
        if dynamics.A.shape != (2, 2) or dynamics.B.shape != (2, 2) or dynamics.c.any():
            raise ValueError("the model must be x+ = x + u + w in the plane")
        if not (np.array_equal(dynamics.A, unit) and np.array_equal(dynamics.B, unit)) or len(dynamics.normals):
            raise ValueError("the model must be x+ = x + u + w, with a limit of each element of u")
        max_input = group.knowledge[row].get("max_input", self.max_input)
        if max_input is not None:
            if not isinstance(max_input, int | float) or not max_input > 0:
                raise ValueError(f"the knowledge `max_input` of {group.ids[row]} must be a number above 0")
            least = np.maximum(dynamics.least, -max_input)
            greatest = np.minimum(dynamics.greatest, max_input)
            dynamics = replace(dynamics, least=least, greatest=greatest)
        if not np.isfinite([*dynamics.least, *dynamics.greatest]).all():
            raise ValueError("a plan needs a limit of u: `max_input`, or that of the model")
        variance = group.knowledge[row].get("variance", self.variance)
        if variance is not None and (not isinstance(variance, int | float) or not variance > 0):
            raise ValueError(f"the knowledge `variance` of {group.ids[row]} must be a number above 0")
        if variance is None:
            noise = None if self.step is not None else model.noise_covariance(step)
            if noise is None or not noise.any():
                raise ValueError("a tube needs noise: its `variance`, or that of the model")
            variance = float(np.linalg.eigvalsh(noise).max())
        alpha = variance / (1.0 - (1.0 - self.feedback) ** 2)
        tube = Tube.of(self.tube, alpha, self.least_risk, self.chords, self.greatest_radius)
        last = round(nanoseconds(self.horizon) / nanoseconds(step)) - origin
        return Planner(
            dynamics,
            tube,
            last,
            self.energy,
            self.tangents,
            self.gap,
            self.nodes,
            margin=self.margin,
            separation=self.separation or 0.0,
        )

    def every(self, time_step: int) -> int:
        """Return the number of steps of the world, in nanoseconds, in a step of the plan.

        Raises:
            ValueError: It is not a whole number.
        """
        step = time_step if self.step is None else nanoseconds(self.step)
        if step % time_step:
            raise ValueError(f"the `step` of {seconds(step):g} s is not a multiple of {seconds(time_step):g} s")
        return step // time_step
