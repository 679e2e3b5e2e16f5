"""Poses and scripted paths: the position and motion of a body over time.

Lengths are metres, times seconds, angles radians.
"""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise
from typing import NamedTuple

from pydantic import Field, model_validator

from symaware_cli.geometry.shape import Number, Position, StrictModel


class Pose(NamedTuple):
    """The position, heading and velocities of a body.

    Attributes:
        position: Coordinates [m]; 2 or 3 of them.
        heading: Heading [rad].
        velocity: Velocity of the position [m/s], as many coordinates.
        turn_rate: Rate of the heading [rad/s].
    """

    position: tuple[float, ...]
    heading: float = 0.0
    velocity: tuple[float, ...] = (0.0, 0.0)
    turn_rate: float = 0.0


class ScriptedPath(StrictModel):
    """The positions of a moving obstacle at given times, interpolated linearly.

    Before the first time it rests at the first position. After the last it rests at the last, or starts again.
    """

    times: tuple[Number, ...] = Field(
        json_schema_extra={"minItems": 2}, description="Simulated times, ascending [s]; at least 2."
    )
    positions: tuple[Position, ...] = Field(
        json_schema_extra={"minItems": 2}, description="The position at each time: [x, y] or [x, y, z] [m]."
    )
    headings: tuple[Number, ...] | None = Field(
        None, description="The heading at each time [rad]; without them the obstacle keeps its `heading`."
    )
    repeat: bool = Field(
        False,
        description="Repeat the path for ever; if the last position is not the first, the obstacle jumps.",
    )

    @model_validator(mode="after")
    def _fits_together(self) -> ScriptedPath:
        if len(self.times) < 2:
            raise ValueError(f"a path has at least 2 times, not {len(self.times)}")
        for one, other in pairwise(self.times):
            if other - one < 1e-9:
                raise ValueError(f"the times do not ascend: {other:.10g} s follows {one:.10g} s")
        for name, values in (("positions", self.positions), ("headings", self.headings)):
            if values is not None and len(values) != len(self.times):
                raise ValueError(f"there are {len(values)} {name} for {len(self.times)} times")
        if len({len(position) for position in self.positions}) > 1:
            raise ValueError("some positions have 2 coordinates, others 3")
        return self

    def pose(self, time: float, heading: float = 0.0) -> Pose:
        """Return the pose at a time, and the velocities from there on.

        Args:
            time: Simulated time [s].
            heading: Its heading if the path states none [rad].
        """
        times, positions, headings = self.times, self.positions, self.headings
        if self.repeat and time > times[-1]:
            time = times[0] + (time - times[0]) % (times[-1] - times[0])
        elif self.repeat and time == times[-1]:
            time = times[0]
        after = bisect_right(times, time)
        if after in (0, len(times)):
            end = 0 if after == 0 else -1
            still = (0.0,) * len(positions[end])
            return Pose(positions[end], headings[end] if headings else heading, still)
        before, span = after - 1, times[after] - times[after - 1]
        share = (time - times[before]) / span
        change = [other - one for one, other in zip(positions[before], positions[after], strict=True)]
        position = tuple(one + share * by for one, by in zip(positions[before], change, strict=True))
        velocity = tuple(by / span for by in change)
        if headings is None:
            return Pose(position, heading, velocity)
        turn = headings[after] - headings[before]
        return Pose(position, headings[before] + share * turn, velocity, turn / span)

    def course(self, time: float, span: float, heading: float = 0.0) -> Pose:
        """Return the pose at a time, and the mean velocities over a span of time from there on.

        If the path starts again in between and jumps, the velocities are those before the jump.

        Args:
            time: Simulated time [s].
            span: Duration [s].
            heading: Its heading if the path states none [rad].
        """
        now, then = self.pose(time, heading), self.pose(time + span, heading)
        if self._jumps and self._round(time) < self._round(time + span):
            return now
        velocity = tuple((after - before) / span for before, after in zip(now.position, then.position, strict=True))
        return Pose(now.position, now.heading, velocity, (then.heading - now.heading) / span)

    @property
    def _jumps(self) -> bool:
        """Whether its start differs from its end in position or heading, so that a repetition jumps."""
        turned = self.headings is not None and self.headings[0] != self.headings[-1]
        return self.repeat and (turned or self.positions[0] != self.positions[-1])

    def _round(self, time: float) -> int:
        """Return the number of repetitions before a time."""
        return int(max(0.0, time - self.times[0]) // (self.times[-1] - self.times[0]))
