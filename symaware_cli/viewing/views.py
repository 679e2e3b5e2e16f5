"""Views of a log: who and what is to be seen, as the manifest tells it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from symaware_cli.awareness.signal import Drawn
from symaware_cli.core import Shape, Signal
from symaware_cli.geometry.footprint import footprint
from symaware_cli.geometry.region import Region
from symaware_cli.geometry.rotation import about, attitude, attitude_columns, rotated
from symaware_cli.recording.error import LogError
from symaware_cli.recording.fields import signal_topic
from symaware_cli.recording.geometry import geometry_of
from symaware_cli.recording.index import ChannelInfo
from symaware_cli.recording.json_text import read_yaml
from symaware_cli.recording.log_schema import GEOMETRY
from symaware_cli.recording.reader import Log
from symaware_cli.recording.specifications import specification_rows
from symaware_cli.viewing.figure import Figure
from symaware_cli.viewing.palette import SCENERY, Colour, agent_colours, body_colours

Array = NDArray[np.float64]

#: What channels tell of their columns.
_ANNOUNCED = ("columns", "units")


@dataclass(frozen=True)
class GroupView:
    """A group of agents.

    Attributes:
        name: The group's.
        agents: Their ids, in the order of rows.
        colours: (n, 3).
        shape: Their outline; None for points.
        state: Name and unit of each element of the state.
        control_input: The same of the control input.
        position: Where the position stands in the state; 2 or 3 indices.
        heading: Where the heading stands in the state; None if it has none.
        whereabouts: The topic that says where they are: in truth or, if that was left out, as they believe.
        perception_range: How far they see [m]; None if that is not limited or not known.
        height: At which height those are whose position is one in a plane [m].
        figure: What their bodies consist of, if more than their outline is known.
        signals: The parts of awareness that the log has of them, and what their components hand out, by name.
    """

    name: str
    agents: tuple[str, ...]
    colours: NDArray[np.uint8]
    shape: Shape | None
    state: tuple[tuple[str, str], ...]
    control_input: tuple[tuple[str, str], ...]
    position: tuple[int, ...]
    heading: int | None
    whereabouts: str
    perception_range: float | None = None
    height: float = 0.0
    figure: Figure | None = None
    signals: Mapping[str, Signal] = field(default_factory=dict)

    def drawn(self, how: Drawn) -> Iterator[tuple[str, str]]:
        """The name of each of `signals` that is drawn in some way, with its topic."""
        return ((name, self.topic(name)) for name, signal in self.signals.items() if signal.drawn == how)

    def topic(self, name: str) -> str:
        """The topic of one of `signals`."""
        return signal_topic(self.name, name, self.signals[name])

    @property
    def radius(self) -> float:
        """The radius of the smallest circle around the body; 0 for a point [m]."""
        return self.shape.radius if self.shape else 0.0

    @property
    def extent(self) -> float:
        """The radius of a circle around the middle of all that is seen of the body; 0 for a point [m]."""
        return self.figure.radius if self.figure else self.radius

    def positions(self, states: Array) -> Array:
        """Pick the positions in space out of states; (..., nx) to (..., 3) [m]."""
        return in_space(states[..., list(self.position)], self.height)

    def orientations(self, states: Array) -> Array:
        """Pick how bodies are turned out of states; (..., nx) to quaternions x, y, z, w (..., 4)."""
        columns = attitude_columns([name for name, _ in self.state])
        if columns:
            return attitude(*(states[..., column] for column in columns))
        headings = self.headings(states)
        return about((0.0, 0.0, 1.0), np.zeros(states.shape[:-1]) if headings is None else headings)

    def headings(self, states: Array) -> Array | None:
        """Pick the headings out of states; (..., nx) to (...) [rad]; None if the state has none."""
        return None if self.heading is None else states[..., self.heading]


@dataclass(frozen=True)
class ObstacleView:
    """An entity of the environment.

    Attributes:
        name: Its name.
        shape: Its outline, seen from above.
        position: Where it stands at the beginning; (3,) [m].
        heading: Where its x axis points at the beginning [rad].
        moves: Whether it may leave that, which /world/<name>/state tells.
        tilt: Its roll and its pitch at the beginning, and as long as nothing else is known [rad].
        stands: Whether its position is where it stands, as without a height of its own; otherwise it is its middle.
        figure: What it consists of, if more than its outline is known.
        colour: What tells it from bodies of another kind.
    """

    name: str
    shape: Shape
    position: Array
    heading: float
    moves: bool
    tilt: tuple[float, float] = (0.0, 0.0)
    stands: bool = False
    figure: Figure | None = None
    colour: Colour = SCENERY

    @property
    def corners(self) -> Array:
        """The corners of boxes around it, at the beginning; (m, 3) [m]."""
        if self.figure is None:
            sides = self.shape.radius * np.array([[-1.0, -1.0], [1.0, 1.0]])
            return in_space(self.position[:2] + sides)
        own = self.figure.corners
        return self.position + rotated(self.orientations(np.full(len(own), self.heading)), own)

    def orientations(self, headings: Array) -> Array:
        """How it is turned with these headings [rad], while it keeps its tilt; quaternions (x, y, z, w)."""
        return attitude(*self.tilt, headings) if any(self.tilt) else about((0.0, 0.0, 1.0), headings)

    def positions(self, values: Array) -> Array:
        """Pick the positions in space out of what /world/<name>/state says; (..., columns) to (..., 3) [m]."""
        return in_space(values[..., :-1], float(self.position[2]))


@dataclass(frozen=True)
class RunView:
    """Everybody and everything in a log.

    Attributes:
        name: The scenario's.
        seed: The seed of the run.
        group_views: By name of the group, in the order of the manifest.
        obstacle_views: By name.
        roster: Who can be known of, in the order of `Awareness.entities`.
        duration: How long the run was to be [s].
        surfaces: The files of the meshes that figures consist of, by the name that they have there.
        has_space: Whether the world is one of space, however its agents move in it.
        ground: The height of the plane that carries what falls [m]; None where there is none.
        quantities: Name and unit of each column of each topic, where the log tells.
        regions: The regions of the scenario, by name.
        specifications: The ids of the agents that each row of a specification is about, by its name.
    """

    name: str
    seed: int
    group_views: Mapping[str, GroupView]
    obstacle_views: Mapping[str, ObstacleView]
    roster: tuple[str, ...]
    duration: float
    surfaces: Mapping[str, bytes] = field(default_factory=dict)
    has_space: bool = False
    ground: float | None = None
    quantities: Mapping[str, Sequence[tuple[str, str]]] = field(default_factory=dict)
    regions: Mapping[str, Region] = field(default_factory=dict)
    specifications: Mapping[str, Sequence[tuple[str, ...]]] = field(default_factory=dict)

    def quantities_of(self, topic: str, field: str, width: int) -> Sequence[tuple[str, str]]:
        """Name and unit of each of so many columns of a topic, by the name of a field where the log tells none."""
        known = self.quantities.get(topic, ())
        return known if len(known) == width else [(f"{field} {number}", "") for number in range(width)]

    @property
    def agent_count(self) -> int:
        """How many agents there are."""
        return sum(len(group_view.agents) for group_view in self.group_views.values())

    @property
    def is_spatial(self) -> bool:
        """Whether there is a third dimension, or all keep to a plane that has none."""
        return self.has_space or any(len(group_view.position) == 3 for group_view in self.group_views.values())

    @cached_property
    def place(self) -> Mapping[str, tuple[str, int]]:
        """The group and the row in it of each agent."""
        return {
            agent: (group_view.name, row)
            for group_view in self.group_views.values()
            for row, agent in enumerate(group_view.agents)
        }

    @property
    def agents(self) -> Sequence[str]:
        """The ids of all agents."""
        return list(self.place)


def run_view_of(log: Log) -> RunView:
    """Read who takes part in a log.

    Raises:
        LogError: It is not one of ours, or its manifest is damaged.
    """
    log.require_manifest()
    manifest = log.manifest
    try:
        groups = manifest["groups"]
        colours = agent_colours([len(group["agents"]) for group in groups.values()])
        ranges = _perception_ranges(log)
        geometry = geometry_of(log.attachments, log.path)
        figures = [Figure(number, each, log.attachments) for number, each in enumerate(geometry.articulations)]
        of = {name: figures[place] for name, place in geometry.bodies.items()}
        heights = geometry.heights
        tints = body_colours([name for name, entity in manifest["entities"].items() if _moves(entity)])
        return RunView(
            name=manifest["name"],
            seed=manifest["seed"],
            group_views={
                name: _group_view(
                    name,
                    group,
                    colours=colour,
                    whereabouts=_whereabouts(name, log),
                    perception_range=ranges.get(name),
                    height=heights.get(name, 0.0),
                    figure=of.get(name),
                    signals=log.signals(name),
                )
                for (name, group), colour in zip(groups.items(), colours, strict=True)
            },
            obstacle_views={
                name: _prop(name, entity, heights.get(name, 0.0), figure=of.get(name), colour=tints.get(name, SCENERY))
                for name, entity in manifest["entities"].items()
            },
            roster=tuple(manifest["roster"]),
            duration=manifest["steps"] * manifest["time_step"] / 1e9,
            surfaces={name: log.attachments[name] for figure in figures for name in figure.surfaces},
            has_space=GEOMETRY in log.attachments,
            ground=geometry.ground,
            regions={name: Region.model_validate(each) for name, each in manifest.get("regions", {}).items()},
            specifications=specification_rows(log.channels),
            quantities={
                topic: quantities for topic, channel in log.topics.items() if (quantities := _quantities(channel))
            },
        )
    except (KeyError, TypeError, ValueError, AttributeError, ValidationError) as error:
        raise LogError(f"the manifest in {log.path} is damaged") from error


def in_space(positions: Array, height: float = 0.0) -> Array:
    """Add a height to positions in a plane; (..., 2 or 3) to (..., 3)."""
    if positions.shape[-1] == 3:
        return positions
    return np.concatenate([positions, np.full((*positions.shape[:-1], 1), height)], axis=-1)


def _group_view(name: str, group: Mapping[str, Any], **more: Any) -> GroupView:
    model, shape = group["model"], group["entity"].get("shape")
    return GroupView(
        name=name,
        agents=tuple(group["agents"]),
        shape=Shape.model_validate(shape) if shape else None,
        state=tuple((quantity, unit) for quantity, unit in model["state"]),
        control_input=tuple((quantity, unit) for quantity, unit in model["control_input"]),
        position=tuple(model["position"]),
        heading=model["heading"],
        **more,
    )


def _moves(entity: Mapping[str, Any]) -> bool:
    return bool(entity.get("moves") or entity.get("path"))


def _prop(name: str, entity: Mapping[str, Any], height: float, **look: Any) -> ObstacleView:
    shape, tilt = Shape.model_validate(entity["shape"]), (float(entity.get("roll", 0)), float(entity.get("pitch", 0)))
    return ObstacleView(
        name=name,
        shape=shape if entity.get("mass") and not entity.get("path") else footprint(shape, *tilt),
        tilt=tilt,
        position=in_space(np.array(entity["position"], float), height),
        heading=float(entity["heading"]),
        moves=_moves(entity),
        # What is free tells the height of its middle as it moves.
        stands=len(entity["position"]) == 2 and bool(entity.get("path") or not entity.get("moves")),
        **look,
    )


def _quantities(channel: ChannelInfo) -> list[tuple[str, str]]:
    """Name and unit of each column of a channel; none where it does not tell the names."""
    names, units = (channel.metadata[key].split(",") if channel.metadata.get(key) else [] for key in _ANNOUNCED)
    return list(zip(names, units if len(units) == len(names) else [""] * len(names), strict=True))


def _whereabouts(name: str, log: Log) -> str:
    truth, belief = f"/world/{name}/state", f"/agents/{name}/state"
    return belief if truth not in log.topics and belief in log.topics else truth


def _perception_ranges(log: Log) -> dict[str, float]:
    """How far each group sees, as far as the resolved scenario tells."""
    try:
        document = read_yaml(log.attachments.get("resolved.yaml", b"")) or {}
        return {
            name: float(component["with"]["range"])
            for name, agents in document.get("agents", {}).items()
            for component in agents.get("components", {}).values()
            if component.get("use", "").startswith("perception.") and (component.get("with") or {}).get("range")
        }
    except (ValueError, TypeError, AttributeError):
        # The scenario is what the user wrote, and of a later version perhaps: a replay does without.
        return {}
