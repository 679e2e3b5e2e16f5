"""The folder of a sweep: the request, the scenario, the versions, the journal, the table and the logs."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from symaware_cli.engine import Simulation
from symaware_cli.language import Assignment, Catalogue, ScenarioError, open_scenario, write_log
from symaware_cli.language.versions import versions
from symaware_cli.log import OutputError, reason
from symaware_cli.studies.cell_stops import check_rule
from symaware_cli.studies.custom_metrics import CustomMetrics
from symaware_cli.studies.executor import Block
from symaware_cli.studies.identity import SweepIdentity, differences, scenario_digests
from symaware_cli.studies.row import Row
from symaware_cli.studies.runner import Runner
from symaware_cli.studies.sweep_error import SweepError, listed
from symaware_cli.studies.sweep_files import IDENTITY, LOGS, SCENARIO, SWEEP, TABLE, WRITTEN, is_sweep
from symaware_cli.studies.sweep_plan import SweepPlan
from symaware_cli.studies.sweep_source import SweepSource, build_cells, read_sweep, written_again


@dataclass(frozen=True)
class SweepFolder:
    """The folder of a sweep.

    Attributes:
        path: The folder.
        source: The source of its plan.
    """

    path: Path
    source: SweepSource

    @classmethod
    def opened(cls, path: str | os.PathLike[str]) -> SweepFolder:
        """Open the folder of an existing sweep.

        Raises:
            SweepError: The folder contains no sweep.
            ScenarioError: Its files are damaged.
        """
        folder = Path(path)
        if not is_sweep(folder):
            raise SweepError(f"{folder} is not the folder of a sweep")
        return cls(folder, read_sweep(folder / SWEEP))

    @classmethod
    def created(cls, path: Path, source: SweepSource) -> SweepFolder:
        """Create the folder of a checked sweep; an existing folder has to be empty.

        Raises:
            ScenarioError: A cell is invalid; nothing was created.
            SweepError: The folder cannot be created.
        """
        files: dict[str, bytes] = {}
        identity, names = identity_of(source, files)
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise SweepError(f"{path} is there already, and is not the folder of a sweep")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # The whole folder appears atomically.
            draft = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
            try:
                _write_all(draft, source, identity, names, files)
                os.replace(draft, path)
            finally:
                shutil.rmtree(draft, ignore_errors=True)
        except OSError as error:
            raise OutputError(f"cannot create {path}: {reason(error)}") from error
        return cls.opened(path)

    def changes(self, index: int) -> list[Assignment]:
        """Return the changes that a run makes to the scenario of the sweep.

        Raises:
            SweepError: There is no such run.
        """
        if not 0 <= index < self.plan.count:
            raise SweepError(f"{self.path} has no run {index}: they are numbered from 0 to {self.plan.count - 1}")
        return [each.assignment() for each in self.plan.changes(index)]

    def make_again(self, index: int, output: Path) -> None:
        """Repeat a run to write its log.

        Args:
            index: The number of the run.
            output: The path of the log.

        Raises:
            SweepError: There is no such run.
            ScenarioError: The scenario is no longer valid.
            RunError: The run failed.
            KeyboardInterrupt: A signal ended the run.
            LogError: The log cannot be written.
        """
        write_log(open_scenario(self.source.scenario, self.changes(index), self.plan.seed(index)), output)

    @property
    def plan(self) -> SweepPlan:
        """The plan of the sweep."""
        return self.source.plan

    @property
    def logs(self) -> Path:
        """The folder of the logs."""
        return self.path / LOGS

    @cached_property
    def identity(self) -> SweepIdentity:
        """The identity of the inputs and code that produced the rows.

        Raises:
            SweepError: The file is damaged.
        """
        file = self.path / IDENTITY
        try:
            found = SweepIdentity.from_json(json.loads(file.read_bytes()))
            if len(found.cells) != len(self.plan.cells):
                raise ValueError(f"it has {len(found.cells):,} combinations, and the plan has {len(self.plan.cells):,}")
            return found
        except (OSError, ValueError, RecursionError) as error:
            raise SweepError(f"{file} is damaged: {error}") from error

    def scenario_files(self) -> Mapping[str, bytes]:
        """Return the files of the scenario, its bases and its assets, by path in the folder, sorted."""
        files = sorted(each for each in (self.path / SCENARIO).rglob("*") if each.is_file())
        return {each.relative_to(self.path).as_posix(): each.read_bytes() for each in files}

    @property
    def specifications(self) -> Sequence[str]:
        """The names of the specifications of all cells."""
        return self.identity.specifications

    def runner(
        self, batch: int | None = None, follow: Callable[[Sequence[int], Simulation], object] | None = None
    ) -> Runner:
        """Return a runner in this process.

        Args:
            batch: See `Runner`.
            follow: See `Runner`.
        """
        return Runner(self.plan, self.source.scenario, batch, follow)

    def one_by_one(self, batch: int | None = None) -> str | None:
        """Return why runs of one combination are executed one by one; None if they are batched.

        Args:
            batch: See `Runner`.
        """
        plan = self.plan
        return self.runner(batch).refusal(range(0, min(plan.count, 2 * len(plan.cells)), len(plan.cells)))

    def check(self) -> None:
        """Check that further rows would be produced by the same files and versions.

        Raises:
            SweepError: They would not; the message lists the differences.
        """
        found, _ = identity_of(self.source, {})
        different = differences(self.identity, found)
        if different:
            raise SweepError(listed(f"{self.path} cannot be resumed: rows would not be comparable", different))

    def compare(self, source: SweepSource) -> None:
        """Check that a request matches the sweep in the folder.

        Raises:
            SweepError: It does not; the message lists the differences.
        """
        mine, other = (each.plan.document.model_dump(by_alias=True) for each in (self.source, source))
        different = [
            f"{key}: {_short(mine[key])} there, {_short(other[key])} now"
            for key in mine
            if key not in ("scenario", "description") and mine[key] != other[key]
        ]
        files: dict[str, bytes] = {}
        identity_of(source, files)
        folder = self.source.scenario.parent
        for name, content in sorted(files.items()):
            kept = folder / name
            if not kept.exists() or kept.read_bytes() != content:
                different.append(f"the file {name} is another one")
        if different:
            message = f"{self.path} has another sweep; `symaware resume {self.path}` resumes that"
            raise SweepError(listed(message, different))

    def add_runs(self, count: int) -> SweepFolder:
        """Plan further runs of each cell; existing runs keep their numbers and drawn values.

        Raises:
            SweepError: Another process is working on the folder, or runs cannot be added to the design.
            ScenarioError: The scenario cannot be built.
        """
        if self.plan.document.design == "latin-hypercube":
            raise SweepError(
                f"no runs can be added to {self.path}: a Latin hypercube is drawn for all of its runs at once; make "
                "another sweep, with more `runs` or another `seed`, or with `design: sobol`, which can be continued"
            )
        claim = self.plan.document.claimed
        if claim is not None and claim.rule == "fixed":
            raise SweepError(
                f"no runs can be added to {self.path}: `{claim}` is decided by the {self.plan.document.runs:,} runs "
                "that were planned; make another sweep, with another `seed` and more `runs` or a `sequential` claim"
            )
        # Of a scenario that cannot be built, such as one with code that is not trusted, the table is kept.
        with next(build_cells(self.source, Catalogue())).simulation.environment:
            pass
        with self.locked():
            document = SweepFolder.opened(self.path).plan.document  # as the previous holder of the lock left it
            draft = self.path / f".{SWEEP}"
            draft.write_bytes(written_again(document, document.scenario, runs=document.runs + count))
            os.replace(draft, self.path / SWEEP)
            (self.path / TABLE).unlink(missing_ok=True)  # it contains the number of planned runs
        return SweepFolder.opened(self.path)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the lock that prevents other processes from adding rows.

        Raises:
            SweepError: Another process holds the lock.
        """
        import fcntl

        with open(self.path / ".lock", "w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise SweepError(f"another process is at work on {self.path}") from None
            yield


def identity_of(source: SweepSource, files: dict[str, bytes]) -> tuple[SweepIdentity, Mapping[str, bytes]]:
    """Build every cell, return the identity of future rows, and collect the files of all cells.

    Raises:
        ScenarioError: A cell or the stopping rule is invalid.
    """
    scenarios: list[dict[str, Any]] = []
    specifications: dict[str, None] = {}
    catalogue = Catalogue()
    custom = CustomMetrics(source.plan.document, catalogue)
    for built in build_cells(source, catalogue):
        with built.simulation.environment:
            problems = [
                custom.check(name, built, source.problem("invalid-metric", "", ("metrics", name)))
                for name in source.plan.document.metrics
            ]
            if any(problems):
                raise ScenarioError(filter(None, problems))
            # Converted through JSON, so that it equals the value that is read back from the file.
            scenarios.append(json.loads(json.dumps(built.data)))
            specifications.update(dict.fromkeys(built.document.specifications))
            if other := next(
                (name for name in built.files if files.get(name, built.files[name]) != built.files[name]), None
            ):
                message = f"the file {other} is another one in some of its combinations; sweep the folders one by one"
                raise ScenarioError([source.problem("invalid-value", message, ("over",))])
            files.update(built.files)
    check_rule(source.plan, list(specifications), source.problem("invalid-rule", "", ("until",)))
    claim = source.plan.document.claimed
    unknown = [] if claim is None else [name for name in claim.names if name not in specifications]
    if unknown:
        message = f"there is no specification `{unknown[0]}` to claim anything about"
        problem = source.problem("unknown-name", message, ("claim",))
        known = ", ".join(specifications) or "one in `specifications` of the scenario"
        raise ScenarioError([replace(problem, expected=known)])
    cells = scenario_digests(scenarios, files)
    return SweepIdentity(cells, list(specifications), versions(), scenarios[0]), files


def _write_all(
    folder: Path, source: SweepSource, identity: SweepIdentity, names: Mapping[str, bytes], files: Mapping[str, bytes]
) -> None:
    for name, content in files.items():
        file = folder / SCENARIO / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    (folder / LOGS).mkdir()
    document = source.plan.document
    (folder / SWEEP).write_bytes(written_again(document, f"{SCENARIO}/{source.scenario.name}"))
    if source.written is not None:
        (folder / WRITTEN).write_bytes(source.written)
    (folder / IDENTITY).write_text(json.dumps(identity.to_json(), indent=1) + "\n")
    os.chmod(folder, 0o755)


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."


class SweepWork:
    """`Work` that produces the rows of a sweep."""

    def __init__(self, folder: str, batch: int | None) -> None:
        """Prepare; the folder need not exist before `open`.

        Args:
            folder: The folder of the sweep.
            batch: See `Runner`.
        """
        self._path = folder
        self._batch = batch
        self._opened: tuple[Path, Runner] | None = None

    def open(self) -> None:
        """See `Work`."""
        self._made()

    def prepare(self) -> None:
        """See `Work`."""
        self._made()[1].prepare()

    def results(self, block: Block) -> Iterator[Row]:
        """See `Work`."""
        logs, runner = self._made()
        yield from runner.rows(block.indices, logs if block.is_recorded else None)

    def to_json(self) -> dict[str, Any]:
        """See `Work`."""
        return {"folder": self._path, "batch": self._batch}

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> SweepWork:
        """See `Work`."""
        return cls(**content)

    def received(self, content: dict[str, Any]) -> Row:
        """See `Work`."""
        return Row(**content)

    def lost(self, index: int, why: str) -> Row:
        """See `Work`."""
        return Row(index, "lost", error=why)

    def _made(self) -> tuple[Path, Runner]:
        """Return the folder of the logs and the runner, created on first use."""
        if self._opened is None:
            folder = SweepFolder.opened(self._path)
            self._opened = folder.logs, folder.runner(self._batch)
        return self._opened
