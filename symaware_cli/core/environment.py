"""Environments: the true states of agents, and how they move."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from symaware_cli.core.entity_group import EntityGroup
from symaware_cli.geometry import BodiesInPlane, Pose, Proximity, Scenery, rays_in_plane
from symaware_cli.world import (
    Contact,
    Drive,
    ErrorCollector,
    Parameters,
    Plugin,
    Roster,
    Snapshot,
    UnsupportedError,
    nanoseconds,
    seconds,
)

if TYPE_CHECKING:
    from symaware_cli.geometry import Articulation
    from symaware_cli.world import Image, Obstacle

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class EnvironmentParameters(Parameters):
    """The parameters of every environment."""

    time_step: float = Field(0.05, ge=1e-6, le=1e6, description="Simulated time between two steps [s].")
    debounce: float = Field(
        0.0,
        ge=0,
        le=1e6,
        description="Time that two bodies must be apart until their contact has ended [s]; if they touch before, "
        "it continues. 0: a contact ends when the bodies part.",
    )


class WorldError(UnsupportedError):
    """A world does not support something that a scenario requires; `path` is its place in the scenario.

    Attributes:
        needs: The feature of worlds that support it, as in `Environment.provides`; None if no feature indicates it.
    """

    def __init__(self, message: str, *path: str | int, needs: str | None = None) -> None:
        super().__init__(message, *(path or ("environment",)))
        self.needs = needs


class Environment(Plugin, ABC):
    """A world that holds the true state of every agent and moves it step by step.

    It never changes an array that it has returned: each step creates new ones.

    A world that holds resources other than memory, such as the client of a physics engine, releases them in `close`. It
    can be used in a ``with`` statement, which closes it at the end.

    Attributes:
        batchable: Whether the agents of many runs may share it: none has an influence on those of another run. It has
            `contacts_begun` then.
        debounce: How long two bodies must be apart until their contact has ended, in nanoseconds.
        folder: The folder of the files that a scenario refers to.
        further_folders: Folders that are searched for such files after it.
        ground: The height of the ground plane [m]; None if there is none.
        groups: The groups in the roster's order.
        obstacles: The bodies that are part of the environment, by name.
        on_contact: The effect of contacts in a world without forces: ``pass``, ``stop``, ``slide``, or ``end`` if the
            run ends with its first contact. None if forces decide.
        provides: Optional features of this world: ``forces``, if forces move bodies; ``images``, if it renders camera
            images; ``vehicles``, if it moves bodies by `Model.vehicle`; ``mechanisms``, if it moves joints by
            `Model.mechanism`; ``tilt``, if entities may have a roll and a pitch. Messages about a world without a
            feature name the installed ones that provide it.
        proximity: Finds the pairs of agents that are near each other, with results shared by all callers.
        roster: The ids and indices of all agents.
        is_open: Whether agents can enter and leave this world, by `admit` and `dismiss`.
        can_return: Whether agents that left can enter again, in the states in which they left.
        is_shared: Whether other processes can follow this world, by `share` and `follow`.
        present: Which agents are in it, by index, read-only; shape (N,). None for all of them.
        time_step: Simulated time between two steps, in nanoseconds.
    """

    Parameters: ClassVar[type[BaseModel]] = EnvironmentParameters

    batchable: ClassVar[bool] = False
    folder: Path = Path()
    further_folders: tuple[Path, ...] = ()
    ground: float | None = None
    is_open: ClassVar[bool] = False
    can_return: ClassVar[bool] = False
    is_shared: ClassVar[bool] = False
    on_contact: str | None = None
    provides: ClassVar[Sequence[str]] = ()
    groups: Sequence[EntityGroup]
    obstacles: Mapping[str, Obstacle]
    present: NDArray[np.bool_] | None = None
    proximity: Proximity
    roster: Roster
    debounce: int
    time_step: int

    def __init__(self, parameters: BaseModel | None = None) -> None:
        super().__init__(parameters)
        self.time_step = nanoseconds(self.parameters.time_step)
        self.debounce = nanoseconds(getattr(self.parameters, "debounce", 0.0))

    def initialise(self, groups: Sequence[EntityGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
        """Place all agents and obstacles.

        Args:
            groups: All groups, with their initial states.
            obstacles: The other bodies by name.
            seed: The seed of the run, for `symaware_cli.generator`.

        Raises:
            ValueError: An obstacle has the name of a group.
            WorldError: The world does not support something; nothing is placed then.
        """
        for name in sorted({group.name for group in groups} & set(obstacles)):
            raise ValueError(f"`{name}` is the name of both a group and an entity")
        self.groups = tuple(sorted(groups, key=lambda group: group.name))
        self.obstacles = dict(sorted(obstacles.items()))
        errors = ErrorCollector()
        for name, obstacle in self.obstacles.items():
            with errors.catch():
                if obstacle.is_tilted and "tilt" not in self.provides:
                    raise WorldError(
                        "this world has no third dimension to tilt anything in",
                        *("environment", "entities", name, "roll" if obstacle.roll else "pitch"),
                        needs="tilt",
                    )
        for group in self.groups:
            with errors.catch():
                self._check_features(group)
        errors.raise_first()
        self._scenery = Scenery(self.obstacles)
        self.proximity = Proximity()
        self._bodies_in_plane: BodiesInPlane | None = None
        models = {group.name: group.model for group in self.groups}
        self.roster = Roster(
            {group.name: group.ids for group in self.groups},
            models,
            {group.name: group.numbers for group in self.groups},
            runs=len(self.groups[0].seeds) if self.groups else 0,
        )
        self.proximity.runs = self.roster.runs
        for group in self.groups:
            group.set_roster(self.roster)
        self._count_present()

    def _check_features(self, group: EntityGroup) -> None:
        missing = [each for each in group.model.needs if each not in self.provides]
        if missing:
            said = f"the model needs a world with {missing[0]}, and this one has none"
            raise WorldError(said, "agents", group.name, "model", needs=missing[0])

    def _count_present(self) -> None:
        """Update which agents are present from the groups."""
        if all(group.present is None for group in self.groups):
            return
        here = [group.in_world for group in self.groups]
        present = np.concatenate(here)
        present.flags.writeable = False
        self.present = self.proximity.present = present

    def admit(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Add agents that were absent, in their present states; `group.present` is already updated.

        Those are their initial states, or with `can_return` those in which they left.

        Args:
            group: Their group.
            rows: Which agents of it.

        Raises:
            NotImplementedError: Agents cannot enter this world during a run.
        """
        raise NotImplementedError(f"agents cannot enter or leave {type(self).__name__}")

    def dismiss(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Remove agents; `group.present` is already updated. Their states stay as they are.

        Args:
            group: Their group.
            rows: Which agents of it.

        Raises:
            NotImplementedError: Agents cannot leave this world.
        """
        raise NotImplementedError(f"agents cannot enter or leave {type(self).__name__}")

    def drive(self, group: EntityGroup) -> Drive:
        """Return how the bodies of a group follow the velocities of their model; called after `initialise`.

        Raises:
            WorldError: They do so in a way that this world cannot state; `path` is the place of the reason.
        """
        raise WorldError("this world does not state how bodies follow their models", "environment", "use")

    def overlaps(self, id: str) -> Sequence[str]:
        """The names of the agents and obstacles that the body of an agent overlaps now, as seen from above."""
        return ()

    @property
    def scenery(self) -> Scenery:
        """The obstacles at their present positions; shared by all callers within a step."""
        if self._scenery.moves:
            self._scenery = self._scenery.at(self.snapshot().time)
        return self._scenery

    @property
    def gravity(self) -> Sequence[float] | None:
        """The acceleration of free bodies in space, [x, y, z] [m/s^2]; None if the world does not define a vertical."""
        return None

    def moves(self, name: str) -> bool:
        """Return whether an obstacle ever moves."""
        return self.obstacles[name].path is not None

    def pose(self, name: str) -> Pose:
        """Return the present pose of an obstacle."""
        return self.obstacles[name].pose(seconds(self.snapshot().time))

    def articulations(self) -> Mapping[str, Articulation]:
        """Return the links and appearance of bodies, by group and obstacle, for worlds in space that have them.

        Meshes are named by the paths of their files.
        """
        return {}

    def body_poses(self, name: str) -> Array | None:
        """Return the present poses in space of the bodies of a group, or of an obstacle.

        Args:
            name: The group or the obstacle.

        Returns:
            Position [m] and quaternion (x, y, z, w) of each; shape (n, 7). None if `state` or `pose` already contains
            them.
        """
        return None

    def entity_poses(self, names: Sequence[str]) -> Array:
        """Return the present poses of obstacles.

        Args:
            names: Obstacles with the same number of coordinates; `body_poses` must return poses for all or for none.

        Returns:
            Position [m], heading [rad] and, if `body_poses` returns it, the quaternion (x, y, z, w); shape (n, d + 1)
            or (n, d + 5).
        """
        poses = []
        for name in names:
            pose, turned = self.pose(name), self.body_poses(name)
            poses.append([*pose.position, pose.heading, *(() if turned is None else turned[0, 3:].tolist())])
        return np.array(poses)

    def joint_positions(self, name: str) -> Array | None:
        """Return the present joint positions of a group's bodies or of an obstacle, ordered as in its articulation.

        Args:
            name: The group or the obstacle.

        Returns:
            Angles [rad] and displacements [m]; shape (n, joints). None if there are no moving joints.
        """
        return None

    def close(self) -> None:
        """Release all resources; the world cannot be used afterwards. Closing it twice has no effect."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @abstractmethod
    def step(self) -> None:
        """Advance by one time step under the control inputs that the groups request."""

    def push(self, group: EntityGroup, rows: Sequence[int], change: Array) -> None:
        """Add to the true states of some agents, for the fault ``push`` of a scenario.

        Args:
            group: Their group.
            rows: Which agents of it.
            change: Added to the state of each; shape (nx,).

        Raises:
            NotImplementedError: This world does not support it.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot push agents")

    @abstractmethod
    def state(self, group: EntityGroup) -> Array:
        """The true states of a group, read-only; shape (n, nx)."""

    @abstractmethod
    def applied_input(self, group: EntityGroup) -> Array:
        """The control inputs in force during the last step, after saturation, read-only; shape (n, nu)."""

    @abstractmethod
    def snapshot(self) -> Snapshot:
        """The true states of all agents now; shared by all callers within a step."""

    def contacts_begun(self) -> NDArray[np.intp]:
        """Return an agent, by index, of each contact that began since the last step; only batchable worlds do.

        A contact that resumes within `debounce` after the bodies parted does not begin again.
        """
        raise NotImplementedError(f"`{type(self).__name__}` cannot be batched")

    def contacts(self) -> Sequence[Contact]:
        """The contacts that began or ended with the last step, without regard to `debounce`."""
        return ()

    def share(self) -> Mapping[str, Array]:
        """Return the data with which `follow` reproduces the present world in another process.

        Raises:
            NotImplementedError: This world cannot be shared.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot be followed by other processes")

    def follow(self, time: int, shared: Mapping[str, Array], contacts: Sequence[Contact]) -> None:
        """Take over the state of the world of another process, instead of making a step.

        Args:
            time: The instant, in nanoseconds.
            shared: The data that `share` returned there.
            contacts: Those that began or ended with the last step there.

        Raises:
            NotImplementedError: This world cannot follow.
            ValueError: The data are not those of a world like this one.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot follow the world of another process")

    def ray_cast(self, senders: Indices, origins: Array, directions: Array, reach: float, height: float = 0.0) -> Array:
        """Measure the distances along horizontal rays to the outline of the nearest agent or obstacle.

        The default implementation is planar: bodies of any height block a ray.

        Args:
            senders: The indices of the agents that cast them, whose own bodies are ignored; shape (n,).
            origins: The origins of the rays of each [m]; shape (n, d).
            directions: Unit vectors; shape (n, k, 2).
            reach: The greatest distance [m].
            height: Height of the origins above the centre of the sender's body, in worlds with heights [m].

        Returns:
            Distances [m], infinite if there is nothing within reach; shape (n, k).
        """
        if self._bodies_in_plane is None:
            self._bodies_in_plane = BodiesInPlane([group.entity.shape for group in self.groups for _ in group.ids])
        now = self.snapshot()
        pieces, owners = self._bodies_in_plane.placed(now.positions, now.headings, now.present)
        return rays_in_plane(senders, origins, directions, reach, pieces, owners, self.scenery)

    def in_sight(self, ones: Indices, others: Indices) -> NDArray[np.bool_]:
        """Return whether the lines between centres of agents are free of obstacles; other agents do not occlude.

        The default implementation uses `Scenery`: outlines seen from above, with heights if these are known.

        Args:
            ones: Agents, by index; shape (m,).
            others: The agent that each looks at; shape (m,).

        Returns:
            Shape (m,).
        """
        positions = self.snapshot().positions
        return ~self.scenery.blocks(positions.take(ones, 0), positions.take(others, 0))

    def body_positions(self, names: Sequence[str]) -> Array:
        """Return positions in space, by ids of agents and names of entities; shape (n, 3) [m].

        The height of bodies in a plane is 0, or the one at which the world has placed them.
        """
        places = np.zeros((len(names), 3))
        positions = self.snapshot().positions
        for row, name in enumerate(names):
            place = positions[self.roster.index(name)] if name in self.roster else self.pose(name).position
            places[row, : len(place)] = place
        return places

    def camera_image(
        self, position: Sequence[float], target: Sequence[float], size: tuple[int, int], field_of_view: float
    ) -> Image:
        """Render the image of a camera that looks at a point.

        Args:
            position: Where the camera is [m]; 3 coordinates.
            target: The point in the middle of the image [m].
            size: Width and height [pixels].
            field_of_view: The angle from the lower to the upper edge [rad].

        Raises:
            NotImplementedError: This world does not render images.
        """
        raise NotImplementedError(f"{type(self).__name__} has no images")
