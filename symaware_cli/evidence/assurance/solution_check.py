"""Checks that the evidence of an assurance case exists, is sound and fresh, and concerns the scenario."""

from __future__ import annotations

import hashlib
import json
import secrets
from pathlib import Path
from typing import Any

from symaware_cli.evidence.assurance.case_document import CaseDocument, SolutionUse
from symaware_cli.evidence.budgeting import BUDGET
from symaware_cli.evidence.certificate import BEFOREHAND
from symaware_cli.evidence.certificate_check import opened
from symaware_cli.evidence.certification import verify_certificate
from symaware_cli.evidence.sweep_verification import Level, verify_folder
from symaware_cli.evidence.verification import verify_log
from symaware_cli.language import ScenarioError
from symaware_cli.log import Log, LogError, UnknownNameError, open_log
from symaware_cli.log.digest import digest
from symaware_cli.studies import Claim, ClaimTerm, SweepError, SweepFolder, read_differences

#: The largest file of evidence that is read as a whole.
_MOST_BYTES = 64 * 2**20


class _RefusedError(Exception):
    """The evidence does not hold; the message gives the reason."""


class SolutionCheck:
    """Checks the solutions of a case."""

    def __init__(
        self, document: CaseDocument, folder: Path, level: Level = "sample", rows: int = 5, seed: int | None = None
    ) -> None:
        """Prepare.

        Args:
            document: The case.
            folder: The folder that paths are relative to.
            level: How thoroughly certificates are verified; see `verify_sweep`.
            rows: The number of rows of each sweep that are repeated.
            seed: The seed for the choice of rows; None for an unpredictable choice.
        """
        self._document = document
        self._folder = folder
        self._level: Level = level
        self._rows = rows
        self._seed = seed
        #: The seed for the rows of studies.
        self._chosen = secrets.randbits(63) if seed is None else seed

    def problem(self, name: str) -> str | None:
        """Return the reason why the evidence of a solution does not hold; None if it does."""
        solution = self._document.solutions[name]
        path = self._folder / solution.path
        if not path.is_file():
            return f"missing: there is no file {solution.path}"
        try:
            checked = {
                "certificate": self._certificate,
                "falsification": self._falsification,
                "log": self._log,
                "budget": self._budget,
                "explanation": self._explanation,
                "study": self._study,
            }
            checked[solution.kind](solution, path)
        except _RefusedError as error:
            return str(error)
        except (LogError, SweepError, ScenarioError) as error:
            return f"unsound: {' '.join(str(error).split())}"
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            return f"unreadable: {error!r}"
        return None

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of the file of a solution, in hexadecimal; None if there is no file."""
        path = self._folder / self._document.solutions[name].path
        try:
            with path.open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except OSError:
            return None

    def _scenario(self, solution: SolutionUse) -> tuple[str, bytes] | None:
        """Return the name and the content of the scenario that evidence must be about; None for any."""
        name = solution.scenario or self._document.scenario
        if name is None:
            return None
        try:
            return name, (self._folder / name).read_bytes()
        except OSError:
            raise _RefusedError(f"missing: there is no scenario {name}") from None

    def _require_scenario(self, solution: SolutionUse, folder: SweepFolder) -> None:
        """Refuse a sweep if the files of the scenario have changed since."""
        wanted = self._scenario(solution)
        if wanted is None:
            return
        name, content = wanted
        if _read(folder.source.scenario) != content:
            raise _RefusedError(f"stale: {name} has changed since it was made")
        top = folder.source.scenario.parent
        for each in folder.scenario_files():
            file = folder.path / each
            if file.is_relative_to(top):
                beside = (self._folder / name).parent / file.relative_to(top)
                if _read(beside) != file.read_bytes():
                    raise _RefusedError(f"stale: {name} refers to {beside.name}, which has changed")

    def _certificate(self, solution: SolutionUse, path: Path) -> None:
        read = opened(path).content["predicate"]
        if read["claim"]["stated"] != BEFOREHAND or not read["established"]:
            raise _RefusedError("unsound: the certificate does not establish its claim, or it was stated afterwards")
        wanted, found = Claim.parse(solution.claim or ""), Claim.parse(read["claim"]["text"])
        missing = [term for term in wanted.terms if not any(_covers(each, term) for each in found.terms)]
        if missing or found.confidence < wanted.confidence:
            raise _RefusedError(f"another claim: `{found}` does not establish `{wanted}`")
        folder = SweepFolder.opened(path.parent)
        self._require_scenario(solution, folder)
        self._verify(path)

    def _verify(self, path: Path) -> None:
        result = verify_certificate(path, self._level, rows=self._rows, seed=self._seed)
        if not result.is_sound:
            first = [*result.findings, *result.sweep.findings][0]
            raise _RefusedError(f"unsound: {first.column} is {first.found}, but should be {first.expected}")

    def _falsification(self, solution: SolutionUse, path: Path) -> None:
        said = _json(path)
        if said["found"]:
            raise _RefusedError(f"contradicted: the search found a violation of {said['specification']}")
        if said["specification"] != solution.specification:
            raise _RefusedError(f"another claim: the search was about {said['specification']}")
        if not said["runs"] or said["runs"] == said["failed"]:
            raise _RefusedError("unsound: no run of the search finished")
        wanted = self._scenario(solution)
        if wanted is not None and said.get("scenario_sha256") != hashlib.sha256(wanted[1]).hexdigest():
            raise _RefusedError(f"stale: {wanted[0]} has changed since it was made")

    def _logged(self, solution: SolutionUse, path: Path) -> Log:
        """Return a log, and refuse it if the scenario has changed since."""
        log = open_log(path)
        wanted = self._scenario(solution)
        if wanted is not None and wanted[1] not in log.attachments.values():
            raise _RefusedError(f"stale: {wanted[0]} has changed since it was made")
        return log

    def _log(self, solution: SolutionUse, path: Path) -> None:
        log = self._logged(solution, path)
        outcomes = (log.outcome or {}).get("specifications", [])
        verdict = next((each["verdict"] for each in outcomes if each["name"] == solution.specification), None)
        if verdict != "satisfied":
            raise _RefusedError(f"contradicted: {solution.specification} is {verdict or 'not monitored'} in the run")
        self._repeat(path)

    def _repeat(self, path: Path) -> None:
        if not verify_log(path).is_equal:
            raise _RefusedError("unsound: the repeated run differs from it")

    def _explanation(self, solution: SolutionUse, path: Path) -> None:
        said = _json(path)
        if said["specification"] != solution.specification:
            raise _RefusedError(f"another claim: it explains a violation of {said['specification']}")
        # `explain` was called somewhere; the log is there, or beside the explanation.
        written = Path(said["log"])
        places = (self._folder / written, path.parent / written, path.parent / written.name)
        log = next((each for each in places if each.is_file()), None)
        if log is None:
            raise _RefusedError(f"missing: there is no log {written}, which it explains")
        if digest(self._logged(solution, log)).combined != said["digest"]:
            raise _RefusedError(f"stale: it explains a run other than that of {written}")
        causes = [each["text"] for each in said["causes"]]
        if solution.cause == "none" and (causes or said["uncompared"] or said["together"]):
            raise _RefusedError("contradicted: it has a cause, or candidates that were not compared")
        if solution.cause not in ("none", *causes):
            raise _RefusedError(f"another claim: its causes are {', '.join(causes) or 'none'}")
        self._repeat(log)

    def _study(self, solution: SolutionUse, path: Path) -> None:
        folder = SweepFolder.opened(path.parent)
        self._require_scenario(solution, folder)
        found = verify_folder(folder, self._level, self._rows, self._chosen)
        if found.missing or found.findings:
            first = next(iter(found.findings), None)
            told = f"{found.missing} runs are missing" if first is None else f"{first.column} is {first.found}"
            raise _RefusedError(f"unsound: {told}")
        try:
            differences = read_differences(path.parent, solution.column or "")
        except UnknownNameError as error:
            raise _RefusedError(f"another claim: {error}") from None
        compared = [each.comparison.mean for each in differences if each.cell.variant == solution.variant]
        if not compared:
            raise _RefusedError(f"another claim: {solution.variant} is not compared with another variant")
        for mean in compared:
            bound = mean.upper if solution.difference == "less" else mean.lower
            if not mean.method or not (bound < 0.0 if solution.difference == "less" else bound > 0.0):
                interval = f"{mean.value:.4g}, {mean.confidence:g}: {mean.lower:.4g} to {mean.upper:.4g}"
                raise _RefusedError(f"contradicted: the difference in {solution.column} is {interval}")

    def _budget(self, solution: SolutionUse, path: Path) -> None:
        said = _json(path)
        grid, levels = said["grid"], said["levels"]
        if solution.at_least not in grid:
            raise _RefusedError(f"another claim: {solution.at_least} is not a level of the budget")
        count = grid.index(solution.at_least) + 1
        certified = [each for each in levels[:count] if each["certified"]]
        if len(certified) < count or [each["value"] for each in certified] != grid[:count]:
            raise _RefusedError(f"another claim: certified up to {said['certified_up_to']}, not {solution.at_least}")
        for each in certified:
            certificate = path.parent / Path(each["folder"]).name / "certificate.json"
            if not certificate.is_file():
                raise _RefusedError(f"missing: {BUDGET} lacks the certificate of the level {each['value']}")
            read = opened(certificate).content["predicate"]
            if read["claim"]["text"] != said["claim"] or not read["established"]:
                raise _RefusedError(f"unsound: the certificate of the level {each['value']} is about another claim")
            self._require_scenario(solution, SweepFolder.opened(certificate.parent))
            self._verify(certificate)


def _covers(found: ClaimTerm, wanted: ClaimTerm) -> bool:
    """Return whether a term of a certificate implies a required one."""
    names = (set(found.satisfied), set(found.given)) == (set(wanted.satisfied), set(wanted.given))
    return names and found.probability >= wanted.probability


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


def _json(path: Path) -> Any:
    if path.stat().st_size > _MOST_BYTES:
        raise _RefusedError("unreadable: the file is too large")
    return json.loads(path.read_text(encoding="utf-8"))
