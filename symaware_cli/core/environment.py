"""Environments: where agents are, and what moves them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from symaware_cli.core.entity_group import EntityGroup
from symaware_cli.geometry.articulation import Articulation
from symaware_cli.geometry.path import Pose
from symaware_cli.geometry.proximity import Proximity
from symaware_cli.geometry.rays import BodiesInPlane, rays_in_plane
from symaware_cli.geometry.scenery import Scenery
from symaware_cli.world.contact import Contact
from symaware_cli.world.entity import Obstacle
from symaware_cli.world.plugin import Parameters, Plugin
from symaware_cli.world.reading import Image
from symaware_cli.world.roster import Roster
from symaware_cli.world.snapshot import Snapshot
from symaware_cli.world.time import nanoseconds, seconds
from symaware_cli.world.unsupported import ErrorCollector, UnsupportedError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class EnvironmentParameters(Parameters):
    """What every environment can be told."""

    time_step: float = Field(0.05, ge=1e-6, le=1e6, description="Simulated time between two steps [s].")


class WorldError(UnsupportedError):
    """A world cannot do what a scenario asks of it; `path` is one of the scenario."""

    def __init__(self, message: str, *path: str | int) -> None:
        super().__init__(message, *(path or ("environment",)))


class Environment(Plugin, ABC):
    """A world that holds the true state of every agent and moves it step by step.

    It never changes an array in place that somebody may hold: each step makes new ones.

    A world that holds more than memory, such as the client of a physics engine, lets go of it in `close`; used in a
    ``with`` statement, it is closed at the end.

    Attributes:
        folder: Where the files lie that a scenario names.
        ground: The height of a plane that carries what falls [m]; None where there is none.
        groups: The groups in the roster's order.
        obstacles: The bodies that are part of the environment, by name.
        provides: What this world has and not every world: ``images``, for components that require it; ``vehicles``, if
            it moves bodies by `Model.vehicle`; ``tilt``, if entities may have a roll and a pitch.
        proximity: Which agents are near each other, shared by all who ask about `snapshot().positions`.
        roster: Who is who.
        is_open: Whether agents can enter and leave this world, by `admit` and `dismiss`.
        is_shared: Whether other processes can follow this world, by `share` and `follow`.
        present: Which agents are in it, by index, read-only; shape (N,). None for all of them.
        time_step: Simulated time between two steps, in nanoseconds.
    """

    Parameters: ClassVar[type[BaseModel]] = EnvironmentParameters

    folder: Path = Path()
    ground: float | None = None
    is_open: ClassVar[bool] = False
    is_shared: ClassVar[bool] = False
    provides: ClassVar[Sequence[str]] = ()
    groups: Sequence[EntityGroup]
    obstacles: Mapping[str, Obstacle]
    present: NDArray[np.bool_] | None = None
    proximity: Proximity
    roster: Roster
    time_step: int

    def __init__(self, parameters: BaseModel | None = None) -> None:
        super().__init__(parameters)
        self.time_step = nanoseconds(self.parameters.time_step)

    def initialise(self, groups: Sequence[EntityGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
        """Put everybody in place.

        Args:
            groups: All groups, with their initial states.
            obstacles: The other bodies by name.
            seed: The seed of the run, for `symaware_cli.generator`.

        Raises:
            ValueError: An obstacle has the name of a group.
            WorldError: The world cannot do what is asked of it; only then is nothing in place.
        """
        for name in sorted({group.name for group in groups} & set(obstacles)):
            raise ValueError(f"there is both a group and an entity of the name `{name}`")
        self.groups = tuple(sorted(groups, key=lambda group: group.name))
        self.obstacles = dict(sorted(obstacles.items()))
        errors = ErrorCollector()
        for name, obstacle in self.obstacles.items():
            with errors.catch():
                if obstacle.is_tilted and "tilt" not in self.provides:
                    raise WorldError(
                        "this world has no third dimension to tilt anything in; `pybullet` has one",
                        *("environment", "entities", name, "roll" if obstacle.roll else "pitch"),
                    )
        errors.raise_first()
        self._scenery = Scenery(self.obstacles)
        self.proximity = Proximity()
        self._bodies_in_plane: BodiesInPlane | None = None
        models = {group.name: group.model for group in self.groups}
        self.roster = Roster({group.name: group.ids for group in self.groups}, models)
        for group in self.groups:
            group.set_roster(self.roster)
        self._count_present()

    def _count_present(self) -> None:
        """Look who is there, as the groups say."""
        if all(group.present is None for group in self.groups):
            return
        here = [np.ones(len(group), bool) if group.present is None else group.present for group in self.groups]
        present = np.concatenate(here)
        present.flags.writeable = False
        self.present = self.proximity.present = present

    def admit(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let agents enter who were not there, in their initial states; `group.present` says so already.

        Args:
            group: Their group.
            rows: Which agents of it.

        Raises:
            NotImplementedError: Nobody enters this world later than it begins.
        """
        raise NotImplementedError(f"nobody enters or leaves {type(self).__name__}")

    def dismiss(self, group: EntityGroup, rows: Sequence[int]) -> None:
        """Let agents leave for good; `group.present` says so already. Their states stay as they are.

        Args:
            group: Their group.
            rows: Which agents of it.

        Raises:
            NotImplementedError: Nobody leaves this world.
        """
        raise NotImplementedError(f"nobody enters or leaves {type(self).__name__}")

    def overlaps(self, id: str) -> Sequence[str]:
        """The agents and obstacles that the body of an agent overlaps now, by name, as seen from above."""
        return ()

    @property
    def scenery(self) -> Scenery:
        """The obstacles where they are now; shared by all who ask within a step."""
        if self._scenery.moves:
            self._scenery = self._scenery.at(self.snapshot().time)
        return self._scenery

    @property
    def gravity(self) -> Sequence[float] | None:
        """How what is free falls in space, [x, y, z] [m/s^2]; None where the world does not say what is up."""
        return None

    def moves(self, name: str) -> bool:
        """Tell whether an obstacle ever moves."""
        return self.obstacles[name].path is not None

    def pose(self, name: str) -> Pose:
        """Return where an obstacle is now."""
        return self.obstacles[name].pose(seconds(self.snapshot().time))

    def articulations(self) -> Mapping[str, Articulation]:
        """Return what bodies consist of and look like, by group and obstacle, where worlds of space know more of them.

        Meshes are named by the paths of their files.
        """
        return {}

    def body_poses(self, name: str) -> Array | None:
        """Return where the bodies of a group, or an obstacle, are in space now, and how they are turned.

        Args:
            name: The group or the obstacle.

        Returns:
            Position [m] and quaternion (x, y, z, w) of each; shape (n, 7). None where `state` or `pose` say as much.
        """
        return None

    def entity_poses(self, names: Sequence[str]) -> Array:
        """Return where obstacles are now, and how they are turned.

        Args:
            names: Such as have equally many coordinates, and of all or none of which `body_poses` tells more.

        Returns:
            Position [m] and heading [rad], and as far as `body_poses` tells it the quaternion (x, y, z, w); shape
            (n, d + 1) or (n, d + 5).
        """
        poses = []
        for name in names:
            pose, turned = self.pose(name), self.body_poses(name)
            poses.append([*pose.position, pose.heading, *(() if turned is None else turned[0, 3:].tolist())])
        return np.array(poses)

    def joint_positions(self, name: str) -> Array | None:
        """Return how the joints of the bodies of a group, or of an obstacle, stand now; ordered as in its articulation.

        Args:
            name: The group or the obstacle.

        Returns:
            Angles [rad] and ways [m]; shape (n, joints). None where nothing has joints that move.
        """
        return None

    def close(self) -> None:
        """Let go of everything; the world cannot be used afterwards. To close it twice does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @abstractmethod
    def step(self) -> None:
        """Advance by one time step under the control inputs that the groups request."""

    def push(self, group: EntityGroup, rows: Sequence[int], change: Array) -> None:
        """Change the true states of some agents all at once, as a fault of a scenario may ask for.

        Args:
            group: Their group.
            rows: Which agents of it.
            change: What to add to the state of each; shape (nx,).

        Raises:
            NotImplementedError: This world cannot do that.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot push anybody")

    @abstractmethod
    def state(self, group: EntityGroup) -> Array:
        """The true states of a group, read-only; shape (n, nx)."""

    @abstractmethod
    def applied_input(self, group: EntityGroup) -> Array:
        """The control inputs in force during the last step, after saturation, read-only; shape (n, nu)."""

    @abstractmethod
    def snapshot(self) -> Snapshot:
        """The whole world now; shared by all who ask within a step."""

    def contacts(self) -> Sequence[Contact]:
        """The contacts that began or ended with the last step."""
        return ()

    def share(self) -> Mapping[str, Array]:
        """Take all that it needs to see this world as it is now, for `follow` in another process.

        Raises:
            NotImplementedError: This world cannot be followed.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot be followed by other processes")

    def follow(self, time: int, shared: Mapping[str, Array], contacts: Sequence[Contact]) -> None:
        """Become as the world of another process is, instead of making a step.

        Args:
            time: The instant, in nanoseconds.
            shared: What `share` took there.
            contacts: Those that began or ended with the last step there.

        Raises:
            NotImplementedError: This world cannot follow.
            ValueError: That is not of a world like this one.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot follow the world of another process")

    def ray_cast(self, senders: Indices, origins: Array, directions: Array, reach: float, height: float = 0.0) -> Array:
        """Measure how far level rays go until they meet the outline of an agent or an obstacle.

        By default that is the geometry of the plane: whatever its height, everything stands in the way.

        Args:
            senders: The agents that send them, by index; their own bodies are no obstacle; shape (n,).
            origins: Where the rays of each begin [m]; shape (n, d).
            directions: Where they point, of length 1; shape (n, k, 2).
            reach: The greatest distance [m].
            height: How high above the middle of the sender's body they begin, where there are heights [m].

        Returns:
            Distances [m], infinite where there is nothing within reach; shape (n, k).
        """
        if self._bodies_in_plane is None:
            self._bodies_in_plane = BodiesInPlane([group.entity.shape for group in self.groups for _ in group.ids])
        now = self.snapshot()
        pieces, owners = self._bodies_in_plane.placed(now.positions, now.headings, now.present)
        return rays_in_plane(senders, origins, directions, reach, pieces, owners, self.scenery)

    def in_sight(self, ones: Indices, others: Indices) -> NDArray[np.bool_]:
        """Tell whether no obstacle stands between the middles of agents; other agents hide nobody.

        By default obstacles are what `Scenery` knows of them: outlines seen from above, with heights where these are
        known.

        Args:
            ones: Agents, by index; shape (m,).
            others: Whom each looks at; shape (m,).

        Returns:
            Shape (m,).
        """
        positions = self.snapshot().positions
        return ~self.scenery.blocks(positions.take(ones, 0), positions.take(others, 0))

    def body_positions(self, names: Sequence[str]) -> Array:
        """Return where bodies are in space, by ids of agents and names of entities; shape (n, 3) [m].

        What has no height of its own stands at 0, or where the world has put it.
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
        """Look at a point from another.

        Args:
            position: Where the camera is [m]; 3 coordinates.
            target: The point in the middle of the image [m].
            size: Width and height [pixels].
            field_of_view: The angle from the lower to the upper edge [rad].

        Raises:
            NotImplementedError: There is nothing to be seen in this world.
        """
        raise NotImplementedError(f"{type(self).__name__} has no images")
