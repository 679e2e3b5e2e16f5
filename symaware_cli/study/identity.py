"""What the rows of a sweep are made of: the resolved scenario of each cell, and the versions of all that computes."""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from symaware_cli.study.sweep_plan import SweepPlan

#: What may differ where the kernels are pinned: it changes no bit. Which libraries of BLAS are loaded depends on what
#: else the process does; their versions are those of the distributions that bring them.
_HARMLESS = ("BLAS", "Processor", "platform")


@dataclass(frozen=True, slots=True)
class SweepIdentity:
    """What rows are made of.

    Attributes:
        cells: For each cell, the SHA-256 of its resolved scenario, without the seed, and of its assets.
        specifications: The names of the specifications of all cells, in their order.
        versions: The versions of what is installed, and what computes.
        resolved: The resolved scenario of the first cell, to tell what changed.
    """

    cells: Sequence[str]
    specifications: Sequence[str]
    versions: Mapping[str, str]
    resolved: str

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)

    def of_run(self, plan: SweepPlan, index: int) -> str:
        """Return what tells a run from any other: a hash of its scenario, parameters, index, seed and versions."""
        cell = plan.cell(index)
        versions, parameters = counting(self.versions), plan.parameters(index)
        content: list[Any] = [self.cells[cell.number], parameters, cell.variant, index, plan.seed(index), versions]
        if plan.document.claim is not None:
            content.append(plan.document.claim)  # so that no claim can be put into the plan afterwards
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def counting(versions: Mapping[str, str]) -> dict[str, str]:
    """The versions that count."""
    is_pinned = versions.get("Pinned") == "yes"
    return {name: each for name, each in versions.items() if not (is_pinned and name in _HARMLESS)}


def differences(then: SweepIdentity, now: SweepIdentity) -> list[str]:
    """Say in lines what differs between two identities; nothing if rows of both can be compared."""
    before, after = counting(then.versions), counting(now.versions)
    lines = [
        f"{name}: {before.get(name, 'not installed')} then, {after.get(name, 'not installed')} now"
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]
    changed = [number for number, pair in enumerate(zip(then.cells, now.cells, strict=False)) if pair[0] != pair[1]]
    if changed or len(then.cells) != len(now.cells):
        lines.append("the scenario was changed in the folder of the sweep")
        old, new = then.resolved.splitlines(), now.resolved.splitlines()
        lines += [line for line in difflib.unified_diff(old, new, lineterm="", n=0) if line[:3] not in ("---", "+++")]
    return lines
