"""Consistent forgery of a sweep folder: checksums, names of logs, table, row hashes and certificate match again."""

from __future__ import annotations

import json
import random
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from altered_logs import altered

import symaware_cli as sa
from symaware_cli.evidence.certificate import leaves, statement
from symaware_cli.evidence.certificate_page import page
from symaware_cli.evidence.checking import check_log
from symaware_cli.evidence.log_evaluation import evaluate_log
from symaware_cli.evidence.signed_statement import written
from symaware_cli.log import wire
from symaware_cli.log.digest import digest
from symaware_cli.log.log_message import LogMessage
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.session import write_table
from symaware_cli.studies.sweep_files import JOURNAL
from symaware_cli.studies.sweep_journal import SweepJournal

#: Two robots that pass each other, with noise; a run for each of three speeds, all logs kept.
SCENARIO = """\
symaware: 1
name: passing
seed: 1
run: {duration: 0.5}
environment: {use: kinematic, with: {time_step: 0.1}}
specifications:
  near: {each: robot, formula: "always position[1] < 9"}
  apart: {pairs: robot, formula: "always distance > 0.5"}
agents:
  robot:
    count: 2
    entity: {shape: {circle: {radius: 0.2}}}
    model: {use: single-integrator, with: {process_noise: 0.3}}
    state: [[0, 0], [1, 0]]
    knowledge: {goal: [[1, 0], [0, 0]]}
    components:
      see: {use: perception.self}
      steer: {use: control.go-to-goal, with: {speed: 1.0}}
"""
SWEEP = """\
symaware-sweep: 1
scenario: passing.yaml
runs: 1
keep: all
claim: P(near) > 0.1 with confidence 0.6, fixed
over: {agents.robot.components.steer.with.speed: [1.0, 0.8, 0.6]}
"""


