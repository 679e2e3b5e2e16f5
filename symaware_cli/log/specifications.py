"""Records specifications during a run, and reads them back from a log."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.index import ChannelInfo
from symaware_cli.log.logged_events import LoggedEvent
from symaware_cli.log.wire import CODE, FLOAT, INDEX, TIME, packed
from symaware_cli.world import record

if TYPE_CHECKING:
    from symaware_cli.log.writer import LogWriter
    from symaware_cli.specification import Outcome, SpecificationMonitor

#: The topic of a specification.
TOPIC = "/specifications/{}"

#: Maximum number of robustness values in a message.
_MOST = 8_192

#: The codes of the verdicts 0, 1 and -1, which counts from the end, and of undecided verdicts of linear temporal logic
#: with a presumption.
_CODES = np.array([0, 1, 2], np.uint8)
_PRESUMED_CODES = {1: 4, -1: 5}
#: No rows.
_NOWHERE = np.empty(0, bool)
#: The code of a row that has not begun.
_NOT_BEGUN = 3
#: The verdict and the presumption of each code.
_DECODED = {0: (0, 0), 1: (1, 0), 2: (-1, 0), _NOT_BEGUN: (0, 0), 4: (0, 1), 5: (0, -1)}


class SpecificationRecorder:
    """Records specifications: verdicts and intervals that changed, and robustness that became known."""

    def __init__(self, writer: LogWriter, monitors: Iterable[SpecificationMonitor]) -> None:
        """Open a channel for each specification.

        Args:
            writer: The log.
            monitors: The monitors of the specifications.
        """
        self._writer = writer
        self._channels: dict[str, int] = {}
        self._last: dict[str, tuple[NDArray[Any], ...]] = {}
        self._changes: dict[str, int] = {}
        for number, monitor in enumerate(monitors):
            specification = monitor.specification
            rows = [specification.scope.agents(row) for row in range(specification.scope.rows)]
            metadata = {
                "count": str(len(rows)),
                "formula": specification.text,
                "number": str(number),
                "of": specification.of,
                "each": specification.each or "",
                "predicates": json.dumps([atom.text for atom in specification.formulation.atoms]),
                "rows": json.dumps(rows),
                "start": str(specification.start),
                "end": "" if specification.end is None else str(specification.end),
            }
            horizon = None if specification.automaton is not None else specification.formulation.horizon
            if horizon is not None:
                metadata["horizon"] = str(horizon * specification.formulation.time_step)
            if specification.offer is not None:
                metadata["offered"] = json.dumps({"epsilon": specification.offer.epsilon})
            topic = TOPIC.format(specification.name)
            self._channels[specification.name] = writer.channel(topic, "Specification", metadata)

    def record(self, monitor: SpecificationMonitor, now: int) -> None:
        """Record the changes of a specification at an instant, in nanoseconds."""
        name = monitor.specification.name
        channel, last = self._channels[name], self._last.get(name)
        if monitor.specification.offer is None and self._changes.get(name) == monitor.changes:
            return
        self._changes[name] = monitor.changes
        # What begins by itself has one instance, whose robustness is the first that is known of its row.
        is_repeated = not monitor.begins and monitor.specification.offer is None
        state: tuple[NDArray[Any], ...] = _codes(monitor), monitor.lower, monitor.upper
        if is_repeated:
            state = *state, monitor.settled.copy()
        changed = None if last is None else _changed(state, last)
        count = len(state[0]) if changed is None else np.count_nonzero(changed)
        if count:
            self._last[name] = state
            rows = None if changed is None or count == len(changed) else np.flatnonzero(changed)
            codes, lower, upper, *settled = state if rows is None else (each[rows] for each in state)
            head = packed(2, codes, CODE)
            body = _field(1, rows, INDEX)
            if monitor.specification.interval:
                body += packed(3, lower, FLOAT) + packed(4, upper, FLOAT)
            if settled:
                body += packed(8, settled[0], FLOAT)
            self._writer.add(channel, now, head + body)
        for exact in monitor.take_exact():
            rows = None if len(exact.rows) == len(monitor.verdicts) else exact.rows
            some = max(1, _MOST // len(exact.rows))
            for first in range(0, len(exact.times), some):
                part = slice(first, first + some)
                times, values = packed(5, exact.times[part], TIME), packed(7, exact.values[part].ravel(), FLOAT)
                self._writer.add(channel, now, times + _field(6, rows, INDEX) + values)


def _codes(monitor: SpecificationMonitor) -> NDArray[np.uint8]:
    """The code of each row's verdict."""
    codes = _CODES[monitor.verdicts]
    if np.count_nonzero(monitor.begun) < len(codes):
        codes[~monitor.begun] = _NOT_BEGUN
    presumptions = monitor.presumptions
    if presumptions is not None:
        for verdict, code in _PRESUMED_CODES.items():
            codes[(codes == _CODES[0]) & (presumptions == verdict)] = code
    return codes


