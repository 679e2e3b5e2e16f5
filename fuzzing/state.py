"""The state of a campaign for one target: progress, counts and findings."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fuzzing.worker import Result

#: The number of cases kept for one cause.
_KEPT = 3


@dataclass
class State:
    """The state of one target.

    Attributes:
        folder: The folder in which it is stored.
        seed: The seed of all cases, together with their numbers.
        next: The number of the first case that was not begun yet.
        pending: Cases that were begun and not finished; they come first.
        done: The number of finished cases.
        seconds: Their total wall time [s].
        longest: The longest wall time of a case [s].
        memory: The greatest increase of a worker's memory by a case [bytes].
        tally: The counts of the target.
        findings: By kind and place: the number of cases (`count`), and the files of some (`files`).
    """

    folder: Path
    seed: int = 0
    next: int = 0
    pending: list[int] = field(default_factory=list)
    done: int = 0
    seconds: float = 0.0
    longest: float = 0.0
    memory: int = 0
    tally: Counter[str] = field(default_factory=Counter)
    findings: dict[str, dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def load(cls, folder: Path, seed: int) -> State:
        """Read the stored state; start from the beginning if there is none, or it has another seed."""
        try:
            content = json.loads((folder / "state.json").read_text())
        except FileNotFoundError:
            content = {}
        if content.get("seed", seed) != seed:
            content = {}
        state = cls(folder, **{"seed": seed, **content})
        state.tally = Counter(state.tally)
        return state

    def save(self) -> None:
        """Keep it, whole or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        content = {key: value for key, value in vars(self).items() if key != "folder"}
        partial = self.folder / "state.json.part"
        partial.write_text(json.dumps(content, indent=1))
        partial.replace(self.folder / "state.json")

    def take(self) -> int:
        """The number of the next case; `add` says that it is done."""
        self.pending.append(self.next)
        self.next += 1
        return self.pending[-1]

    def add(self, result: Result) -> bool:
        """Enter what became of a case, and say whether something new was found."""
        self.pending.remove(result.number)
        self.done += 1
        self.seconds += result.seconds
        self.longest = max(self.longest, result.seconds)
        self.memory = max(self.memory, result.memory)
        self.tally.update(result.tally)
        if result.found is None:
            return False
        key = f"{result.found.kind}: {result.found.where}"
        entry = self.findings.setdefault(key, {"count": 0, "files": []})
        entry["count"] += 1
        if len(entry["files"]) < _KEPT:
            self.folder.mkdir(parents=True, exist_ok=True)
            path = self.folder / f"{result.number}.case"
            path.write_bytes(result.case)
            path.with_suffix(".txt").write_text(f"{key}\n\n{result.found.text}")
            entry["files"].append(str(path))
        self.save()
        return bool(entry["count"] == 1)
