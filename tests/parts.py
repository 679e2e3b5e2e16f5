"""Logs of whole runs taken apart, as if several processes had shared the run and each had recorded its part."""

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from symaware_cli.log import others_message, wire
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.log_message import LogMessage
from symaware_cli.log.reader import Log, open_log
from symaware_cli.log.writer import LogWriter

Keep = Callable[[LogMessage], bool]

_FLUSH_INTERVAL = 250_000_000
"""Simulated time that is lost at most when a process is killed, ns."""


def of_rows(message: LogMessage, wanted: Sequence[int], count: int) -> bytes | None:
    """The content of a message of a group of `count` about some rows; None without any."""
    content = message.decode()
    if isinstance(content, others_message.Awareness) and content.world:
        return message.data
    if isinstance(content, v1.Image):
        return message.data if content.row in wanted else None
    there = range(count) if content.rows is None or not len(content.rows) else [int(row) for row in content.rows]
    places = [place for place, row in enumerate(there) if row in wanted]
    rows = [there[place] for place in places]
    if not rows:
        return None
    match content:
        case wire.Rows():
            return wire.encode_rows(content.values[places], rows)
        case wire.SeriesRows():
            series = list(content) or [(content.times, content.values)] * count
            chosen = [series[place] for place in places]
            times = np.concatenate([times for times, _ in chosen])
            values = np.concatenate([values for _, values in chosen])
            return wire.encode_series(times, values, [len(values) for _, values in chosen], rows)
        case others_message.Awareness():
            return _awareness(content, places, rows, len(there))
        case v1.Knowledge():
            known = v1.Knowledge(rows=rows, values=[content.values[place] for place in places])
            return known.SerializeToString(deterministic=True)
        case v1.Scan():
            kept = v1.Scan()
            kept.CopyFrom(content)
            for field in ("rows", "distances", "poses"):
                kept.ClearField(field)
            kept.rows.extend(rows)
            for place in places:
                kept.distances.extend(np.array(content.distances).reshape(len(there), -1)[place])
                kept.poses.extend(np.array(content.poses).reshape(len(there), -1)[place])
            return kept.SerializeToString(deterministic=True)
    raise AssertionError(type(content))


def _awareness(content: others_message.Awareness, places: Sequence[int], rows: Sequence[int], count: int) -> bytes:
    lengths = np.broadcast_to(content.lengths, count).astype(int)
    sizes = np.broadcast_to(content.columns, len(content.entities)).astype(int)
    of = np.repeat(np.arange(count), lengths)
    known = np.isin(of, places)
    # Zeros stand for nothing where the message says something of others.
    covariances = content.covariances[np.repeat(known, sizes**2)] if len(content.covariances) else np.empty(0)
    return others_message.encode_awareness(
        lengths[places],
        content.entities[known],
        sizes[known],
        content.values[np.repeat(known, sizes)],
        rows,
        covariances=covariances if covariances.any() else (),
        ages=content.ages[known] if len(content.ages) and content.ages[known].any() else (),
    )


def group_of(topic: str) -> str | None:
    """The group that a topic is about, as an agent of it sees things."""
    return topic.split("/")[2] if topic.startswith("/agents/") else None


def write_part(
    log: Log,
    path: Path,
    name: str,
    agents: Iterable[str],
    *,
    host: bool = False,
    keep: Keep | None = None,
    start: int | None = None,
    until: int | None = None,
    end: str = "finish",
    begun: bool = False,
) -> Path:
    """Write the part of a process.

    Args:
        log: The log of the whole run.
        path: The path of the part.
        name: The name of the process.
        agents: The agents that run there.
        host: Whether it is the host, which records true states.
        keep: The messages that it records beside those of its agents; by default the host all, and a member events,
            contacts, messages and the speed of its machine.
        start: The first simulated time, ns.
        until: The first simulated time that is not recorded any more, ns.
        end: `finish`, or `kill` for a process that is killed.
        begun: Whether it records that the run has started whenever it begins itself, as processes do.
    """
    agents = list(agents)
    members = {group: [row for row, id in enumerate(ids) if id in agents] for group, ids in log.agents.items()}
    keep = keep or (lambda message: host or not message.channel.topic.startswith("/world/"))
    writer = LogWriter(path)
    data: bytes | None
    for record in log.attachment_records():
        data = record.data
        if record.name == "manifest.json":
            part = {"name": name, "host": host, "agents": agents}
            data = json.dumps({**log.manifest, "part": part}, indent=1).encode()
        writer.attach(record.name, record.media_type, data)
    numbers = {"/timing": writer.timing}
    for channel in log.index.channels.values():
        group = group_of(channel.topic)
        wanted = members[group] if group else host or not channel.topic.startswith("/world/")
        if wanted and channel.topic != "/timing":
            schema = log.channels[channel.topic].schema.removeprefix("symaware.v1.")
            numbers[channel.topic] = writer.channel(channel.topic, schema, channel.metadata)
    if begun:
        started = v1.Event(name="started", source="run").SerializeToString()
        writer.add(numbers["/events"], 0, started)
    flushed = 0
    for message in log.messages(numbers, start, until):
        if message.time - flushed >= _FLUSH_INTERVAL:
            writer.flush()
            flushed = message.time
        group = group_of(message.channel.topic)
        if group and set(members[group]) != set(range(len(log.agents[group]))):
            data = of_rows(message, members[group], len(log.agents[group]))
        else:
            data = message.data
        if data is not None and (group or keep(message)):
            writer.add(numbers[message.channel.topic], message.time, data)
    if end == "finish":
        writer.finish(log.outcome or {})
    else:
        writer.flush()
        writer._file.close()
    return path


def split(path: Path, folder: Path, shares: Mapping[str, Sequence[str]]) -> list[Path]:
    """Take a log apart: the host keeps the agents that no share names."""
    log = open_log(path)
    away = {agent for agents in shares.values() for agent in agents}
    rest = [agent for agents in log.agents.values() for agent in agents if agent not in away]
    parts = [write_part(log, folder / "host.mcap", "host", rest, host=True)]
    return parts + [write_part(log, folder / f"{name}.mcap", name, agents) for name, agents in shares.items()]


def contents(log: Log) -> dict[str, Counter[Any]]:
    """The content of every channel except /timing: of a group by rows, otherwise the messages."""
    found: defaultdict[str, Counter[Any]] = defaultdict(Counter)
    for topic in log.channels:
        found[topic].update()
    for message in log.messages(log.channels.keys() - {"/timing"}):
        group = group_of(message.channel.topic)
        entries = found[message.channel.topic]
        if group is None:
            entries[message.time, message.data] += 1
            continue
        count = len(log.agents[group])
        for row in range(count):
            data = of_rows(message, [row], count)
            if data is not None:
                entries[message.time, row, data] += 1
    return dict(found)