def _changed(state: Sequence[NDArray[Any]], last: Sequence[NDArray[Any]]) -> NDArray[np.bool_]:
    """Whether any of some arrays changed, for each row; none if no row did."""
    changed = None
    for mine, its in zip(state, last, strict=True):
        # Comparing bytes takes a fifth of the time of comparing arrays of few rows.
        if mine is not its and mine.tobytes() != its.tobytes():
            differing = mine != its
            if math.isnan(mine.item(mine.argmin())):
                differing &= ~(np.isnan(mine) & np.isnan(its))
            changed = differing if changed is None else changed | differing
    return _NOWHERE if changed is None else changed


def _field(number: int, values: ArrayLike | None, dtype: np.dtype[Any]) -> bytes:
    return b"" if values is None else packed(number, values, dtype)


def specification_rows(channels: Mapping[str, ChannelInfo]) -> dict[str, tuple[tuple[str, ...], ...]]:
    """Return, for each specification of a log by name, the ids of the agents that each row is about.

    Raises:
        ValueError: The metadata of a channel are invalid.
    """
    return {name: _rows(info.metadata) for name, info in specification_channels(channels).items()}


def specification_channels(channels: Mapping[str, ChannelInfo]) -> dict[str, ChannelInfo]:
    """Return the channels of specifications by name, in the scenario's order."""
    found = [info for info in channels.values() if info.carries("Specification")]
    found.sort(key=lambda info: (len(number := info.metadata.get("number", "")), number, info.topic))
    return {info.topic.rpartition("/")[2]: info for info in found}


def specification_span(channel: ChannelInfo) -> tuple[int | None, int | None]:
    """Return the time that a specification looks ahead from its beginning, and the last instant that counts.

    Returns:
        Both in nanoseconds; None where the end of the run is the limit, or in older logs.

    Raises:
        ValueError: The metadata of the channel are invalid.
    """
    horizon, end = channel.metadata.get("horizon"), channel.metadata.get("end")
    return int(horizon) if horizon else None, int(end) if end else None


def _rows(metadata: Mapping[str, str]) -> tuple[tuple[str, ...], ...]:
    found = json.loads(metadata.get("rows", ""))
    if not isinstance(found, list) or not all(isinstance(each, list) for each in found):
        raise ValueError("the rows are not lists of ids")
    if str(len(found)) != metadata.get("count") or not all(isinstance(id, str) for each in found for id in each):
        raise ValueError("the number of lists of ids differs from the stated number of rows")
    return tuple(map(tuple, found))


@record
class LoggedSpecification:
    """A specification in a log.

    Attributes:
        name: Its name.
        formula: Its formula.
        of: Its subject: ``truth`` or ``belief``.
        each: The group whose agents each have a verdict; empty for pairs and the world.
        predicates: The predicates of the formula.
        rows: The ids of the agents that each row is about.
        start: The instant that verdicts are about, ns.
        end: The last instant that counts, ns; None for the end of the run.
        times: The instants at which verdicts or intervals changed, ns; shape (k,).
        verdicts: 1 satisfied, -1 violated, 0 undecided; shape (k, rows).
        presumptions: 1 or -1, the verdict if the run ended then, for an undecided formula of linear temporal logic; 0
            for others; shape (k, rows).
        begun: Which rows count: those that were ever present, or have accepted the offer; shape (rows,).
        lower: Lower bound of the robustness; shape (k, rows), minus infinity where not computed.
        upper: Upper bound of the robustness; shape (k, rows).
        settled: The exact robustness that the verdict of each row is about, the least of its instances; NaN where that
            of any is unknown; shape (rows,).
        instants: The instants whose exact robustness is known, ns, ascending; shape (m,).
        robustness: The exact robustness, NaN for rows where it is unknown; shape (m, rows).
    """

    name: str
    formula: str
    of: str
    each: str
    predicates: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    start: int
    end: int | None
    times: NDArray[np.int64]
    verdicts: NDArray[np.int8]
    presumptions: NDArray[np.int8]
    begun: NDArray[np.bool_]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    settled: NDArray[np.float64]
    instants: NDArray[np.int64]
    robustness: NDArray[np.float64]

    @property
    def verdict(self) -> NDArray[np.int8]:
        """The last verdict of each row; shape (rows,)."""
        return self.verdicts[-1] if len(self.verdicts) else np.zeros(len(self.rows), np.int8)


class _Message(Protocol):
    @property
    def time(self) -> int: ...

    def decode(self) -> v1.Specification: ...


