"""The identity of a sweep's rows: the scenario of each cell, the versions of all software involved, and its code."""

from __future__ import annotations

import difflib
import hashlib
import json
import platform
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path, PurePosixPath
from typing import Any

from symaware_cli import processor
from symaware_cli.language import ORIGIN, dumped
from symaware_cli.studies.sweep_plan import SweepPlan

#: Entries that may differ without changing a bit if the kernels are pinned. The set of loaded BLAS libraries depends on
#: what else the process does; their versions are those of the distributions that contain them.
_HARMLESS = ("BLAS", "Processor", "platform")


@dataclass(frozen=True, slots=True)
class SweepIdentity:
    """The inputs and versions that determine rows.

    Attributes:
        cells: The SHA-256 of each cell's resolved scenario, without the seed, together with all assets.
        specifications: The names of the specifications of all cells, in their order.
        versions: The versions of installed software, and the processor and numerical libraries in use.
        resolved: The resolved scenario of the first cell as plain data, from which the first hash of `cells` is
            computed.
    """

    cells: Sequence[str]
    specifications: Sequence[str]
    versions: Mapping[str, str]
    resolved: Mapping[str, Any]

    @classmethod
    def from_json(cls, content: Any) -> SweepIdentity:
        """Create an identity from the result of `to_json`.

        Raises:
            ValueError: The content is invalid; the message names the value and the expected type.
        """
        if not isinstance(content, dict) or content.keys() != {"cells", "specifications", "versions", "resolved"}:
            raise ValueError("a mapping of cells, specifications, versions and resolved has to be there")
        for name in ("cells", "specifications"):
            if not isinstance(content[name], list) or not all(isinstance(each, str) for each in content[name]):
                raise ValueError(f"`{name}` has to be a list of texts, not {_shown(content[name])}")
        if not isinstance(content["versions"], dict) or not all(
            isinstance(each, str) for each in content["versions"].values()
        ):
            raise ValueError(f"`versions` has to be a mapping of texts, not {_shown(content['versions'])}")
        if not isinstance(content["resolved"], dict):
            raise ValueError(f"`resolved` has to be a mapping, not {_shown(content['resolved'])}")
        return cls(**content)

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return asdict(self)

    def of_run(self, plan: SweepPlan, index: int) -> str:
        """Return the identity of a run: a hash of its scenario, parameters, index, seed and versions."""
        cell = plan.cell(index)
        versions, parameters = counting(self.versions), plan.parameters(index)
        content: list[Any] = [self.cells[cell.number], parameters, cell.variant, index, plan.seed(index), versions]
        if plan.document.claim is not None:
            content.append(plan.document.claim)  # so that no claim can be added to the plan afterwards
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def counting(versions: Mapping[str, str]) -> dict[str, str]:
    """Return the versions that affect results."""
    is_pinned = versions.get("Pinned") == "yes"
    harmless = {ORIGIN, *(_HARMLESS if is_pinned else ())}
    return {name: each for name, each in versions.items() if name not in harmless}


def differences(
    then: SweepIdentity,
    now: SweepIdentity,
    names: tuple[str, str] = ("then", "now"),
    changed: str = "the scenario was changed in the folder of the sweep",
) -> list[str]:
    """Return one line for each difference between two identities; empty if their rows are comparable.

    Args:
        then: One identity.
        now: The other one.
        names: What the lines call the two.
        changed: The line before the differences of the scenarios.
    """
    before, after = counting(then.versions), counting(now.versions)
    one, other = names
    lines = [
        f"{name}: {before.get(name, 'not installed')} {one}, {after.get(name, 'not installed')} {other}"
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]
    differing = [number for number, pair in enumerate(zip(then.cells, now.cells, strict=False)) if pair[0] != pair[1]]
    if differing or len(then.cells) != len(now.cells):
        lines.append(changed)
        old, new = (dumped(each.resolved).decode().splitlines() for each in (then, now))
        lines += [line for line in difflib.unified_diff(old, new, lineterm="", n=0) if line[:3] not in ("---", "+++")]
    return lines


def scenario_digests(scenarios: Sequence[Mapping[str, Any]], files: Mapping[str, bytes]) -> list[str]:
    """Return the SHA-256 of each resolved scenario, without its seed, and of the assets.

    Args:
        scenarios: The scenarios as plain data.
        files: The files of all scenarios by name; scenario files themselves are left out.
    """
    assets = b"".join(
        name.encode() + hashlib.sha256(data).digest()
        for name, data in sorted(files.items())
        if not name.endswith((".yaml", ".yml", ".toml"))
    )
    contents = ({key: value for key, value in each.items() if key != "seed"} for each in scenarios)
    return [hashlib.sha256(json.dumps(each, sort_keys=True).encode() + assets).hexdigest() for each in contents]


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


