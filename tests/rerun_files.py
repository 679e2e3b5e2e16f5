"""The content of .rrd files and pictures of the viewer, and artificial logs to show."""

import io
import json
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from symaware_cli import open_log
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.reader import Log
from symaware_cli.log.writer import LogWriter
from symaware_cli.views.replay_session import replay_session
from symaware_cli.views.viewer import require

# Rerun reads this once, when it is loaded.
require()

STEP = 50_000_000

_DRIVER = any(Path("/usr/share/vulkan/icd.d").glob("*.json"))
CHROMIUM = shutil.which("chromium")
_CI = bool(os.environ.get("CI"))

#: Where there is no CI, one may do without what only Debian's packages bring.
needs_graphics = pytest.mark.skipif(not _DRIVER and not _CI, reason="no Vulkan driver (Debian: mesa-vulkan-drivers)")
needs_browser = pytest.mark.skipif(not CHROMIUM and not _CI, reason="no browser (Debian: chromium)")


class Recording:
    """The content of an .rrd file."""

    def __init__(self, path: Path) -> None:
        from rerun.chunk import RrdReader

        reader = RrdReader(path)
        self.blueprints = len(reader.blueprints())
        self._rows: dict[tuple[str, str], list[tuple[int | None, list[Any] | None]]] = {}
        for chunk in reader.stream():
            batch = chunk.to_record_batch()
            times = batch.column("time").cast("int64").to_pylist() if not chunk.is_static else [None] * batch.num_rows
            for name in batch.schema.names:
                if ":" in name:
                    rows = self._rows.setdefault((str(chunk.entity_path), name), [])
                    rows += zip(times, batch.column(name).to_pylist(), strict=True)
        for rows in self._rows.values():
            rows.sort(key=lambda row: -1 if row[0] is None else row[0])

    @property
    def entities(self) -> set[str]:
        return {entity for entity, _ in self._rows}

    @property
    def rows(self) -> Mapping[tuple[str, str], Sequence[tuple[int | None, list[Any] | None]]]:
        """By entity and component: time [ns] and the logged value."""
        return self._rows

    def times(self, entity: str, component: str) -> list[int]:
        return [time for time, _ in self._rows[entity, component] if time is not None]

    def values(self, entity: str, component: str) -> list[Any]:
        return [value for time, value in self._rows[entity, component] if time is not None]

    def static(self, entity: str, component: str) -> Any:
        return next(value for time, value in self._rows[entity, component] if time is None)


def saved(
    log: Log | Path, folder: Path, agents: Sequence[str] = (), against: Log | None = None, **window: Any
) -> Recording:
    """Convert a log, and read the result."""
    opened = log if isinstance(log, Log) else open_log(log)
    path = folder / "saved.rrd"
    replay_session(opened, agents, against=against, **window).save(path)
    return Recording(path)


def pixels(png: bytes) -> np.ndarray:
    """A picture as (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def coloured(picture: np.ndarray) -> int:
    """The number of coloured pixels, which agents have, and menus hardly."""
    return int((np.ptp(picture, axis=-1) > 40).sum())


def group(
    *agents: str, shape: Mapping[str, Any] | None = None, state: Sequence[str] = ("x", "y"), heading: int | None = None
) -> dict[str, Any]:
    """The entry of a group in a manifest."""
    position = [number for number, name in enumerate(state) if name in ("x", "y", "z")]
    return {
        "agents": list(agents),
        "indexed": len(agents) > 1,
        "model": {
            "use": "test",
            "state": [[name, "m"] for name in state],
            "control_input": [["speed", "m/s"]],
            "position": position,
            "heading": heading,
        },
        "entity": {"shape": shape, "mass": 1.0} if shape else {"mass": 1.0},
        "components": {},
    }


class Script:
    """A log written message by message, with content that is rare in runs; unless it is buffered, in the order of
    time."""

    def __init__(
        self, path: Path, groups: Mapping[str, Any], entities: Mapping[str, Any] | None = None, buffered: bool = True
    ) -> None:
        self.path = path
        self._buffered = buffered
        self._writer = LogWriter(path)
        roster = [agent for each in groups.values() for agent in each["agents"]]
        content = {"format": 1, "name": "script", "seed": 1, "mode": "synchronous", "time_step": STEP, "steps": 1}
        content |= {"groups": groups, "entities": entities or {}, "roster": [*roster, *(entities or {})]}
        self._writer.attach("manifest.json", "application/json", json.dumps(content).encode())
        self._channels: dict[str, int] = {}
        self._messages: list[tuple[int, int, bytes]] = []

    def attach(self, name: str, data: bytes) -> None:
        self._writer.attach(name, "application/yaml", data)

    def say(self, topic: str, time: int, data: bytes, kind: str, columns: str = "") -> None:
        if topic not in self._channels:
            self._channels[topic] = self._writer.channel(topic, kind, {"columns": columns} if columns else {})
        if self._buffered:
            self._messages.append((time, self._channels[topic], data))
        else:
            self._writer.add(self._channels[topic], time, data)

    def event(self, time: int, name: str, source: str, level: v1.Event.Level = v1.Event.INFO, text: str = "") -> None:
        event = v1.Event(name=name, source=source, level=level, text=text)
        self.say("/events", time, event.SerializeToString(), "Event")

    def message(
        self, time: int, sender: str, receiver: str, stage: v1.Message.Stage = v1.Message.DELIVERED, **more: Any
    ) -> None:
        message = v1.Message(id=time, sender=sender, receiver=receiver, kind="hello", stage=stage, **more)
        self.say("/messages", time, message.SerializeToString(), "Message")

    def contact(
        self, time: int, a: str, b: str, stage: v1.Contact.Stage = v1.Contact.BEGIN, point: Sequence[float] = ()
    ) -> None:
        contact = v1.Contact(a=a, b=b, stage=stage, point=point, depth=0.1)
        self.say("/contacts", time, contact.SerializeToString(), "Contact")

    def knowledge(self, time: int, group: str, values: Mapping[int, Any]) -> None:
        message = v1.Knowledge(rows=list(values), values=[json.dumps(value) for value in values.values()])
        self.say(f"/agents/{group}/knowledge", time, message.SerializeToString(), "Knowledge")

    def finish(self) -> Log:
        for time, channel, data in sorted(self._messages, key=lambda message: message[0]):
            self._writer.add(channel, time, data)
        self._writer.finish({"status": "finished"})
        return open_log(self.path)
