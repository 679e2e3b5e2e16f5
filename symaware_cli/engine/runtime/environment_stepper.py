"""Steps the environment of a run, checks the resulting states and announces contacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from symaware_cli.awareness import Array
from symaware_cli.core import AgentGroup, Contact, Event, Level
from symaware_cli.engine.runtime.contact_episodes import ContactEpisodes
from symaware_cli.engine.runtime.failure import RunError
from symaware_cli.engine.runtime.interruption import Interrupted, Interruption
from symaware_cli.engine.runtime.restraint import Restraint
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.world import FARTHEST, is_within, said_of

#: How often restraints are asked in a step, since several may hold back the same agents.
_MOST_ROUNDS = 16


class EnvironmentStepper:
    """Steps the environment and checks the result; its exceptions become failures of the run."""

    def __init__(self, simulation: Simulation, interruption: Interruption) -> None:
        self._simulation = simulation
        self._environment = simulation.environment
        self._interruption = interruption
        self._episodes = ContactEpisodes(simulation.environment.debounce)
        self._restraints: list[Restraint] = []
        #: The groups with the shapes of their control inputs.
        self._groups = [(group, group.control_input.shape) for group in simulation.groups]

    def restrain(self, restraint: Restraint) -> None:
        """Hold agents back from the next step on."""
        self._restraints.append(restraint)

    def release(self, restraint: Restraint) -> None:
        """Undo `restrain`."""
        self._restraints.remove(restraint)

    def step(self) -> None:
        """Make one step of the environment, during which signals are delivered.

        Raises:
            RunError: The environment raised an exception.
        """
        if not self._restraints:
            self._step()
            return
        before = [(each, self._states(each).copy()) for each in self._restraints]
        with self._inputs_restrained():
            self._step()
        for _ in range(_MOST_ROUNDS):
            held = [self._hold_back(*each) for each in before]
            if not any(held):
                break

    def _states(self, restraint: Restraint) -> Array:
        group, rows = restraint.restrained
        states: Array = self._environment.state(group)[list(rows)]
        return states

    @contextmanager
    def _inputs_restrained(self) -> Iterator[None]:
        """Let the world apply the control inputs of the restraints; the requested ones stay unchanged."""
        replaced = []
        for each in self._restraints:
            group, rows = each.restrained
            column, inputs = group.control_column, group.control_input.copy()
            step = self._environment.time_step / 1e9
            inputs[list(rows)] = each.request(self._states(each), inputs[list(rows)], step)
            inputs.flags.writeable = False
            replaced.append((column, column.exchange(inputs)))
        try:
            yield
        finally:
            for column, inputs in reversed(replaced):
                column.exchange(inputs)

    def _hold_back(self, restraint: Restraint, before: Array) -> bool:
        """Apply a restraint to the states after a step, and return whether it changed any."""
        group, rows = restraint.restrained
        after = self._states(restraint)
        change = restraint.reach(before, after) - after
        held = np.flatnonzero(change.any(axis=1)).tolist()
        for place in held:
            self.push(group, [rows[place]], change[place])
        return bool(held)

    def _step(self) -> None:
        interruption = self._interruption
        interruption.unshield()
        try:
            self._environment.step()
        except Interrupted:
            raise
        except BaseException as error:
            raise self._simulation.environment_failure(error) from error
        finally:
            interruption.shield()

    def push(self, group: AgentGroup, rows: Sequence[int], change: Array) -> None:
        """Change the true states of those of the agents that are present.

        Raises:
            RunError: The environment raised an exception.
        """
        if group.present is not None:
            rows = [row for row in rows if group.present[row]]
        try:
            self._environment.push(group, rows, change)
        except BaseException as error:
            raise self._simulation.environment_failure(error) from error

    def check(self) -> None:
        """Check that true states are finite and bounded, and that `applied_input` has the right shape.

        Raises:
            RunError: A check failed, or the environment raised an exception.
        """
        environment, simulation = self._environment, self._simulation
        for group, shape in self._groups:
            try:
                truth, applied = environment.state(group), environment.applied_input(group)
                given = applied.shape if type(applied) is np.ndarray else np.shape(applied)
                if given != shape:
                    raise ValueError(f"`applied_input` of {group.name} has the shape {given} instead of {shape}")
            except BaseException as error:
                raise simulation.environment_failure(error) from error
            if not is_within(truth, FARTHEST):
                row = next(row for row, state in enumerate(truth) if not is_within(state, FARTHEST))
                problem = f"the state of {group.ids[row]} {said_of(truth[row])}"
                raise RunError("environment", simulation.environment_use, simulation.clock.now, problem)
            group.awareness.state_column.verified = truth

    def announce_contacts(self) -> None:
        """Fire `contact` for each contact that began or ended, and `touching` for each time that bodies met or parted.

        Raises:
            RunError: The environment raised an exception.
        """
        now = self._simulation.clock.now
        try:
            contacts = self._environment.contacts()
        except BaseException as error:
            raise self._simulation.environment_failure(error) from error
        events = self._simulation.events
        for contact in self._episodes.ended(now):
            self._announce(contact, now)
        for each in contacts:
            contact, is_announced = self._episodes.follow(each, now)
            if is_announced:
                self._announce(contact, now)
            if "touching" in events.wanted:
                events.fire(Event("touching", "environment", now, subject=contact, value=contact))

    def _announce(self, contact: Contact, now: int) -> None:
        verb = "touch" if contact.begins else "part"
        text = f"{contact.first} and {contact.second} {verb}"
        data = {"first": contact.first, "second": contact.second, "begins": contact.begins}
        self._simulation.events.fire(
            Event("contact", "environment", now, Level.WARNING, text, data, contact, value=contact)
        )
