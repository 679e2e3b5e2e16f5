"""Writes assurance cases as a picture, as XML and as a page, and checks them again later."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from symaware_cli.evidence.assurance.case_document import CaseDocument, read_case
from symaware_cli.evidence.assurance.case_drawing import drawing
from symaware_cli.evidence.assurance.sacm import sacm
from symaware_cli.evidence.assurance.solution_check import SolutionCheck
from symaware_cli.evidence.sweep_verification import Level
from symaware_cli.language import FilePath
from symaware_cli.log import LogError, whole_file, whole_folder
from symaware_cli.views import rendered

#: The names of the files of a written case.
CASE, RESULT, PICTURE, EXCHANGE, PAGE = "case.yaml", "case.json", "case.svg", "case.sacm.xml", "index.html"


@dataclass(frozen=True, slots=True)
class AssuranceCase:
    """An assurance case, and whether its evidence holds.

    Attributes:
        document: The case.
        folder: The folder that the case was written to.
        problems: The reason why the evidence of a solution does not hold, by identifier; None if it does.
        digests: The SHA-256 of the file of each solution; None if there is no file.
    """

    document: CaseDocument
    folder: Path
    problems: Mapping[str, str | None]
    digests: Mapping[str, str | None]

    @property
    def statuses(self) -> Mapping[str, str]:
        """The status of each goal, strategy and solution: ``holds``, ``fails``, or ``open`` if it is undeveloped."""
        found = {name: "holds" if problem is None else "fails" for name, problem in self.problems.items()}

        def status(name: str) -> str:
            if name not in found:
                below = [status(each) for each in self.document.arguments[name].by] or ["open"]
                found[name] = next((each for each in ("fails", "open") if each in below), "holds")
            return found[name]

        for name in self.document.arguments:
            status(name)
        return found

    @property
    def is_supported(self) -> bool:
        """Whether the top goal is supported by evidence that holds."""
        return self.statuses[self.document.top] == "holds"

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {
            "name": self.document.name,
            "supported": self.is_supported,
            "goals": {name: self.statuses[name] for name in self.document.goals},
            "solutions": {
                name: {
                    "kind": each.kind,
                    "path": each.path,
                    "sha256": self.digests[name],
                    "status": self.statuses[name],
                    "problem": self.problems[name],
                }
                for name, each in self.document.solutions.items()
            },
        }


def assure(
    case: FilePath,
    output: FilePath,
    *,
    level: Level = "sample",
    rows: int = 5,
    seed: int | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> AssuranceCase:
    """Check the evidence of an assurance case, and write it: as SVG, as SACM, and as a page.

    Args:
        case: The file of the case; paths in it are relative to its folder.
        output: A new or empty folder.
        level: How thoroughly certificates are verified; see `verify_sweep`.
        rows: The number of rows of each sweep that are repeated.
        seed: The seed for the choice of rows; None for an unpredictable choice.
        on_progress: Called after each solution with the number of checked solutions, and the number of all.

    Raises:
        ScenarioError: The case is invalid; contains every problem with its place.
        OutputError: The folder cannot be written.
    """
    path, folder = Path(case), Path(output)
    document = read_case(path)
    made = _checked(document, path.parent, folder, {}, level, rows, seed, on_progress)
    with whole_folder(folder) as partial:
        suffix = path.suffix.lower() if path.suffix.lower() == ".toml" else ".yaml"
        (partial / CASE).with_suffix(suffix).write_bytes(path.read_bytes())
        base = os.path.relpath(path.resolve().parent, folder.resolve())
        content = {**made.to_json(), "evidence": Path(base).as_posix()}
        (partial / RESULT).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        for name, shown in _shown(made).items():
            (partial / name).write_bytes(shown)
    return made


def _shown(case: AssuranceCase) -> Mapping[str, bytes]:
    """Return the files that present a case, by name."""
    picture = drawing(case.document, case.statuses)
    return {
        PICTURE: picture.encode(),
        EXCHANGE: sacm(case.document, case.statuses),
        PAGE: page(case, picture).encode(),
    }


def is_case(folder: Path) -> bool:
    """Return whether a folder was written by `assure`."""
    return os.path.isfile(folder / RESULT) and os.path.isfile(folder / PICTURE)


def verify_case(
    folder: FilePath,
    level: Level = "sample",
    *,
    rows: int = 5,
    seed: int | None = None,
    on_progress: Callable[[int, int], object] | None = None,
) -> AssuranceCase:
    """Check all evidence of a written assurance case again, at its present location.

    Evidence is stale if its file has changed since the case was written. The picture, the XML and the page are updated
    to the present status.

    Args:
        folder: The folder of the case.
        level: See `assure`.
        rows: The number of rows.
        seed: The seed.
        on_progress: The callback.

    Raises:
        LogError: The folder has no case.
        ScenarioError: The case in it is invalid.
        OutputError: The picture cannot be written.
    """
    place = Path(folder)
    file = next((each for each in (place / CASE, (place / CASE).with_suffix(".toml")) if each.is_file()), place / CASE)
    try:
        said = json.loads((place / RESULT).read_text(encoding="utf-8"))
        base = place / str(said["evidence"])
        digests = {str(name): each["sha256"] for name, each in said["solutions"].items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise LogError(f"{place} is not the folder of an assurance case: {error}") from None
    found = _checked(read_case(file), base, place, digests, level, rows, seed, on_progress)
    for name, content in _shown(found).items():
        if _content(place / name) != content:
            with whole_file(place / name) as partial:
                partial.write_bytes(content)
    return found


def _content(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


def _checked(
    document: CaseDocument,
    base: Path,
    folder: Path,
    digests: Mapping[str, str | None],
    level: Level,
    rows: int,
    seed: int | None,
    on_progress: Callable[[int, int], object] | None,
) -> AssuranceCase:
    """Check all solutions; the file of a solution with a digest must match it."""
    check = SolutionCheck(document, base, level, rows, seed)
    problems: dict[str, str | None] = {}
    present: dict[str, str | None] = {}
    for number, name in enumerate(document.solutions):
        present[name] = check.digest(name)
        problem = check.problem(name)
        if problem is None and digests and digests.get(name) != present[name]:
            problem = "stale: its file has changed since the case was written"
        problems[name] = problem
        if on_progress is not None:
            on_progress(number + 1, len(document.solutions))
    return AssuranceCase(document, folder, problems, present)


def page(case: AssuranceCase, picture: str) -> str:
    """Return a case as one HTML file.

    Args:
        case: The case.
        picture: Its picture, as SVG.
    """
    words = {"holds": "supported", "fails": "not supported", "open": "undeveloped"}
    document, statuses = case.document, case.statuses
    return str(
        rendered(
            "case.html",
            name=document.name,
            outcome=words[statuses[document.top]],
            is_supported=case.is_supported,
            picture=picture,
            goals=[(name, each.text, words[statuses[name]]) for name, each in document.goals.items()],
            solutions=[
                (
                    name,
                    each.shown,
                    f"{each.kind} {each.path}",
                    case.problems[name] or "holds",
                    case.digests[name] or "none",
                )
                for name, each in document.solutions.items()
            ],
            assumptions=[*document.assumptions.items()],
        )
    )
