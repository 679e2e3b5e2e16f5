"""What is in a log, at a glance: for ``symaware inspect``."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from symaware_cli.recording.json_text import read_json
from symaware_cli.recording.reader import Log
from symaware_cli.specification.outcome import Outcome

#: An interval this much longer than the usual one of its channel is a gap.
_GAP = 1.5


@dataclass(frozen=True, slots=True)
class Gap:
    """Simulated time in which a channel that is otherwise regular has nothing.

    Attributes:
        after: The last message before it [s].
        until: The first message behind it [s].
    """

    after: float
    until: float


@dataclass(frozen=True, slots=True)
class ChannelOverview:
    """One channel.

    Attributes:
        topic: Its name.
        schema: The name of its messages.
        columns: The names of the numbers in them, with their units.
        messages: How many there are.
        size: Their size before compression, in bytes.
        start: Simulated time of the first one [s].
        end: Simulated time of the last one [s].
        rate: Messages for each second of simulated time between them [Hz].
        gaps: Where messages are missing.
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


@dataclass(frozen=True, slots=True)
class Overview:
    """A log.

    Attributes:
        path: The file.
        size: Its size in bytes.
        foreign: Whether another program wrote it.
        name: The scenario's name.
        seed: The seed of the run.
        mode: ``synchronous``.
        status: ``finished``, ``failed``, ``interrupted``, or ``broken off`` where the end is missing.
        agents: How many agents each group has.
        entities: The other bodies in the world.
        steps: How many steps were made; None where the end is missing.
        time_step: Simulated time between two steps [s].
        simulated_time: The last simulated time in the log [s].
        wall_time: Wall time that the run took, as far as is known [s].
        channels: Every channel.
        events: How often each event occurred.
        specifications: What has become of each specification.
        scenario: The attachments that hold the scenario.
        versions: What was installed.
        recovered: What it was recovered from, and what was lost then, in words; None if it was not recovered.
        damage: What is wrong with the file, in words.
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
    simulated_time: float | None
    wall_time: float | None
    channels: tuple[ChannelOverview, ...]
    events: dict[str, int]
    specifications: tuple[Outcome, ...]
    scenario: tuple[str, ...]
    versions: dict[str, str]
    recovered: str | None
    damage: str | None
    lost: bool

    def to_json(self) -> dict[str, Any]:
        """Return the overview as plain data."""
        return asdict(self)


def overview(log: Log) -> Overview:
    """Read a log once and sum it up.

    Raises:
        LogError: The file cannot be read any more.
    """
    times: dict[str, array[int]] = {topic: array("q") for topic in log.channels}
    sizes: Counter[str] = Counter()
    events: Counter[str] = Counter()
    wall_time = None
    for message in log.messages():
        topic = message.channel.topic
        times[topic].append(message.time)
        sizes[topic] += len(message.data)
        if message.channel.carries("Event"):
            events[message.decode().name] += 1
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
        simulated_time=None if log.end_time is None else log.end_time / 1e9,
        wall_time=wall_time,
        channels=tuple(_channel(log, topic, times[topic], sizes[topic]) for topic in log.channels),
        events=dict(sorted(events.items())),
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
    """Whether a channel has a message for each step: entities, unlike agents, are told of only as they change."""
    _, root, name, *_ = f"{topic}///".split("/")
    return root == "world" and name not in log.manifest.get("entities", {})


def _gaps(times: array[int]) -> tuple[Gap, ...]:
    intervals = np.diff(np.frombuffer(times, np.int64))
    if len(intervals) < 2:
        return ()
    late = np.flatnonzero(intervals > _GAP * np.median(intervals)).tolist()
    return tuple(Gap(times[index] / 1e9, times[index + 1] / 1e9) for index in late)


def _origin(recovery: Mapping[str, Any]) -> str:
    """What a log was recovered from, and before that."""
    earlier = recovery.get("earlier")
    told = f"from {recovery.get('log')}: {recovery.get('text')}"
    return f"{told}; that one {_origin(earlier)}" if isinstance(earlier, Mapping) else told


def _versions(log: Log) -> dict[str, str]:
    try:
        versions = read_json(log.attachments.get("versions.json", b"{}"))
        return {str(name): str(version) for name, version in versions.items()}
    except (ValueError, AttributeError):
        return {}
