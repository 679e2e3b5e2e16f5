"""Overview of a log: channels, rates, gaps, events and outcome, for ``symaware inspect``."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.json_text import read_json
from symaware_cli.log.names import INPUTS
from symaware_cli.log.reader import Log
from symaware_cli.world import record

if TYPE_CHECKING:
    from symaware_cli.specification import Outcome

#: An interval longer than the median interval of its channel by this factor is a gap.
_GAP = 1.5


@record
class Gap:
    """An interval of simulated time in which an otherwise regular channel has no message.

    Attributes:
        after: Time of the last message before it [s].
        until: Time of the first message after it [s].
    """

    after: float
    until: float


@record
class ChannelOverview:
    """Overview of a channel.

    Attributes:
        topic: Its topic.
        schema: The type of its messages.
        columns: Names and units of the columns of its messages.
        messages: Number of messages.
        size: Total size of the messages before compression, bytes.
        start: Simulated time of the first message [s].
        end: Simulated time of the last message [s].
        rate: Messages per second of simulated time between these [Hz].
        gaps: Intervals in which messages are missing.
    """

    topic: str
    schema: str
    columns: tuple[str, ...]
    messages: int
    size: int
    start: float | None
    end: float | None
    rate: float | None
    gaps: tuple[Gap, ...]


@record
class Overview:
    """Overview of a log.

    Attributes:
        path: The file.
        size: Its size in bytes.
        foreign: Whether another program wrote it.
        name: The scenario's name.
        seed: The seed of the run.
        mode: ``synchronous`` or ``asynchronous``.
        status: ``finished``, ``failed``, ``interrupted``, or ``broken off`` if the end is missing.
        agents: Number of agents of each group.
        entities: The other bodies in the world.
        steps: Number of steps completed; None if the end is missing.
        time_step: Simulated time between two steps [s].
        start_time: The time of the first message [s]: of the simulation, or of the clock of another program.
        simulated_time: The last simulated time in the log [s]; the time of the last message in one of another program.
        wall_time: Wall time of the run, if known [s].
        channels: All channels.
        events: Number of occurrences of each event; a contact has one at its beginning and one at its end.
        contacts: Number of contacts that began, as in the summary of a run; None if they were not recorded.
        specifications: The outcome of each specification.
        scenario: The attachments that hold the scenario.
        versions: The versions of the installed packages.
        recovered: The log that it was recovered from and the loss, as text; None if it was not recovered.
        damage: A description of the damage of the file.
        lost: Whether recorded data cannot be read.
    """

    path: str
    size: int
    foreign: bool
    name: str | None
    seed: int | None
    mode: str | None
    status: str
    agents: dict[str, int]
    entities: tuple[str, ...]
    steps: int | None
    time_step: float | None
    start_time: float | None
    simulated_time: float | None
    wall_time: float | None
    channels: tuple[ChannelOverview, ...]
    events: dict[str, int]
    contacts: int | None
    specifications: tuple[Outcome, ...]
    scenario: tuple[str, ...]
    versions: dict[str, str]
    recovered: str | None
    damage: str | None
    lost: bool

    @property
    def span(self) -> str | None:
        """The interval with messages, in words; None if there are none."""
        if self.start_time is None or self.simulated_time is None:
            return None
        # Shortest digits: clocks of other programs count from 1970.
        return f"{self.simulated_time - self.start_time:.9g} s, from {self.start_time!r} s to {self.simulated_time!r} s"

    def to_json(self) -> dict[str, Any]:
        """Return the overview as plain data."""
        return asdict(self)


def overview_of(log: Log) -> Overview:
    """Read a log once and summarise it.

    Raises:
        LogError: The file can no longer be read.
    """
    times: dict[str, array[int]] = {topic: array("q") for topic in log.channels}
    sizes: Counter[str] = Counter()
    events: Counter[str] = Counter()
    contacts = 0
    wall_time = None
    for message in log.messages():
        topic = message.channel.topic
        times[topic].append(message.time)
        sizes[topic] += len(message.data)
        if topic != INPUTS and message.channel.carries("Event"):
            events[message.decode().name] += 1
        elif message.channel.carries("Contact"):
            contacts += message.decode().stage == v1.Contact.BEGIN
        elif message.channel.carries("Timing"):
            wall_time = message.decode().wall_time
    damage = log.verify()
    outcome = log.outcome or {}
    manifest = log.manifest
    time_step = manifest.get("time_step")
    return Overview(
        path=str(log.path),
        size=log.size,
        foreign=log.foreign,
        name=manifest.get("name"),
        seed=manifest.get("seed"),
        mode=manifest.get("mode"),
        status=outcome.get("status", "unknown" if log.foreign else "broken off"),
        agents={name: len(agents) for name, agents in log.agents.items()},
        entities=tuple(manifest.get("entities", {})),
        steps=outcome.get("steps"),
        time_step=None if time_step is None else time_step / 1e9,
        start_time=None if log.start_time is None else log.start_time / 1e9,
        simulated_time=None if log.end_time is None else log.end_time / 1e9,
        wall_time=wall_time,
        channels=tuple(_channel(log, topic, times[topic], sizes[topic]) for topic in log.channels),
        events=dict(sorted(events.items())),
        contacts=contacts if any(channel.carries("Contact") for channel in log.channels.values()) else None,
        specifications=log.outcomes,
        scenario=tuple(name for name in log.attachments if name.startswith("scenario/") or name == "resolved.yaml"),
        versions=_versions(log),
        recovered=_origin(log.recovery) if log.recovery else None,
        damage=str(damage) if damage else None,
        lost=bool(damage and damage.lost),
    )


def _channel(log: Log, topic: str, times: array[int], size: int) -> ChannelOverview:
    info = log.channels[topic]
    names, units = (info.metadata.get(key, "") for key in ("columns", "units"))
    columns = tuple(f"{name} [{unit}]" for name, unit in zip(names.split(","), units.split(","), strict=False) if name)
    span = (times[-1] - times[0]) / 1e9 if len(times) > 1 else 0.0
    return ChannelOverview(
        topic=topic,
        schema=info.schema,
        columns=columns,
        messages=len(times),
        size=size,
        start=times[0] / 1e9 if times else None,
        end=times[-1] / 1e9 if times else None,
        rate=(len(times) - 1) / span if span else None,
        gaps=_gaps(times) if _is_regular(log, topic) else (),
    )


def _is_regular(log: Log, topic: str) -> bool:
    """Whether a channel has a message for each step; entities, unlike agents, are recorded only when they change."""
    _, root, name, *_ = f"{topic}///".split("/")
    return root == "world" and name not in log.manifest.get("entities", {})


def _gaps(times: array[int]) -> tuple[Gap, ...]:
    intervals = np.diff(np.frombuffer(times, np.int64))
    if len(intervals) < 2:
        return ()
    late = np.flatnonzero(intervals > _GAP * np.median(intervals)).tolist()
    return tuple(Gap(times[index] / 1e9, times[index + 1] / 1e9) for index in late)


def _origin(recovery: Mapping[str, Any]) -> str:
    """Describe the log that a log was recovered from, including earlier recoveries."""
    earlier = recovery.get("earlier")
    told = f"from {recovery.get('log')}: {recovery.get('text')}"
    return f"{told}; that one {_origin(earlier)}" if isinstance(earlier, Mapping) else told


def _versions(log: Log) -> dict[str, str]:
    try:
        versions = read_json(log.attachments.get("versions.json", b"{}"))
        return {str(name): str(version) for name, version in versions.items()}
    except (ValueError, AttributeError):
        return {}
