"""The kinematic world: integrates each model as it is, without forces or friction.

Reasons: docs/decisions/0087-sensing.md (contacts)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field

from symaware_cli.core import (
    Contact,
    Drive,
    EntityGroup,
    EnvironmentParameters,
    ErrorCollector,
    Model,
    Obstacle,
    Snapshot,
    WorldError,
)
from symaware_cli.engine.environments.actuator import check_time_step
from symaware_cli.engine.environments.column_environment import ColumnEnvironment
from symaware_cli.engine.environments.contact_detector import ContactDetector
from symaware_cli.engine.environments.contact_response import ContactResponse, OnContact
from symaware_cli.engine.environments.process_noise import process_noise
from symaware_cli.geometry import Array, Indices
from symaware_cli.world import Integrator, integrate

#: The most agents of a group that is moved together with others: with more, joining the arrays saves little.
_FEW = 64


class KinematicEnvironment(ColumnEnvironment):
    """Moves every group by its own model. Contacts are reported; by default bodies then pass through each other.

    Requested control inputs are saturated at the limits of the model and held over the step. The model's process noise
    is added after it.
    """

    batchable = True
    can_return = True
    provides = ("co-simulation",)

    class Parameters(EnvironmentParameters):
        """Parameters of the kinematic world."""

        integrator: Integrator = Field(
            "exact",
            description="How the dynamics are integrated: in closed form where the model has one, else as by rk4; "
            "by Runge-Kutta of order 4; by the explicit Euler method. Models in discrete time are not integrated.",
        )
        substeps: int = Field(
            1, ge=1, le=1000, description="Into how many parts a time step is divided where rk4 or euler integrate it."
        )
        on_contact: OnContact = Field(
            "pass",
            description="What happens to agents that meet another body: they pass through it; they stop, where they "
            "were before the step; they slide along it; or the run ends. Contacts are reported in any case.",
        )

    def initialise(self, groups: Sequence[EntityGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
        """Set all groups to their initial states.

        Raises:
            WorldError: An entity is to move by forces, which this world does not have, or a model in discrete time has
                another time step than the environment.
        """
        super().initialise(groups, obstacles, seed)
        errors = ErrorCollector()
        for name, obstacle in self.obstacles.items():
            with errors.catch():
                if obstacle.velocity or obstacle.turn_rate:
                    raise WorldError(
                        "only physics worlds move an entity by its `velocity` and `turn_rate`; here, give it a path",
                        *("environment", "entities", name),
                        needs="forces",
                    )
        for group in self.groups:
            with errors.catch():
                check_time_step(group, self.time_step)
        self._simulators = [group.model.simulator(self.time_step) for group in self.groups]
        for group, simulator, states in zip(self.groups, self._simulators, self._states, strict=True):
            with errors.catch():
                try:
                    if simulator is not None:
                        simulator.start(states)
                except ValueError as error:
                    raise WorldError(str(error), *("agents", group.name, "state")) from error
        errors.raise_first()
        #: The groups by number, in sets of those that are moved together.
        self._together = self._alike()
        self._noises = [process_noise(group, self.parameters.time_step, seed) for group in self.groups]
        self._detector = ContactDetector(self.groups, self.scenery, self.proximity, self.time_step, self.debounce)
        self.on_contact = kind = self.parameters.on_contact
        self._response = ContactResponse(kind, self.groups) if kind in ("stop", "slide") else None
        #: The states that the models led to in the last step, before contacts changed them; None if they did not.
        self._wanted: list[Array] | None = None

    def step(self) -> None:
        """Advance every group by its model under its saturated control input."""
        self._apply_inputs()
        before, states, inputs = list(self._states), self._states, self._applied
        for numbers in self._together:
            number = numbers[0]
            if len(numbers) > 1:
                self._move_together(numbers)
            elif (simulator := self._simulators[number]) is not None:
                present = self.groups[number].present
                rows = range(len(states[number])) if present is None else np.flatnonzero(present).tolist()
                self._place(number, simulator.step(self._time, states[number], inputs[number], rows))
            else:
                self._place(number, self._integrated(number, states[number], inputs[number]))
        self._time += self.time_step
        self._snapshot = self._contacts = None
        if self._response:
            self._respond(self._response, before)

    def _alike(self) -> list[list[int]]:
        """Return the groups by number, in sets of those that are moved together: small ones whose models are equal.

        No row depends on other rows, so the states are the same as if each group were moved by itself.
        """
        sets: list[list[int]] = []
        joinable: list[list[int]] = []
        for number, (group, simulator) in enumerate(zip(self.groups, self._simulators, strict=True)):
            model = group.model
            # What a model learns of its body is not among its parameters.
            by_itself = simulator is not None or not model.batchable or type(model).fit is not Model.fit
            if by_itself or len(group) > _FEW:
                sets.append([number])
                continue
            for others in joinable:
                other = self._models[others[0]]
                if type(other) is type(model) and other.parameters == model.parameters:
                    others.append(number)
                    break
            else:
                joinable.append([number])
        return sorted(sets + joinable)

    def _integrated(self, number: int, states: Array, inputs: Array) -> Array:
        """Return states (n, nx) after a step under control inputs (n, nu), by the model of a group."""
        given = self.parameters
        return integrate(self._models[number], states, inputs, given.time_step, given.integrator, given.substeps)

    def _move_together(self, numbers: Sequence[int]) -> None:
        """Move groups whose models are equal."""
        joined = (np.concatenate([each[number] for number in numbers]) for each in (self._states, self._applied))
        moved, begin = self._integrated(numbers[0], *joined), 0
        for number in numbers:
            end = begin + len(self._states[number])
            self._place(number, moved[begin:end].copy())
            begin = end

    def _place(self, number: int, state: Array) -> None:
        """Set the states of a group after a step, with its noise; absent agents stay as they are."""
        noise, present = self._noises[number], self.groups[number].present
        if noise:
            state = state + noise.draw(self._time)
        if present is not None:
            state = np.where(present[:, None], state, self._states[number])
        state.setflags(write=False)
        self._states[number] = state

    def _respond(self, response: ContactResponse, before: list[Array]) -> None:
        """Keep bodies from moving into each other; `before` has the states before the step."""
        self._wanted = wanted = list(self._states)
        self._states = response.corrected(before, wanted, self._scenery.at(self._time), self.present)
        for state in self._states:
            state.flags.writeable = False

    def push(self, group: EntityGroup, rows: Sequence[int], change: Array) -> None:
        """Add to the true states of some agents instantaneously.

        Raises:
            ValueError: The model is a program, which has a state of its own.
        """
        number = self._number[group.name]
        if self._simulators[number] is not None:
            raise ValueError(f"the states of {group.name} are those of a program, and cannot be changed from outside")
        state = self._states[number].copy()
        state[list(rows)] += change
        state.flags.writeable = False
        self._states[number] = state
        self._snapshot = None

    def drive(self, group: EntityGroup) -> Drive:
        """Return that bodies have their velocities at once, and for the whole time step.

        Raises:
            WorldError: Contacts stop bodies, or let them slide.
        """
        if self._response:
            raise WorldError(
                "bodies that meet others do not move as their models say", "environment", "with", "on_contact"
            )
        return Drive(self.parameters.time_step)

    def contacts(self) -> Sequence[Contact]:
        """The contacts that began or ended with the last step; none in a batch, see `contacts_begun`."""
        if self.roster.runs is not None:
            return ()
        if self._contacts is None:
            # Not within the step: the caller has by now made sure that all states are finite.
            self._contacts = self._detector.update(self._met(), self.scenery)
        return self._contacts

    def _met(self) -> Snapshot:
        """Return the agents where they meet: where their models led them, as they never overlap once they stopped."""
        if self._wanted is None:
            return self.snapshot()
        return Snapshot(self._time, self.roster, self._models, self._wanted, self._applied, None, self.present)

    def contacts_begun(self) -> Indices:
        """An agent, by index, of each contact that began since the last call; in a batch, instead of `contacts`."""
        return self._detector.begun(self.snapshot(), self.scenery)
