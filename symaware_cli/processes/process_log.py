"""The logs that the processes of one run wrote, checked against each other before they are merged."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from symaware_cli.log import Log, LogError, open_log, read_json

_RESOLVED = "resolved.yaml"
_VERSIONS = "versions.json"
#: The most missing agents that are named.
_NAMED = 12


@dataclass(frozen=True, slots=True)
class ProcessLog:
    """The log of one process of a run.

    Attributes:
        log: The log.
        name: The name of the process; empty if the log is of a whole run.
        host: Whether the process was the host.
        agents: The agents that it ran.
        whole: Whether the log is of a whole run instead of a part.
    """

    log: Log
    name: str
    host: bool
    agents: tuple[str, ...]
    whole: bool

    @property
    def end_missing(self) -> bool:
        """Whether the end of the log is missing, as after the process was killed."""
        return bool(self.log.damage and self.log.damage.end_missing)

    @property
    def start(self) -> int | None:
        """Simulated time at which its agents begin in this log, ns; a process that joined late started before that."""
        topics = [topic for topic in self.log.channels if topic.startswith("/agents/")]
        first = next(iter(self.log.messages(topics)), None) if topics and not self.host else None
        return self.log.start_time if first is None else first.time

    @property
    def continues(self) -> bool:
        """Whether the process restored the state of an earlier one: it repeats what that did since then."""
        source = f"processes.{self.name}"
        return any((event.name, event.source) == ("restored", source) for event in self.log.events())

    def describe(self) -> dict[str, Any]:
        """Return a description for the manifest of the merged log; times in ns."""
        return {
            "name": self.name,
            "host": self.host,
            "agents": list(self.agents),
            "start": self.start,
            "end": self.log.end_time,
            "end_missing": self.end_missing,
        }


def open_process_logs(paths: Iterable[str | os.PathLike[str]]) -> list[ProcessLog]:
    """Open the logs of the processes of one run.

    A process that died and came back has left several logs, one after the other.

    Args:
        paths: The files, in any order. A single one may be the log of a whole run.

    Returns:
        The parts: the host's, then the others by name and by the time at which they begin.

    Raises:
        LogError: One of them cannot be read or is no part, or they are not of one run: the scenario, the seed or the
            version differs, the host's part is missing or there are two, or an agent ran in two at the same time.
    """
    parts = sorted((_part(open_log(path)) for path in paths), key=_order)
    for one, other in combinations(parts, 2):
        if one.log.path.samefile(other.log.path):
            raise LogError(f"{one.log.path} is named twice: name each part once")
    _require_host(parts)
    for other in parts[1:]:
        _require_one_run(parts[0].log, other.log)
    for one, other in combinations(parts, 2):
        _require_one_place(one, other)
    return parts


def missing_agents(parts: Sequence[ProcessLog]) -> list[str]:
    """The agents of a run that are in none of its parts, in the order of the manifest."""
    present = {agent for part in parts for agent in part.agents}
    return [agent for agents in parts[0].log.agents.values() for agent in agents if agent not in present]


def missing_in_words(agents: Sequence[str]) -> str:
    """Describe the agents that no part ran, for a message."""
    named = agents if len(agents) <= _NAMED else [*agents[: _NAMED - 1], f"{len(agents) - _NAMED + 1} more"]
    listed = f"{', '.join(named[:-1])} and {named[-1]}" if len(named) > 1 else "".join(named)
    return f"no part ran {listed}, so what they knew and did is missing: name the logs of all processes"


def _part(log: Log) -> ProcessLog:
    log.require_manifest(": leave it out")
    part = log.manifest.get("part")
    if part is None:
        everybody = tuple(agent for agents in log.agents.values() for agent in agents)
        return ProcessLog(log, "", host=True, agents=everybody, whole=True)
    return ProcessLog(log, part["name"], part["host"], tuple(part["agents"]), whole=False)


def _order(part: ProcessLog) -> tuple[bool, str, int, str]:
    start = part.start
    return not part.host, part.name, -1 if start is None else start, str(part.log.path)


def _require_host(parts: Sequence[ProcessLog]) -> None:
    whole = next((part for part in parts if part.whole), None)
    if whole and len(parts) > 1:
        raise LogError(f"{whole.log.path} is the log of a whole run and no part of one: leave it out")
    hosts = [part.log.path for part in parts if part.host]
    if not hosts:
        raise LogError(f"the host's part is missing: name it beside {parts[0].log.path}, which is a member's")
    if len(hosts) > 1:
        raise LogError(f"{hosts[0]} and {hosts[1]} are both a host's part: leave out that of another run")


def _require_one_run(log: Log, other: Log) -> None:
    def differ(what: str) -> LogError:
        return LogError(f"{log.path} and {other.path} are not of one run: {what}")

    for key, what in (("name", "scenarios are called"), ("seed", "seeds are")):
        first, second = (each.manifest.get(key) for each in (log, other))
        if first != second:
            raise differ(f"their {what} {first} and {second}")
    # What a damaged log has lost cannot be compared.
    written = [_attachment(each, _RESOLVED) for each in (log, other)]
    if None not in written and written[0] != written[1]:
        raise differ(f"their scenarios ({_RESOLVED}) differ")
    first, second = (_version(each) for each in (log, other))
    if first and second and first != second:
        raise differ(f"SymAware {first} and {second} wrote them")
    if log.agents != other.agents or log.manifest.get("roster") != other.manifest.get("roster"):
        raise differ("their manifests do not name the same agents and entities")


def _require_one_place(one: ProcessLog, other: ProcessLog) -> None:
    """Check that no agent is in two parts at the same time.

    An agent may move to another process when its own has died. A process that continues from a stored state repeats the
    steps of its predecessor since then, with the same messages; such an overlap is permitted.
    """
    spans = [(part.start, part.log.end_time) for part in (one, other)]
    start, end = (max(span[0] or 0 for span in spans), min(span[1] or 0 for span in spans))
    agent = next((agent for agent in one.agents if agent in other.agents), None)
    if agent is not None and start < end and not (one.name == other.name and (one.continues or other.continues)):
        raise LogError(
            f"{agent} is in both {one.log.path} and {other.log.path} from {start / 1e9:.9g} s to {end / 1e9:.9g} s: "
            "leave out the one that is not of this run"
        )


def _attachment(log: Log, name: str) -> bytes | None:
    """One attachment, read alone because others may be large; None if it is missing or damaged."""
    return next((record.data for record in log.attachment_records(name)), None)


def _version(log: Log) -> str | None:
    try:
        version = read_json(_attachment(log, _VERSIONS) or b"{}").get("symaware-cli")
    except (ValueError, AttributeError):
        return None
    return str(version) if version else None