@dataclass(frozen=True, slots=True)
class CodeIdentity:
    """The code of a process.

    Attributes:
        versions: The version of Python, and the processor and numerical libraries in use, by name.
        files: The hash of each file, by name, of each distribution with an imported module.
        variables: The environment variables that choose among kernels; they have to be set before Python starts.
    """

    versions: Mapping[str, str]
    files: Mapping[str, Mapping[str, str]]
    variables: Mapping[str, str]

    @classmethod
    def of_this_process(cls) -> CodeIdentity:
        """Hash the files of all distributions that this process has imported, a few hundred megabytes."""
        versions = counting({"Python": platform.python_version(), **processor.in_force()})
        return cls(versions, _imported(), processor.variables())

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data, from which it can be recreated."""
        return asdict(self)

    def differences(self, found: CodeIdentity) -> list[str]:
        """Return one line for each difference in the code that both processes have imported; empty if there is none."""
        lines = [
            f"{name}: {self.versions.get(name, 'unknown')} here, {found.versions.get(name, 'unknown')} there"
            for name in sorted(self.versions.keys() | found.versions.keys())
            if self.versions.get(name) != found.versions.get(name)
        ]
        for name in sorted(self.files.keys() & found.files.keys()):
            ours, theirs = self.files[name], found.files[name]
            lines += [
                f"{name}: {file} {_difference(file, ours, theirs)}"
                for file in sorted(ours.keys() | theirs.keys())
                if ours.get(file) != theirs.get(file)
            ]
        return lines


def _difference(file: str, ours: Mapping[str, str], theirs: Mapping[str, str]) -> str:
    if file not in theirs:
        return "is here, but not there"
    return "is another file there" if file in ours else "is there, but not here"


def _imported() -> dict[str, dict[str, str]]:
    """Return the hash of each file of each distribution with an imported module."""
    owners = metadata.packages_distributions()
    found: dict[str, dict[str, str]] = {}
    for name in sorted({name.partition(".")[0] for name in [*sys.modules]} - sys.stdlib_module_names):
        # The main module, finders of editable distributions and Python's build configuration belong to no distribution.
        if name.startswith(("__", "_sysconfigdata")):
            continue
        installed = False
        for owner in sorted(set(owners.get(name, ()))):
            files = {file: path for file, path in _recorded(owner) if path.is_file()}
            installed |= any(PurePosixPath(file).parts[0].partition(".")[0] == name for file in files)
            _add(found, owner, files)
        if not installed:
            # Such as an editable distribution, whose metadata lists no code.
            _add(found, next(iter(owners.get(name, ())), name), dict(_beside(name)))
    return {name: files for name, files in sorted(found.items()) if files}


def _add(found: dict[str, dict[str, str]], owner: str, files: Mapping[str, Path]) -> None:
    known = found.setdefault(re.sub(r"[-_.]+", "-", owner).lower(), {})
    for file, path in sorted(files.items()):
        if file not in known:
            known[file] = hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()


def _recorded(owner: str) -> Iterator[tuple[str, Path]]:
    """Yield the files of a distribution inside its folder, without those that depend on the installer."""
    for file in metadata.distribution(owner).files or ():
        if file.parts[0] != ".." and file.suffix != ".pth" and _counts(file):
            yield file.as_posix(), Path(str(file.locate()))


def _beside(name: str) -> Iterator[tuple[str, Path]]:
    """Yield the files of a module or package."""
    module = sys.modules.get(name)
    for folder in [Path(each) for each in getattr(module, "__path__", ())]:
        for path in sorted(folder.rglob("*")):
            file = PurePosixPath(name, *path.relative_to(folder).parts)
            if _counts(file) and path.is_file():
                yield file.as_posix(), path
    alone = Path(getattr(module, "__file__", None) or "")
    if not hasattr(module, "__path__") and alone.is_file():
        yield alone.name, alone


def _counts(file: PurePosixPath) -> bool:
    """Return whether a file is code or data of a package, not a leftover of installers, Python or editors."""
    left = any(
        each == "__pycache__" or each[0] == "." or each.endswith((".dist-info", ".egg-info")) for each in file.parts
    )
    return not left and file.suffix != ".pyc"
