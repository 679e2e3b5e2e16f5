"""Reading of sweeps from files or options into valid plans; all problems are found before the first run."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath

from symaware_cli.language import (
    MAX_PROBLEMS,
    Assignment,
    Catalogue,
    Path,
    Problem,
    ScenarioError,
    Source,
    SourceNode,
    assigned,
    decode,
    dotted,
    dumped,
    extracted,
    quoted,
    read,
    validate,
)
from symaware_cli.language.build import Built, build
from symaware_cli.language.compose import Composition
from symaware_cli.studies.metrics import BUILT_IN, RESERVED
from symaware_cli.studies.request import SweepRequest
from symaware_cli.studies.sweep_document import FORMAT, MOST_CELLS, MOST_RUNS, SweepDocument
from symaware_cli.studies.sweep_plan import ParameterChange, SweepPlan, cell_count

#: The key that identifies the file of a sweep.
MARK = "symaware-sweep"

#: The suffix of logs.
_LOG = ".mcap"


@dataclass(frozen=True, slots=True, weakref_slot=True)
class SweepSource:
    """A plan with the positions of its values in the source files.

    Attributes:
        plan: The plan.
        scenario: The scenario file; for a log, a temporary copy that lives as long as this object.
        name: Its name in messages.
        written: The content of the sweep file; None if the sweep was specified only by options.
    """

    plan: SweepPlan
    scenario: FilePath
    name: str
    written: bytes | None
    _root: SourceNode
    _sources: dict[str, Source]

    def assignments(self, changes: Sequence[ParameterChange]) -> list[Assignment]:
        """Return changes as assignments whose problems are located at their positions in the sweep."""
        # Each run has separate sources, so that its problems are reported without those of others.
        sources = {name: each.copy() for name, each in self._sources.items()}
        return [self._assignment(change, sources) for change in changes]

    def problem(self, code: str, message: str, path: Path) -> Problem:
        """Return a problem located at a value of the sweep."""
        span = self._root.nearest_span(path)
        return Problem(code, message, span, dotted(path), source_line=self._sources[span.file].line_text(span.line))

    def _assignment(self, change: ParameterChange, sources: dict[str, Source]) -> Assignment:
        key = change.place[: change.place.index(change.target) + 1]
        span = self._root.nearest_span(key, key=True)
        node = self._root.descendant(change.place)
        if node is None or node.plain() != change.value:
            node = SourceNode.of(change.value, self._root.nearest_span(change.place))
        return Assignment.at(sources[span.file], change.target, span, node)


def read_sweep(target: FilePath, request: SweepRequest | None = None) -> SweepSource:
    """Read a sweep, and check everything except the scenario.

    Args:
        target: A scenario, the file of a sweep, or a log, whose scenario is swept.
        request: Additional options.

    Raises:
        ScenarioError: The sweep is invalid; contains every problem found.
        LogError: The log cannot be read, or contains no scenario.
    """
    source = None if target.suffix == _LOG else read(target, str(target))
    root = source.root if source else None
    if source is not None and root is not None and isinstance(root.value, dict) and MARK in root.value:
        written: bytes | None = source.raw
    else:
        written, root, source = None, *_implied(target)
    sources = {source.name: source}
    asked = tuple((request or SweepRequest()).assignments())
    sources |= {each.source.name: each.source.copy() for each in asked}
    root = assigned(root, asked, sources)
    problems = [problem for each in sources.values() for problem in each.problems]
    if problems:
        raise ScenarioError(problems)
    composition = Composition(source.name, root, {}, sources)
    document = validate(SweepDocument, composition.data, composition, ())
    if isinstance(document, list):
        raise ScenarioError(document)
    problems = list(_faults(document, composition))
    if problems:
        raise ScenarioError(problems)
    scenario = target.parent / document.scenario
    if scenario.suffix != _LOG:
        return SweepSource(SweepPlan(document), scenario, str(scenario), written, root, sources)
    folder = tempfile.mkdtemp(prefix="symaware-")
    try:
        file, _ = extracted(scenario, FilePath(folder))
        found = SweepSource(SweepPlan(document), file, f"{scenario}:{file.name}", written, root, sources)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(found, shutil.rmtree, folder, ignore_errors=True)
    return found


def _implied(scenario: FilePath) -> tuple[SourceNode, Source]:
    """Return the default document of a sweep for a scenario."""
    source = decode("symaware sweep", scenario.name.encode())
    return SourceNode.of({MARK: FORMAT, "scenario": scenario.name}, source.at(0)), source


def _faults(document: SweepDocument, composition: Composition) -> Iterator[Problem]:
    """Yield the problems of a document that its types do not rule out."""
    seen: dict[str, Path] = {}
    places: list[Path] = [("over", path) for path in document.over]
    places += [("together", number, path) for number, lists in enumerate(document.together) for path in lists]
    for place in places:
        target = str(place[-1])
        if target in seen:
            message = f"{quoted(target)} varies twice"
            yield composition.problem("duplicate-key", message, place, key=True, expected="each value to vary once")
        seen[target] = place
        if target == "seed":
            message = "the seed of each run is derived from the sweep's `seed`"
            yield composition.problem("invalid-value", message, place, key=True, expected="`runs` for several seeds")
    for number, lists in enumerate(document.together):
        lengths = {path: len(values) for path, values in lists.items()}
        for path, length in lengths.items():
            first, wanted = next(iter(lengths.items()))
            if length != wanted:
                message = f"{quoted(path)} has {length} values, and {quoted(first)} has {wanted}"
                yield composition.problem("wrong-length", message, ("together", number, path), expected="as many")
    for name in sorted(document.metrics.keys() & {*RESERVED, *(each.name for each in BUILT_IN)}):
        message = f"every table has a column {quoted(name)}"
        yield composition.problem("duplicate-key", message, ("metrics", name), key=True, expected="another name")
    if document.paired and len(document.variants) < 2:
        message = "there is nothing to pair"
        yield composition.problem("invalid-value", message, ("paired",), key=True, expected="at least two `variants`")
    if document.until is not None and document.runs == 1:
        message = "`until` ends runs early, and there is one of each combination only"
        yield composition.problem("invalid-value", message, ("until",), key=True, expected="the most `runs`")
    if document.until is not None and document.paired:
        message = "paired variants have as many runs each, which `until` does not know of"
        yield composition.problem("invalid-value", message, ("until",), key=True, expected="either of them")
    if not document.is_independent and not document.drawn:
        message = f"`{document.design}` has nothing to draw"
        expected = "a distribution in `over`, such as {uniform: [0, 1]}"
        yield composition.problem("invalid-value", message, ("design",), key=True, expected=expected)
    if not document.is_independent and document.until is not None:
        message = f"`until` assumes independent runs, and those of the design `{document.design}` depend on each other"
        expected = "`design: random`, or all `runs` without `until`"
        yield composition.problem("invalid-value", message, ("until",), key=True, expected=expected)
    yield from _claim_faults(document, composition)
    cells = cell_count(document)
    if cells > MOST_CELLS or cells * document.runs > MOST_RUNS:
        message = f"the sweep has {cells:,} combinations and {cells * document.runs:,} runs"
        expected = f"at most {MOST_CELLS:,} combinations and {MOST_RUNS:,} runs"
        yield composition.problem("too-large", message, ("over",), key=True, expected=expected)


def _claim_faults(document: SweepDocument, composition: Composition) -> Iterator[Problem]:
    """Yield the problems of a claim."""
    claim = document.claimed
    if claim is None:
        return

    def problem(message: str, expected: str) -> Problem:
        return composition.problem("invalid-value", message, ("claim",), expected=expected)

    if document.until is not None:
        yield problem("`until` may end the runs when they suit the claim", "`sequential` in `claim` instead of `until`")
    if not document.is_independent:
        message = f"a claim assumes independent runs, and those of the design `{document.design}` depend on each other"
        yield problem(message, "`design: random`")
    needed = claim.least_runs(cell_count(document))
    if claim.rule == "fixed" and document.runs < needed:
        message = f"{document.runs:,} runs of each combination cannot establish it, even if none fails"
        yield problem(message, f"`runs` of at least {needed:,}, or `--with claim=none` for runs that certify nothing")


def build_cells(source: SweepSource, catalogue: Catalogue) -> Iterator[Built]:
    """Build the first run of every cell of a plan, and check representative values of drawn parameters.

    Raises:
        ScenarioError: A cell is invalid; contains the problems of all cells, each once.
    """
    plan = source.plan
    problems: dict[Problem, None] = {}

    def built_with(changes: Sequence[ParameterChange], index: int) -> Built:
        return build(source.scenario, source.assignments(changes), plan.seed(index), catalogue, source.name)

    for cell in plan.cells:
        try:
            built = built_with(plan.changes(cell.number), cell.number)
        except ScenarioError as error:
            problems.update(dict.fromkeys(error.problems))
            if len(problems) >= MAX_PROBLEMS:
                break
            continue
        if not problems:
            yield built
    if not problems:
        for changes in plan.landmark_changes():
            try:
                built_with(changes, 0)
            except ScenarioError as error:
                problems.update(dict.fromkeys(error.problems))
    if problems:
        raise ScenarioError(problems)


def written_again(document: SweepDocument, scenario: str, runs: int | None = None) -> bytes:
    """Serialize a document as the file of a sweep.

    Args:
        document: The document.
        scenario: The path of the scenario file to write.
        runs: The number of runs per cell; None for that of the document.
    """
    said = document.model_dump(by_alias=True, mode="json", exclude_defaults=True)
    said = {MARK: FORMAT, **said, "scenario": scenario}
    if runs is not None:
        said["runs"] = runs
    return dumped(said)