class Forger:
    """Changes a random item in the folder of a sweep, and regenerates dependent files as far as possible."""

    def __init__(self, folder: Path, chance: random.Random) -> None:
        self._folder = SweepFolder.opened(folder)
        self._chance = chance
        with closing(sqlite3.connect(folder / JOURNAL)) as database, database:
            database.row_factory = sqlite3.Row
            self._rows = [dict(each) for each in database.execute('SELECT * FROM runs ORDER BY "index"')]
        self._row = chance.choice(self._rows)

    def forge(self, kind: str) -> None:
        """Apply a change of a kind; see `KINDS`."""
        KINDS[kind](self)
        assignments = ", ".join(f'"{name}" = :{name}' for name in self._row if name != "index")
        with closing(sqlite3.connect(self._folder.path / JOURNAL)) as database, database:
            database.executemany(f'UPDATE runs SET {assignments} WHERE "index" = :index', self._rows)
        with SweepJournal(self._folder.path / JOURNAL) as journal:
            write_table(self._folder, journal)
        said = statement(self._folder)
        (self._folder.path / "certificate.json").write_bytes(written(said))
        (self._folder.path / "certificate.html").write_text(page(said, None))
        hashes = "".join(f"{index} {hashed}\n" for index, hashed in leaves(self._folder))
        (self._folder.path / "certificate.leaves").write_text(hashes)

    def metric(self) -> None:
        """Change a metric of a row."""
        metrics = json.loads(self._row["metrics"])
        numbers = [name for name, value in metrics.items() if isinstance(value, int | float)]
        name = self._chance.choice(sorted(numbers))
        value = metrics[name]
        metrics[name] = not value if isinstance(value, bool) else value + (1 if isinstance(value, int) else 1e-9)
        self._row["metrics"] = json.dumps(metrics)

    def robustness(self) -> None:
        """Change the robustness of a row and of its worst agent, but not the verdict."""
        self._judge(1.0 + self._chance.random())

    def verdict(self) -> None:
        """Change the verdict of a row and of its worst agent, with a robustness of the opposite sign."""
        self._judge(-self._chance.random() - 1e-3)

    def _judge(self, factor: float) -> None:
        name = self._chance.choice(["near", "apart"])
        found = {key: json.loads(self._row[key]) for key in ("verdicts", "robustness", "metrics")}
        value = found["robustness"][name] * factor
        verdict = "satisfied" if value > 0 else "violated"
        found["robustness"][name], found["verdicts"][name] = value, verdict
        own = found["metrics"][f"by_agent.{name}"]
        own[0].update(verdict=verdict, robustness=value)
        for each in own[1:]:
            each["verdict"] = verdict
            each["robustness"] = value if factor < 0 else max(value, each["robustness"])
        self._row.update({key: json.dumps(value) for key, value in found.items()})

    def state_hash(self) -> None:
        """Change the hash of the states and control inputs of a row."""
        old = self._row["digest"]
        place = self._chance.randrange(len(old))
        self._row["digest"] = old[:place] + ("0" if old[place] != "0" else "1") + old[place + 1 :]

    def seed(self) -> None:
        """Change the seed of a row."""
        self._row["seed"] += 1 + self._chance.randrange(100)

    def parameter(self) -> None:
        """Change the parameter of a row."""
        self._row["parameters"] = json.dumps(dict.fromkeys(json.loads(self._row["parameters"]), 0.9))

    def failure(self) -> None:
        """Declare a run as failed."""
        self._row.update(state="failed", verdicts="{}", robustness="{}", metrics="{}", digest=None, error="a fault")

    def exchange(self) -> None:
        """Swap two rows, except for their positions in the plan."""
        other = self._chance.choice([each for each in self._rows if each is not self._row])
        for name in ("verdicts", "robustness", "metrics", "digest", "log"):
            self._row[name], other[name] = other[name], self._row[name]

    def bit(self) -> None:
        """Flip a bit of a message of the log."""

        def changed(message: LogMessage) -> bytes:
            data = bytearray(message.data)
            data[self._chance.randrange(len(data))] ^= 1 << self._chance.randrange(8)
            return bytes(data)

        self._message(lambda topic: True, changed)

    def left_out(self) -> None:
        """A message of the log."""
        self._message(lambda topic: True, lambda message: None)

    def event(self) -> None:
        """Change the text of an event of the log, or remove the event."""
        texts = b"robot", b"satisfied", b"running", b"specification"

        def changed(message: LogMessage) -> bytes | None:
            word = next((each for each in texts if each in message.data), None)
            return None if word is None else message.data.replace(word, word[::-1], 1)

        self._message(lambda topic: topic.startswith("/events"), changed)

    def said_verdict(self) -> None:
        """Remove the record of a specification at an instant from the log."""
        self._message(lambda topic: topic.startswith("/specifications"), lambda message: None)

    def state(self) -> None:
        """A true state of the log."""
        self._message(lambda topic: topic == "/world/robot/state", self._moved)

    def state_and_row(self) -> None:
        """Change a true state of the log, and update the outcomes in the row to follow from the log."""
        self.state()
        log = self._folder.logs / self._row["log"]
        outcomes = {each.name: each for each in check_log(log).specifications}
        metrics = json.loads(self._row["metrics"])
        for each in evaluate_log(log).specifications:
            order = sorted(each.rows, key=lambda row: row.robustness)
            metrics[f"by_agent.{each.name}"] = [
                {"agent": " and ".join(row.agents), "verdict": row.verdict, "robustness": row.robustness}
                for row in order
            ]
        self._row["verdicts"] = json.dumps({name: each.verdict for name, each in outcomes.items()})
        self._row["robustness"] = json.dumps({name: each.robustness for name, each in outcomes.items()})
        self._row["metrics"] = json.dumps(metrics)

    def attachment(self) -> None:
        """Change an attachment of the log: the manifest, the scenario or the versions."""
        names = sorted(sa.open_log(self._folder.logs / self._row["log"]).attachments)
        chosen = self._chance.choice(names)
        self._log(attachment=partial(self._attached, chosen))

    def outcome(self) -> None:
        """Change the outcome of the run in the log."""
        self._log(outcome=self._ended)

    def columns(self) -> None:
        """Change the metadata about columns of a channel of the log."""
        log = sa.open_log(self._folder.logs / self._row["log"])
        chosen = self._chance.choice(sorted(topic for topic in log.channels if topic != "/timing"))

        def changed(topic: str, content: dict[str, str]) -> dict[str, str]:
            return {**content, "unit": "ft"} if topic == chosen else content

        self._log(metadata=changed)

    def _message(self, is_about: Callable[[str], bool], change: Callable[[LogMessage], bytes | None]) -> None:
        """Change a message in the log of a row, drawn from those on some topics."""
        log = sa.open_log(self._folder.logs / self._row["log"])
        places = [
            place
            for place, each in enumerate(log.messages())
            if each.channel.topic != "/timing" and each.data and is_about(each.channel.topic)
        ]
        chosen, seen = self._chance.choice(places), iter(range(10**9))
        self._log(message=lambda message: change(message) if next(seen) == chosen else message.data)

    def _moved(self, message: LogMessage) -> bytes:
        content = message.decode()
        values = np.array(content.values)
        values[self._chance.randrange(len(values)), self._chance.randrange(2)] += self._chance.choice([1e-9, 0.01, 1.0])
        return wire.encode_rows(values, content.rows)

    def _attached(self, chosen: str, name: str, data: bytes) -> bytes:
        if name != chosen:
            return data
        if name == "versions.json":
            return json.dumps({**json.loads(data), "numpy": "1.0"}).encode()
        if name.endswith(".json"):
            return json.dumps({**json.loads(data), "name": "another"}).encode()
        return data + b"# changed\n"

    def _ended(self, content: dict[str, Any]) -> dict[str, Any]:
        name = self._chance.choice(sorted({*content} - {"wall_time", "cpu_time", "log"}))
        return {**content, name: _other(content[name])}

    def _log(self, **changes: Any) -> None:
        """Rewrite the log of a row, named by its digest."""
        path = self._folder.logs / self._row["log"]
        forged = path.with_name("forged.mcap")
        altered(path, forged, **changes)
        self._row["log"] = f"{digest(sa.open_log(forged)).combined[:32]}.mcap"
        forged.replace(path.with_name(self._row["log"]))


def _other(value: Any) -> Any:
    """Return a different value of the same type."""
    match value:
        case bool():
            return not value
        case int() | float():
            return value + 1
        case str():
            return f"{value}-"
        case None:
            return 1
        case Mapping():
            return {**value, "more": 1}
    return [*value, 1]


#: The kinds of changes: to rows, and to logs.
KINDS: Mapping[str, Callable[[Forger], None]] = {
    "row: a figure": Forger.metric,
    "row: robustness": Forger.robustness,
    "row: verdict": Forger.verdict,
    "row: hash of states": Forger.state_hash,
    "row: seed": Forger.seed,
    "row: parameter": Forger.parameter,
    "row: failure": Forger.failure,
    "row: exchanged with another": Forger.exchange,
    "log: a bit of a message": Forger.bit,
    "log: a message left out": Forger.left_out,
    "log: an event": Forger.event,
    "log: verdicts of an instant": Forger.said_verdict,
    "log: a state": Forger.state,
    "log: a state, and its row": Forger.state_and_row,
    "log: an attachment": Forger.attachment,
    "log: the outcome": Forger.outcome,
    "log: columns": Forger.columns,
}
