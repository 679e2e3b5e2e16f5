"""Views of a log: groups, obstacles and run with everything needed to draw them, read from the manifest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from symaware_cli.awareness import Drawn
from symaware_cli.core import Shape, Signal
from symaware_cli.geometry import Region, about, attitude, attitude_columns, footprint, rotated
from symaware_cli.log import (
    GEOMETRY,
    Log,
    LogError,
    column_quantities,
    geometry_of,
    read_yaml,
    signal_topic,
    specification_channels,
    specification_rows,
    specification_span,
)
from symaware_cli.views.figure import Figure
from symaware_cli.views.outline import outlines, placed
from symaware_cli.views.palette import MOVABLE, SCENERY, Colour, agent_colours, body_colours
from symaware_cli.views.region_windows import Window, region_windows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GroupView:
    """A group of agents.

    Attributes:
        name: The name of the group.
        agents: The ids of its agents, in row order.
        colours: (n, 3).
        shape: The outline of an agent; None for points.
        state: Name and unit of each element of the state.
        control_input: Name and unit of each element of the control input.
        position: Indices of the position in the state, 2 or 3.
        heading: Index of the heading in the state; None if it has none.
        state_topic: The topic of the states to draw: the true ones or, if the log omits them, the believed ones.
        perception_range: Range of perception [m]; None if unlimited or unknown.
        height: Height of agents whose position is two-dimensional [m].
        figure: Links and joints of the bodies, if the log has them.
        signals: Parts of awareness and signals in the log, by name.
    """

    name: str
    agents: tuple[str, ...]
    colours: NDArray[np.uint8]
    shape: Shape | None
    state: tuple[tuple[str, str], ...]
    control_input: tuple[tuple[str, str], ...]
    position: tuple[int, ...]
    heading: int | None
    state_topic: str
    perception_range: float | None = None
    height: float = 0.0
    figure: Figure | None = None
    signals: Mapping[str, Signal] = field(default_factory=dict)

    def drawn(self, how: Drawn) -> Iterator[tuple[str, str]]:
        """Yield name and topic of each of `signals` that is drawn in a given way."""
        return ((name, self.topic(name)) for name, signal in self.signals.items() if signal.drawn == how)

    def topic(self, name: str) -> str:
        """Return the topic of one of `signals`."""
        return signal_topic(self.name, name, self.signals[name])

    @property
    def radius(self) -> float:
        """Radius of the smallest circle around the body; 0 for a point [m]."""
        return self.shape.radius if self.shape else 0.0

    @property
    def extent(self) -> float:
        """Radius of a circle around everything that is drawn of the body; 0 for a point [m]."""
        return self.figure.radius if self.figure else self.radius

    def positions(self, states: Array) -> Array:
        """Extract positions in space from states; (..., nx) to (..., 3) [m]."""
        return in_space(states[..., list(self.position)], self.height)

    def orientations(self, states: Array) -> Array:
        """Extract orientations from states; (..., nx) to quaternions x, y, z, w (..., 4)."""
        columns = attitude_columns([name for name, _ in self.state])
        if columns:
            return attitude(*(states[..., column] for column in columns))
        headings = self.headings(states)
        return about((0.0, 0.0, 1.0), np.zeros(states.shape[:-1]) if headings is None else headings)

    def headings(self, states: Array) -> Array | None:
        """Extract headings from states; (..., nx) to (...) [rad]; None if the state has none."""
        return None if self.heading is None else states[..., self.heading]


@dataclass(frozen=True)
class ObstacleView:
    """An entity of the environment.

    Attributes:
        name: Its name.
        shape: Its outline, seen from above.
        position: Its initial position; (3,) [m].
        heading: The initial direction of its x axis [rad].
        moves: Whether it may move; its poses are then on /world/<name>/state.
        tilt: Its initial roll and pitch, which apply until its orientation is recorded [rad].
        stands: Whether its position is on its bottom, as for a two-dimensional one; otherwise it is its centre.
        figure: Links and joints, if the log has them.
        colour: Its colour, by kind.
        movable: Whether others move it, such as a crate that is pushed; an obstacle stays, or follows a path.
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
    movable: bool = False

    @property
    def corners(self) -> Array:
        """The corners of its outline, or of the boxes of its figure, in its initial pose; (m, 3) [m]."""
        if self.figure is None:
            around = np.concatenate(outlines(self.shape.pieces))
            return placed(around, in_space(self.position[:2]), self.heading)
        own = self.figure.corners
        return self.position + rotated(self.orientations(np.full(len(own), self.heading)), own)

    def orientations(self, headings: Array) -> Array:
        """Return orientations for headings [rad], with its tilt; quaternions (x, y, z, w)."""
        return attitude(*self.tilt, headings) if any(self.tilt) else about((0.0, 0.0, 1.0), headings)

    def positions(self, values: Array) -> Array:
        """Extract positions in space from the values of /world/<name>/state; (..., columns) to (..., 3) [m]."""
        return in_space(values[..., :-1], float(self.position[2]))


