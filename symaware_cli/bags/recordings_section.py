"""The section `recordings` of scenarios: recorded motions as bodies of the world.

Reasons: docs/decisions/0093-bags.md
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

from pydantic import Field, ValidationError, model_validator

from symaware_cli.assets import asset
from symaware_cli.bags.bag import MOST_BYTES, Bag
from symaware_cli.bags.bag_error import BagError
from symaware_cli.bags.recorded_messages import TimeSource
from symaware_cli.bags.recorded_motion import RecordedMotion, motion_in_log, motion_of_frame, motion_on_topic
from symaware_cli.core import Obstacle, WorldError
from symaware_cli.geometry import AssetPath, Number, Shape
from symaware_cli.language import Additions, ScenarioSection, Section, SectionContext


class RecordedBody(Section):
    """A body that moves as recorded."""

    shape: Shape = Field(description="The outline.")
    topic: str | None = Field(None, description="A topic of a bag with its poses, such as `/van/odom`.")
    frame: str | None = Field(None, description="Frame of the body on the topic `/tf` of a bag.")
    agent: str | None = Field(None, description="An agent or an entity of a log of SymAware.")

    @model_validator(mode="after")
    def _has_one_source(self) -> Self:
        if sum(each is not None for each in (self.topic, self.frame, self.agent)) != 1:
            raise ValueError("a recorded body has exactly one of `topic`, `frame` and `agent`")
        return self


class RecordingFile(Section):
    """A bag or a log, and the bodies that move as recorded in it."""

    file: AssetPath = Field(
        description="A bag of ROS 2 (.mcap, .db3, or a folder with a `metadata.yaml`), or a log of SymAware, below the "
        "scenario's folder or one of `assets`."
    )
    start: Number = Field(
        0.0, description="The simulated time of the first message of a bag, or of the beginning of a log [s]."
    )
    clock: TimeSource = Field(
        "stamp", description="Times to use in a bag: the stamps of the messages, or the times of recording."
    )
    in_space: bool = Field(False, description="Whether bodies have a height, for worlds in space.")
    bodies: dict[str, RecordedBody] = Field(min_length=1, description="The bodies, by the names of the new entities.")


class RecordingsSection(ScenarioSection):
    """Adds bodies that move as recorded: interpolated linearly, at rest before and after."""

    form: ClassVar[Any] = dict[str, RecordingFile]
    description: ClassVar[str] = "Recorded motions: bodies that move as in a bag of ROS 2 or a log of SymAware."

    def __init__(self) -> None:
        self._files: dict[str, bytes] = {}

    def additions(self, written: Any, context: SectionContext) -> Additions:
        """Read the recordings."""
        found: dict[str, Obstacle] = {}
        for name, recording in context.document.recordings.items():
            try:
                source = _Source(recording, context)
            except (BagError, WorldError) as error:
                context.report(f"the recording `{recording.file}` cannot be used: {error}", name, "file")
                # References to the bodies of a recording that cannot be read are not reported as further problems.
                found |= {
                    each: Obstacle(shape=body.shape, position=(0.0, 0.0)) for each, body in recording.bodies.items()
                }
                continue
            self._files |= source.files
            for each, body in recording.bodies.items():
                key = next(key for key in ("topic", "frame", "agent") if getattr(body, key) is not None)
                if each in found:
                    context.report(f"two recordings have a body `{each}`", name, "bodies", each, key=True)
                try:
                    path = source.motion(body).path(source.origin, recording.start, recording.in_space)
                    found[each] = Obstacle(shape=body.shape, path=path)
                except BagError as error:
                    context.report(f"the body `{each}` cannot be read: {error}", name, "bodies", each, key)
                    found[each] = Obstacle(shape=body.shape, position=(0.0, 0.0))
                except ValidationError as error:
                    said = "; ".join(part["msg"].removeprefix("Value error, ") for part in error.errors()[:1])
                    context.report(f"the body `{each}` cannot move as recorded: {said}", name, "bodies", each)
                    found[each] = Obstacle(shape=Shape.model_validate({"circle": {"radius": 1.0}}), position=(0.0, 0.0))
        return Additions(found)

    def files(self, built: Any) -> Mapping[str, bytes]:
        """Return the files of the recordings."""
        return self._files


class _Source:
    """An open recording.

    Attributes:
        origin: The time of the recording that corresponds to its `start` [ns].
        files: The files of the recording.
    """

    def __init__(self, recording: RecordingFile, context: SectionContext) -> None:
        self._clock = recording.clock
        self._log: Path | None = None
        self._bag: Bag | None = None
        self.origin = 0
        if all(body.agent is not None for body in recording.bodies.values()):
            self._log = asset.find(recording.file, context.folders)
            size = self._log.stat().st_size
            if size > MOST_BYTES:
                raise BagError(f"it has {size / 2**20:.0f} MiB, and at most {MOST_BYTES >> 20} are read")
            self.files: Mapping[str, bytes] = {recording.file: self._log.read_bytes()}
        else:
            self._bag = Bag(recording.file, context.folders)
            self.origin, self.files = self._bag.start, self._bag.contents

    def motion(self, body: RecordedBody) -> RecordedMotion:
        """Return the motion of a body."""
        if body.topic is not None and self._bag is not None:
            return motion_on_topic(self._bag, body.topic, self._clock)
        if body.frame is not None and self._bag is not None:
            return motion_of_frame(self._bag, body.frame, self._clock)
        if body.agent is not None and self._log is not None:
            return motion_in_log(self._log, body.agent)
        raise BagError("bodies of a bag have a `topic` or a `frame`, and all those of a log an `agent`")