def outcome_in(logged: LoggedSpecification, events: Iterable[LoggedEvent]) -> Outcome:
    """Return the outcome of a specification, as recorded.

    Args:
        logged: The specification.
        events: The events of the log.

    Raises:
        ValueError: The data of an event are invalid.
    """
    from symaware_cli.specification import REJECTED, Decision, outcome_of

    begun = np.flatnonzero(logged.begun)
    told = [event for event in events if event.source == f"specifications.{logged.name}"]
    outcome = outcome_of(
        logged.name,
        logged.formula,
        lambda place: logged.rows[int(begun[place])],
        logged.verdict[begun],
        logged.settled[begun],
        logged.upper[-1][begun] if len(logged.upper) else np.empty(0),
        [Decision.from_json(event.data) for event in told if event.name in ("satisfied", "violated")],
        _presumption(logged, begun),
    )
    rejected = [str(event.data.get("reason", "")) for event in told if event.name == REJECTED]
    return outcome.rejected(rejected[-1]) if rejected else outcome


def _presumption(logged: LoggedSpecification, begun: NDArray[np.intp]) -> int | None:
    """Return the worst verdict of some rows if the run ended with the log; None if unknown."""
    if not len(logged.verdicts) or not len(begun) or not logged.presumptions[:, begun].any():
        return None
    verdicts = logged.verdicts[-1][begun]
    return int(np.where(verdicts == 0, logged.presumptions[-1][begun], verdicts).min())


def verdicts_of(content: v1.Specification) -> tuple[list[int] | None, list[int], list[float]]:
    """Return the verdicts in a message of a specification.

    Returns:
        The rows that it is about, None for all; their verdicts, 1 satisfied, -1 violated, 0 undecided; and upper bounds
        of their robustness. The latter are empty if nothing changed.
    """
    return list(content.rows) or None, [_DECODED[code][0] for code in content.verdicts], list(content.upper)


def begun_in(content: v1.Specification) -> list[bool]:
    """Return which rows of a message of a specification count; empty if nothing changed."""
    return [code != _NOT_BEGUN for code in content.verdicts]


def logged(name: str, metadata: Mapping[str, str], messages: Iterable[_Message]) -> LoggedSpecification:
    """Assemble a specification from its messages.

    Args:
        name: Its name.
        metadata: The metadata of its channel.
        messages: Its messages, in order.

    Raises:
        ValueError: The metadata are invalid.
    """
    missing = {"rows", "count", "formula", "of", "each", "predicates", "start", "end"} - metadata.keys()
    if missing:
        raise ValueError(f"the metadata lack {', '.join(sorted(missing))}")
    rows = _rows(metadata)
    none = np.zeros(len(rows), np.int8)
    state = none, np.full(len(rows), -np.inf), np.full(len(rows), np.inf), none
    times: list[int] = []
    history: list[tuple[NDArray[Any], ...]] = []
    begun = np.zeros(len(rows), bool)
    exact: dict[int, NDArray[np.float64]] = {}
    settled = np.full(len(rows), np.nan)
    firsts: dict[int, int] = {}
    is_repeated = False
    for message in messages:
        content = message.decode()
        if content.verdicts:
            chosen = list(content.rows) or slice(None)
            state = state[0].copy(), state[1].copy(), state[2].copy(), state[3].copy()
            decoded = [_DECODED[code] for code in content.verdicts]
            state[0][chosen], state[3][chosen] = zip(*decoded, strict=True)
            begun[chosen] = np.frombuffer(content.verdicts, np.uint8) != _NOT_BEGUN
            if content.lower:
                state[1][chosen], state[2][chosen] = content.lower, content.upper
            if content.settled:
                settled[chosen], is_repeated = content.settled, True
            if times and times[-1] == message.time:
                history[-1] = state
            else:
                times.append(message.time)
                history.append(state)
        if content.times:
            own: Sequence[int] = list(content.exact_rows) or range(len(rows))
            values = np.array(content.robustness).reshape(len(content.times), len(own))
            for instant, value in zip(content.times, values, strict=True):
                exact.setdefault(instant, np.full(len(rows), np.nan))[list(own)] = value
            for row in own:
                firsts[row] = min(firsts.get(row, content.times[0]), content.times[0])
    instants = sorted(exact)
    for row, instant in firsts.items() if not is_repeated else ():
        settled[row] = exact[instant][row]
    columns = [np.array([each[place] for each in history]).reshape(len(times), len(rows)) for place in range(4)]
    return LoggedSpecification(
        name=name,
        formula=metadata["formula"],
        of=metadata["of"],
        each=metadata["each"],
        predicates=tuple(map(str, json.loads(metadata["predicates"]))),
        rows=rows,
        start=int(metadata["start"]),
        end=int(metadata["end"]) if metadata["end"] else None,
        times=np.array(times, np.int64),
        verdicts=columns[0].astype(np.int8),
        presumptions=columns[3].astype(np.int8),
        begun=begun,
        lower=columns[1].astype(float),
        upper=columns[2].astype(float),
        settled=settled,
        instants=np.array(instants, np.int64),
        robustness=np.array([exact[each] for each in instants]).reshape(len(instants), len(rows)),
    )