@dataclass(frozen=True)
class RunView:
    """Everything in a log that is drawn.

    Attributes:
        name: The name of the scenario.
        seed: The seed of the run.
        group_views: The groups by name, in the order of the manifest.
        obstacle_views: The entities by name.
        roster: The agents and entities, in the order of `Awareness.entities`.
        duration: The planned duration of the run [s].
        surfaces: The mesh files of figures, by attachment name.
        has_space: Whether the world is spatial, even if its agents move in a plane.
        ground: Height of the ground plane [m]; None if there is none.
        quantities: Name and unit of each column of each topic, where the log has them.
        regions: The regions of the scenario, by name.
        specifications: For each specification by name, the ids of the agents that each row is about.
        spans: For each specification by name, for how long it looks ahead from its beginning and the last instant that
            counts [ns]; None for no limit.
        offered: The specifications that are offered during the run.
        windows: When specifications about a region count, for regions that do not count all the time.
        path: The log.
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
    spans: Mapping[str, tuple[int | None, int | None]] = field(default_factory=dict)
    offered: frozenset[str] = frozenset()
    windows: Mapping[str, Sequence[Window]] = field(default_factory=dict)
    path: Path | None = None

    def quantities_of(self, topic: str, field: str, width: int) -> Sequence[tuple[str, str]]:
        """Return name and unit of each column of a topic; unnamed columns are numbered, with the name of the field."""
        known = self.quantities.get(topic, ())
        return known if len(known) == width else [(f"{field} {number}", "") for number in range(width)]

    @property
    def agent_count(self) -> int:
        """Number of agents."""
        return sum(len(group_view.agents) for group_view in self.group_views.values())

    @property
    def is_spatial(self) -> bool:
        """Whether the world is spatial rather than planar."""
        return self.has_space or any(len(group_view.position) == 3 for group_view in self.group_views.values())

    @cached_property
    def place(self) -> Mapping[str, tuple[str, int]]:
        """Group and row of each agent."""
        return {
            agent: (group_view.name, row)
            for group_view in self.group_views.values()
            for row, agent in enumerate(group_view.agents)
        }

    def described(self, how: Drawn) -> Mapping[str, str]:
        """Return the description of each signal, by name, that is drawn in a given way."""
        return {
            name: group_view.signals[name].description
            for group_view in self.group_views.values()
            for name, _ in group_view.drawn(how)
        }

    @property
    def agents(self) -> Sequence[str]:
        """The ids of all agents."""
        return list(self.place)


def run_view_of(log: Log) -> RunView:
    """Read the views of a log.

    Raises:
        LogError: The log is foreign, or its manifest is damaged.
    """
    log.require_manifest()
    manifest = log.manifest
    try:
        specifications = specification_channels(log.channels)
        groups = manifest["groups"]
        colours = agent_colours([len(group["agents"]) for group in groups.values()])
        ranges = _perception_ranges(log)
        geometry = geometry_of(log.attachments, log.path)
        figures = [Figure(number, each, log.attachments) for number, each in enumerate(geometry.articulations)]
        of = {name: figures[place] for name, place in geometry.bodies.items()}
        heights = geometry.heights
        moving = [(name, bool(entity.get("path"))) for name, entity in manifest["entities"].items() if _moves(entity)]
        tints = body_colours([name for name, on_path in moving if not on_path], MOVABLE)
        tints |= body_colours([name for name, on_path in moving if on_path], SCENERY)
        return RunView(
            name=manifest["name"],
            seed=manifest["seed"],
            group_views={
                name: _group_view(
                    name,
                    group,
                    colours=colour,
                    state_topic=_state_topic(name, log),
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
            spans={name: specification_span(info) for name, info in specifications.items()},
            offered=frozenset(name for name, info in specifications.items() if info.metadata.get("offered")),
            path=log.path,
            windows=region_windows(log.channels, manifest.get("regions", {})),
            quantities={
                topic: [(each.name, each.unit) for each in columns]
                for topic, channel in log.topics.items()
                if (columns := column_quantities(channel.metadata))
            },
        )
    except (KeyError, TypeError, ValueError, AttributeError, ValidationError) as error:
        raise LogError(f"the manifest in {log.path} is damaged") from error


def in_space(positions: Array, height: float = 0.0) -> Array:
    """Extend planar positions with a height; (..., 2 or 3) to (..., 3)."""
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
        movable=_moves(entity) and not entity.get("path"),
        # A free entity records the height of its centre when it moves.
        stands=len(entity["position"]) == 2 and bool(entity.get("path") or not entity.get("moves")),
        **look,
    )


def _state_topic(name: str, log: Log) -> str:
    truth, belief = f"/world/{name}/state", f"/agents/{name}/state"
    return belief if truth not in log.topics and belief in log.topics else truth


def _perception_ranges(log: Log) -> dict[str, float]:
    """Return the range of perception of each group, if the resolved scenario has it."""
    try:
        document = read_yaml(log.attachments.get("resolved.yaml", b"")) or {}
        return {
            name: float(component["with"]["range"])
            for name, agents in document.get("agents", {}).items()
            for component in agents.get("components", {}).values()
            if component.get("use", "").startswith("perception.") and (component.get("with") or {}).get("range")
        }
    except (ValueError, TypeError, AttributeError):
        # The scenario may be of a later version; a replay works without it.
        return {}
