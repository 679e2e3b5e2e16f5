"""Models: dynamics that define how a state changes under a control input."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import compiled
from symaware_cli.world.entity import Entity
from symaware_cli.world.plugin import Plugin
from symaware_cli.world.quantity import Quantity
from symaware_cli.world.step_simulator import StepSimulator

Array = NDArray[np.float64]


def columns(rows: Array) -> Array:
    """Turn rows of agents into the elements for `Model.derivative`; (n, k) to (k, n).

    Each element is contiguous: some NumPy functions return other last bits for arrays that are not, or that run
    backwards, and results must not depend on the memory layout. It is always a copy, because NumPy calls a single row
    contiguous even if it runs backwards.
    """
    return rows.T.copy()


def rows(elements: Sequence[Any], count: int) -> Array:
    """Turn the elements that `Model.derivative` returns into rows of agents, (k, n) to (n, k)."""
    joined = np.empty((count, len(elements)))
    for column, element in enumerate(elements):
        joined[:, column] = element
    return joined


@compiled
def saturated(control_input: Array, low: Array, high: Array) -> Array:
    """Return control inputs within the lowest and the highest ones; (n, nu) each."""
    limited: Array = np.minimum(np.maximum(control_input, low), high)
    return limited


class BodyLinks(Protocol):
    """The positions of the links of robots, as far as they follow from states; `Model.links`."""

    @property
    def names(self) -> Sequence[str]:
        """The links whose positions follow from a state."""

    @property
    def unknown(self) -> Mapping[str, str]:
        """The other links, each with the reason."""

    @property
    def tree(self) -> Any:
        """All links and joints: a `symaware_cli.geometry.Articulation`."""

    def positions(self, state: Array, link: str) -> Array:
        """Return the positions of the origin of a link's frame [m], for states (n, nx).

        They have as many coordinates as `Model.positions`; shape (n, d).
        """


class Model(Plugin, ABC):
    """The dynamics x' = f(x, u), written once for arrays and symbols.

    One model serves all agents of a group: it holds parameters, never a state.

    A model must define `derivative`. If its motion under a constant input has a closed form, it also defines
    `successor`, for arrays and symbols as well.

    A model in discrete time, x+ = g(x, u), declares the duration of its step as `time_step`. Then `successor` is the
    model, for that step only, and `derivative` is the mean rate over it, (g(x, u) - x) / time_step, which must not be
    integrated other than by one Euler step.

    Attributes:
        batchable: Whether each row that it computes depends on no other row, so that many runs may share the arrays.
        state: Name and unit of each element of x.
        control_input: Name and unit of each element of u.
        position: The indices of the position [m] in x.
        heading: The index of the heading [rad] in x; None for models without one.
        goes_ahead: Whether its velocity, seen from above, always points along its heading.
        velocities: The indices of the velocity of the position [m/s] in x, one for each of `position`; empty for models
            whose state does not contain the velocity.
        angles: The indices of angles in x that may be wrapped for display or comparison.
        time_step: The step of a model in discrete time [s]; None for models in continuous time.
        body: The body that belongs to the model; None if the scenario defines the body. With it, a shape in the
            scenario is only the outline that others avoid.
        needs_vehicle: The parameters that have an effect only in worlds that move bodies by `vehicle`.
        needs: The optional features without which a world cannot move it, as `Environment.provides` names them.
        links: The positions of the links of the body, available after `fit`; None for models that drive no joints.
    """

    batchable: ClassVar[bool] = False
    state: tuple[Quantity, ...] = ()
    control_input: tuple[Quantity, ...] = ()
    position: tuple[int, ...] = (0, 1)
    heading: int | None = None
    goes_ahead: ClassVar[bool] = False
    velocities: tuple[int, ...] = ()
    angles: tuple[int, ...] = ()
    time_step: float | None = None
    body: ClassVar[Entity | None] = None
    needs_vehicle: ClassVar[Sequence[str]] = ()
    needs: Sequence[str] = ()
    links: BodyLinks | None = None

    @abstractmethod
    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return the time derivative of the state.

        Args:
            state: The elements of x along the first axis: an array (nx, n), or a column of symbols.
            control_input: The elements of u likewise, (nu, n).
            math: The module of ``cos``, ``sin`` and similar: ``numpy``, or ``casadi`` for symbols.

        Returns:
            One expression for each element of x, in units per second.
        """

    def successor(self, state: Any, control_input: Any, step: Any, math: Any) -> Sequence[Any] | None:
        """Return the state after a step under a constant control input, in closed form.

        Args:
            state: The elements of x along the first axis, as for `derivative`.
            control_input: The elements of u likewise.
            step: Duration [s]; a number, or a symbol.
            math: ``numpy`` or ``casadi``.

        Returns:
            One expression for each element of x; None for models that must be integrated.

        Raises:
            ValueError: The model is in discrete time, and this is not its step.
        """
        return None

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the lowest and the highest control input, each of length nu; infinite without a limit."""
        count = len(self.control_input)
        return [-np.inf] * count, [np.inf] * count

    def limit(self, control_input: Array) -> Array:
        """Saturate requested control inputs; shape (n, nu) in and out."""
        bounds: tuple[Array, Array] | None = self.__dict__.get("_bounds")
        if bounds is None or bounds[0].shape != control_input.shape:
            # Equal shapes, as NumPy compares rows of two with a single row of two sixteen times slower.
            low, high = (np.broadcast_to(np.array(bound, float), control_input.shape) for bound in self.input_bounds())
            bounds = self.__dict__["_bounds"] = low.copy(), high.copy()
            self.__dict__["_unbounded"] = bool(np.isneginf(low).all() and np.isposinf(high).all())
        if self.__dict__["_unbounded"]:
            return control_input
        return saturated(control_input, *bounds)

    def positions(self, state: Array) -> Array:
        """Return the positions [m] in states; (n, nx) to (n, d)."""
        attributes = self.__dict__
        if "_position_columns" not in attributes:
            first, last = self.position[0], self.position[-1] + 1
            chosen = slice(first, last) if self.position == tuple(range(first, last)) else list(self.position)
            attributes["_position_columns"] = None if chosen == slice(0, len(self.state)) else chosen
        chosen = attributes["_position_columns"]
        return state if chosen is None else state[:, chosen]

    def velocity(self, state: Array, control_input: Array) -> Array:
        """Return the velocity of the position [m/s], shape (n, d), for states (n, nx) and control inputs (n, nu)."""
        rates = self.derivative(columns(state), columns(control_input), np)
        return rows([rates[index] for index in self.position], len(state))

    def turn_rate(self, state: Array, control_input: Array) -> Array:
        """Return the rate of the heading [rad/s], shape (n,), for states (n, nx) and control inputs (n, nu).

        0 for models without a heading.
        """
        turn_rate = np.zeros(len(state))
        if self.heading is not None:
            turn_rate[:] = self.derivative(columns(state), columns(control_input), np)[self.heading]
        return turn_rate

    def exact_step(self, state: Array, control_input: Array, step: float) -> Array | None:
        """Advance states by `successor`, if the model defines it.

        Args:
            state: The states; shape (n, nx).
            control_input: The control inputs, constant over the step; shape (n, nu).
            step: Duration [s].

        Returns:
            The states after the step, shape (n, nx); None for models that must be integrated.
        """
        after = self.successor(columns(state), columns(control_input), step, np)
        return None if after is None else rows(after, len(state))

    def vehicle(self) -> Any:
        """Return the `symaware_cli.Vehicle` that moves the bodies of a group in worlds that provide ``vehicles``.

        None if the world's own actuators move its bodies.
        """
        return None

    def mechanism(self) -> Any:
        """Return how joints move its body in worlds that provide ``mechanisms``: a `symaware_cli.assets.Mechanism`.

        None for models whose body has no joints with motors.
        """
        return None

    def simulator(self, time_step: int) -> StepSimulator | None:
        """Return the simulator that moves a group, instead of `derivative`, in worlds that provide ``co-simulation``.

        None for models of equations.

        Args:
            time_step: That of the world [ns].
        """
        return None

    def attachments(self) -> Mapping[str, bytes]:
        """Return files that the model adds to the log of a run, such as facts about a program that it runs.

        Returns:
            The content of each file by its name, the same whenever the scenario is run; empty by default.
        """
        return {}

    def fit(self, entity: Entity, folders: Any, *where: str) -> None:
        """Receive the body of the agents, before anything else is asked of the model.

        Args:
            entity: The body in the scenario.
            folders: The folders to which its files are relative, `symaware_cli.assets.AssetFolders`.
            where: The path of the group in the scenario.

        Raises:
            WorldError: The model does not suit the body; `path` is the place of the problem.
        """

    def embodied(self, entity: Entity) -> Entity:
        """Return the body of an agent, given the one in the scenario."""
        if self.body is None:
            return entity
        return self.body.model_copy(update={"shape": entity.shape}) if entity.shape else self.body

    def noise_deviation(self, step: float) -> Array | None:
        """Return the standard deviation of the process noise of each element of x over a step [s].

        Returns:
            Shape (nx,), or None for models without noise.
        """
        return None

    def noise_covariance(self, step: float) -> Array | None:
        """Return the covariance of the process noise over a step [s].

        Returns:
            Shape (nx, nx), by default diagonal; None for models without noise.
        """
        deviation = self.noise_deviation(step)
        return None if deviation is None else np.diag(deviation * deviation)

    def jacobian(self, state: Array, control_input: Array) -> Array:
        """Return the derivative of f(x, u) by x, shape (n, nx, nx), at states (n, nx) and inputs (n, nu).

        By default by central differences.
        """
        width = 1e-6
        point, held = columns(state), columns(control_input)
        jacobian = np.empty((len(state), len(self.state), len(self.state)))
        for column in range(len(self.state)):
            ahead, behind = point.copy(), point.copy()
            ahead[column] += width
            behind[column] -= width
            rates = zip(self.derivative(ahead, held, np), self.derivative(behind, held, np), strict=True)
            for row, (one, other) in enumerate(rates):
                jacobian[:, row, column] = (one - other) / (2 * width)
        return jacobian

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Return the control inputs that bring the velocity of the position closest to a desired one.

        Controllers that compute velocities work with every model that supports this.

        Args:
            state: The states; shape (n, nx).
            velocity: The desired velocities [m/s]; shape (n, d).

        Returns:
            Control inputs, not yet saturated; shape (n, nu).

        Raises:
            NotImplementedError: The model cannot follow a velocity.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot be steered by a velocity")

    def slowed(self, state: Array, control_input: Array, factor: Array) -> Array:
        """Return the control inputs that follow the same path at a fraction of the speed.

        Components that brake work with every model that supports this. For factor 1 the control input stays as it is;
        otherwise this default follows a fraction of the velocity.

        Args:
            state: The states; shape (n, nx).
            control_input: The requested control inputs; shape (n, nu).
            factor: The fraction of the speed, from 0 (stop, as far as the model can) to 1; shape (n,).

        Returns:
            Control inputs, not yet saturated; shape (n, nu).

        Raises:
            NotImplementedError: The model cannot follow a velocity.
        """
        velocity = factor[:, None] * self.velocity(state, control_input)
        return np.where(factor[:, None] < 1.0, self.follow_velocity(state, velocity), control_input)
