"""Worlds with vehicles: groups whose models move the bodies themselves, by wheels, joints or rotors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symaware_cli.assets import Vehicle, VehicleBodies
from symaware_cli.core import EntityGroup, Obstacle, WorldError, seconds
from symaware_cli.engine import Actuator, process_noise
from symaware_cli.geometry import Array
from symaware_cli.worlds.physics import PhysicsEnvironment


class VehicleEnvironment(PhysicsEnvironment):
    """A physics world in which models may bring a `Vehicle`.

    A subclass calls `_vehicle` for each group without an actuator, loads its bodies, and passes them to `_attach`. Its
    `_push` calls `_push_vehicles` first.
    """

    def initialise(self, groups: Sequence[EntityGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
        """Create all bodies in their initial states."""
        step = seconds(self.time_step)
        #: The process noise of groups of vehicles; actuators add that of all others.
        self._noises = {
            group.name: process_noise(group, step, seed) for group in groups if group.model.vehicle() is not None
        }
        self._vehicles: list[tuple[Vehicle, int]] = []
        super().initialise(groups, obstacles, seed)

    def _actuator(self, group: EntityGroup, seed: int) -> Actuator | None:
        return super()._actuator(group, seed) if group.model.vehicle() is None else None

    def _vehicle(self, group: EntityGroup) -> Vehicle:
        """Return the vehicle of a group.

        Raises:
            WorldError: This world lacks a feature that it needs.
        """
        vehicle: Vehicle = group.model.vehicle()
        if vehicle.needs_ground and self.ground is None:
            where = ("environment", "with", "ground")
            raise WorldError(f"the vehicles of `{group.name}` drive on the ground, and there is none", *where)
        vehicle.ground = self.ground
        return vehicle

    def _attach(self, vehicle: Vehicle, number: int, bodies: VehicleBodies) -> None:
        """Hand the bodies of a group to its vehicle.

        Raises:
            WorldError: It does not support this world, or process noise.
        """
        group, state = self.groups[number], self._states[number]
        try:
            vehicle.attach(bodies, state)
            vehicle.start(range(len(group)), state)
        except WorldError as error:
            within = error.path if error.path[0] == "with" else ()
            raise WorldError(str(error), "agents", group.name, "model", *within) from error
        if self._noises[group.name] and type(vehicle).displace is Vehicle.displace:
            raise WorldError("its vehicle does not support process noise", "agents", group.name, "model")
        self._vehicles.append((vehicle, number))

    def _plan_velocities(self) -> None:
        super()._plan_velocities()
        for vehicle, number in self._vehicles:
            vehicle.actuate(self._applied[number])

    def _push_vehicles(self) -> None:
        """Let vehicles apply the forces of a physics step."""
        for vehicle, _ in self._vehicles:
            vehicle.push()

    def _push_others(self, number: int, rows: Sequence[int], change: Array) -> None:
        self._vehicle_of(number).displace(rows, np.tile(change, (len(rows), 1)))

    def _vehicle_of(self, number: int) -> Vehicle:
        return next(vehicle for vehicle, own in self._vehicles if own == number)

    def _add_process_noise(self, time: int) -> None:
        for vehicle, number in self._vehicles:
            noise = self._noises[self.groups[number].name]
            if noise:
                vehicle.displace(range(len(self.groups[number])), noise.draw(time))

    def _read_others(self, velocities: Array) -> None:
        for vehicle, number in self._vehicles:
            state, velocity = vehicle.read()
            group = self.groups[number]
            if group.present is not None:
                state = np.where(group.present[:, None], state, self._states[number])
                velocity = np.where(group.present[:, None], velocity, 0.0)
            state.flags.writeable = False
            self._states[number] = state
            start, dimensions = self.roster.start(group.name), len(group.model.position)
            velocities[start : start + len(group), :dimensions] = velocity[:, :dimensions]
