"""What must hold of every run, whatever its scenario: each promise of the documentation as a check of one scenario."""

from __future__ import annotations

import gc
import json
import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fuzzing.subject import PATIENCE, Skipped, Subject, equal, kinds, same, same_logs, same_series
from fuzzing.target import Finding
from fuzzing.variants import (
    by_workers,
    in_several_files,
    in_the_other_mode,
    in_toml,
    paced,
    permuted,
    with_a_far_agent,
    with_an_absent_agent,
)

#: Fields of a summary that depend on the machine or the place of the log.
_OF_THE_MACHINE = frozenset({"wall_time", "log", "log_size", "traceback", "pace", "overruns", "real_time_factor"})

#: Columns of a sweep's table that depend on the machine.
_OF_THE_TABLE = frozenset({"wall_time", "log"})


def _figures(summary: Any) -> Mapping[str, Any]:
    return {
        key: value
        for key, value in summary.to_json().items()
        if key not in _OF_THE_MACHINE and key != "real_time_factor"
    }


def twice(subject: Subject) -> None:
    """A run that is repeated writes the same log."""
    again = subject.run(subject.path, "again")
    same("figures", _figures(subject.result.summary), _figures(again.summary))
    same_logs(subject, subject.log, Path(again.log_path))


def verified(subject: Subject) -> None:
    """`verify` finds the log of a run equal."""
    import symaware_cli as sa

    result = sa.verify_log(subject.log)
    if not result.is_equal:
        found = result.difference or result.attachments[0]
        raise Finding("different", f"verify: {found} written by {result.writer}", f"verify {kinds([found.topic])}")


def from_the_log(subject: Subject) -> None:
    """The run of a log is that of its scenario."""
    again = subject.run(subject.log, "from-log")
    same_logs(subject, subject.log, Path(again.log_path), only_channels=True)


def checked(subject: Subject) -> None:
    """`check` gives the outcomes of the run, read from its log."""
    import symaware_cli as sa

    if subject.tree.get("recording", {}).get("interval"):
        raise Skipped("not every step is recorded")
    try:
        result = sa.check_log(subject.log)
    except sa.LogError as error:
        if "out of the log" in str(error):
            raise Skipped("not recorded") from error
        raise
    _same_outcomes("check", subject.result.summary.specifications, result.specifications)


def repeated_check(subject: Subject) -> None:
    """`check --again` gives the outcomes of the run."""
    import symaware_cli as sa

    subject.require_finished()
    _same_outcomes("again", subject.result.summary.specifications, sa.check_log(subject.log, again=True).specifications)


def _same_outcomes(name: str, ones: Sequence[Any], others: Sequence[Any]) -> None:
    from dataclasses import asdict

    for one, other in zip(ones, others, strict=True):
        first, second = asdict(one), asdict(other)
        for key in first:
            if not equal(first[key], second[key]):
                text = f"{one.name}: {key} is {first[key]!r} of the run and {second[key]!r} of {name}; {one.formula}"
                raise Finding("different", text, f"{name}: {key}")


def restored(subject: Subject) -> None:
    """A state that is restored while a log is written continues as if nothing had been."""
    subject.require_finished()
    _rewound(subject, subject.chance.randint(1, max(subject.result.summary.steps - 1, 1)))


def restored_at_the_start(subject: Subject) -> None:
    """A state from before the first step resets a run and its log."""
    subject.require_finished()
    _rewound(subject, 0)


def _rewound(subject: Subject, begin: int) -> None:
    import symaware_cli as sa

    path = subject.folder / f"rewound-{begin}.mcap"
    with sa.Scenario(subject.path).start(output=path) as simulation:
        if begin and not simulation.done:
            simulation.step(begin)
        if simulation.done:
            raise Skipped("over before")
        state = _captured(simulation)
        simulation.step(subject.chance.randint(1, max(subject.result.summary.steps - begin - 1, 1)))
        if not simulation.done:
            simulation.restore(state)
            simulation.finish()
    same_logs(subject, subject.log, path)


def restored_elsewhere(subject: Subject) -> None:
    """A state that is restored from bytes in another simulation gives the same end, before and after it has run."""
    import symaware_cli as sa

    subject.require_finished()
    steps = subject.result.summary.steps
    begin = subject.chance.choice([0, subject.chance.randint(0, max(steps - 1, 0))])
    with sa.Scenario(subject.path).start() as simulation:
        if begin:
            simulation.step(begin)
        data = _captured(simulation).to_bytes()
        simulation.finish()
        ends = _ends(simulation)
    with sa.Scenario(subject.path).start() as other:
        ahead = subject.chance.choice([0, steps])
        if ahead:
            other.step(ahead)
        try:
            other.restore(sa.SimulationState.from_bytes(data))
        except sa.StateError as error:
            if "is over" in str(error):  # with a pace or workers a run that has ended stays so
                raise Skipped(str(error).rpartition(": ")[2]) from error
            raise
        other.finish()
        for key, value in _ends(other).items():
            same(f"restored: {key.partition(' ')[0]}", ends[key], value)


def _captured(simulation: Any) -> Any:
    import symaware_cli as sa

    try:
        return simulation.capture()
    except sa.StateError as error:
        text = str(error)
        if "engine" in text or "waits" in text or "is over" in text:
            raise Skipped(text.rpartition(": ")[2]) from error
        raise


def _ends(simulation: Any) -> Mapping[str, Any]:
    ends = {f"state of {name}": simulation.state(name) for name in simulation.groups}
    ends |= {f"belief of {name}": simulation.belief(name) for name in simulation.groups}
    ends["steps"] = simulation.steps
    for each in simulation.result.summary.specifications:
        ends[f"outcome of {each.name}"] = (each.verdict, each.robustness)
    return ends


def branched(subject: Subject) -> None:
    """A branch without a change is the same run."""
    import symaware_cli as sa

    subject.require_finished()
    step = subject.tree["environment"]["with"]["time_step"]
    at = step * subject.chance.randint(0, max(subject.result.summary.steps - 1, 0))
    path = subject.folder / "branch.mcap"
    made = sa.branch(subject.log, at, output=path)
    same("figures", _figures(subject.result.summary), _figures(made.summary))
    same_logs(subject, subject.log, path, only_channels=True)


def _sweep(subject: Subject, folder: Path | None = None, **options: Any) -> Any:
    import symaware_cli as sa

    try:
        return sa.sweep(subject.path, folder, **options)
    except sa.ScenarioError:
        # With another seed, links and agents may be elsewhere than a component needs them.
        random = subject.tree.get("topology", {}).get("use") == "random"
        if random or "knowledge.strategy" in json.dumps(subject.tree):
            raise Skipped("refused with another seed") from None
        raise


def swept(subject: Subject) -> None:
    """The rows of a sweep are those of single runs, whether runs are batched or not."""
    subject.require_finished()
    runs, seed = 3, subject.chance.randrange(1000)
    options: dict[str, Any] = {"runs": runs, "seed": seed, "timeout": PATIENCE}
    folder = subject.folder / "sweep"
    batched = _sweep(subject, folder, **options)
    single = _sweep(subject, batch=1, **options)
    for name in batched.column_names:
        if name not in _OF_THE_TABLE:
            same(f"batched: {name.partition('.')[0]}", batched[name].to_pylist(), single[name].to_pylist())
    index = subject.chance.randrange(runs)
    if batched["state"][index].as_py() == "done":
        from symaware_cli.api import scenario_of

        scenario = scenario_of(folder, index)
        result = scenario.run(record=False, timeout=PATIENCE)
        for outcome in result.summary.specifications:
            column = f"satisfied.{outcome.name}"
            if column in batched.column_names:
                told = batched[column][index].as_py()
                known = {"satisfied": True, "violated": False}.get(outcome.verdict)
                if told != known and told not in (outcome.verdict, None):
                    raise Finding("different", f"{column} is {told} in the table, {outcome.verdict} alone", "row")


def swept_by_workers(subject: Subject) -> None:
    """Worker processes make the rows that this process makes, and `verify` finds them sound."""
    import symaware_cli as sa

    subject.require_finished()
    options: dict[str, Any] = {"runs": 3, "seed": subject.chance.randrange(1000), "timeout": PATIENCE}
    folder = subject.folder / "workers"
    ours, theirs = _sweep(subject, **options), _sweep(subject, folder, jobs=2, keep="all", **options)
    for name in ours.column_names:
        if name not in _OF_THE_TABLE:
            same(f"workers: {name.partition('.')[0]}", ours[name].to_pylist(), theirs[name].to_pylist())
    result = sa.verify_sweep(folder, "all")
    # Which BLAS libraries are loaded depends on what this process did before, and not on the sweep.
    findings = [each for each in result.findings if not each.column.startswith("log, version")]
    if findings:
        raise Finding("unsound", f"an honest sweep: {findings[0]}", f"unsound {findings[0].column.partition('.')[0]}")


def merged(subject: Subject) -> None:
    """Several processes without a pace give the run of one process."""
    import symaware_cli as sa
    from symaware_cli.processes import merge, open_process_logs

    subject.require_finished()
    agents = sorted(subject.tree["agents"])
    if not agents:
        raise Skipped("no agents")
    if subject.tree["run"].get("pace"):
        raise Skipped("with a pace, messages may be late")
    if subject.tree["run"].get("turn_limit"):
        raise Skipped("the host is a thread here, and limits of turns hold in the main thread only")
    logs = [subject.folder / "host.mcap", subject.folder / "member.mcap"]
    known, address, failures = threading.Event(), [], []

    def tell(event: Any) -> None:
        if event.name == "waiting":
            address.append(event.data.get("address"))
            known.set()

    def host() -> None:
        try:
            place = sa.Place.host(0, agents[1:], wait=PATIENCE)
            sa.Scenario(subject.path).run(output=logs[0], place=place, on_event=tell, timeout=PATIENCE)
        except BaseException as error:
            failures.append(error)
        known.set()

    thread = threading.Thread(target=host, daemon=True)
    thread.start()
    known.wait(PATIENCE)
    if not address:
        thread.join(PATIENCE)
        refusals = (sa.ScenarioError, sa.DistributionError, sa.RunFailedError, sa.TransportError)
        if failures and isinstance(failures[0], refusals):
            raise Skipped("refused in several processes")
        raise Finding("different", f"the host does not listen: {failures}", "host")
    sa.Scenario(subject.path).run(
        output=logs[1], place=sa.Place.member(address[0], agents[0], wait=PATIENCE), timeout=PATIENCE
    )
    thread.join(PATIENCE)
    if failures:
        raise failures[0]
    merge(open_process_logs(logs), subject.folder / "merged.mcap")
    one, several = sa.open_log(subject.log), sa.open_log(subject.folder / "merged.mcap")
    for group in agents:
        for field in ("world", "state"):
            same_series(one, several, group, field, f"merged: {field}")


def exported(subject: Subject) -> None:
    """A table of states has the numbers of the log."""
    from pyarrow import parquet

    import symaware_cli as sa
    from symaware_cli.views.exporting.parquet import ParquetTables

    log = sa.open_log(subject.log)
    folder = subject.folder / "tables"
    ParquetTables().export(log, folder)
    for group in subject.tree["agents"]:
        for field in ("world", "state"):
            file = folder / field / f"{group}.parquet"
            if not file.exists():
                continue
            table = parquet.read_table(file)
            series = log.series(group, field)
            ids = list(log.agents[group])
            times = np.round(table["time"].to_numpy() * 1e9).astype(np.int64)
            rows = np.array([ids.index(each) for each in table["agent"].to_pylist()], int)
            at = np.searchsorted(series.times, times)
            # A group without a count has the name of its agent, and a series without an axis of agents.
            known = series.values.reshape(len(series.times), -1, max(len(series.columns), 1))
            for place, column in enumerate(series.columns):
                if column in table.column_names:
                    values = known[at, rows, place] if len(rows) else np.empty(0)
                    same(f"exported: {field}", table[column].to_numpy(), values)


def told_alike(subject: Subject) -> None:
    """`inspect` tells the outcomes that the run told."""
    import symaware_cli as sa
    from symaware_cli.log import overview_of

    _same_outcomes(
        "inspect", subject.result.summary.specifications, overview_of(sa.open_log(subject.log)).specifications
    )


def reported(subject: Subject) -> None:
    """The page of `report` has the verdict and the robustness of each specification."""
    import symaware_cli as sa

    page = subject.folder / "page.html"
    sa.write_report(subject.log, page)
    text = page.read_text()
    for each in subject.result.summary.specifications:
        if f">{each.verdict}</b>" not in text:
            raise Finding("different", f"the page does not say that {each.name} is {each.verdict}", "report: verdict")
        if each.robustness is not None and f"{each.robustness:.6g}" not in text:
            raise Finding(
                "different", f"the page has no robustness {each.robustness:.6g} of {each.name}", "report: robustness"
            )


#: Collect unreachable objects every so many invariants.
_COLLECT = 5

#: The invariants, each with the share of scenarios that it is checked of: those that start processes cost seconds.
INVARIANTS: Mapping[Callable[[Subject], None], float] = {
    twice: 1.0,
    verified: 1.0,
    from_the_log: 0.3,
    checked: 1.0,
    repeated_check: 0.3,
    restored: 1.0,
    restored_at_the_start: 1.0,
    restored_elsewhere: 1.0,
    branched: 1.0,
    permuted: 1.0,
    in_toml: 0.3,
    in_several_files: 0.5,
    in_the_other_mode: 0.5,
    paced: 0.3,
    with_an_absent_agent: 1.0,
    with_a_far_agent: 1.0,
    exported: 0.5,
    told_alike: 1.0,
    swept: 0.15,
    merged: 0.15,
    by_workers: 0.1,
    swept_by_workers: 0.05,
    reported: 0.05,
}


def check(subject: Subject, names: Sequence[str] | None = None) -> tuple[Counter[str], list[Finding]]:
    """Check invariants of a scenario.

    Args:
        subject: The scenario.
        names: Which; by default each with its share.

    Returns:
        How many held, and how many did not apply and why; and those that do not hold.
    """
    counts: Counter[str] = Counter()
    findings: list[Finding] = []
    try:
        counts[f"runs {subject.result.status}"] += 1
    except Skipped as skipped:
        return Counter({f"not checked: {skipped}": 1}), findings
    for number, (invariant, share) in enumerate(INVARIANTS.items()):
        name = invariant.__name__
        subject.reseeded(name)
        if name not in names if names is not None else subject.chance.random() >= share:
            continue
        # Runs that ended hold each other until a full collection, which is rare, and their solvers much memory; but a
        # collection takes a tenth of what an invariant takes.
        if not number % _COLLECT:
            gc.collect()
        try:
            invariant(subject)
        except Skipped as skipped:
            counts[f"{name} skipped: {skipped!s:.40}"] += 1
        except Finding as finding:
            findings.append(Finding(name, str(finding), finding.where))
        except Exception as error:
            findings.append(_failed(name, error))
        else:
            counts[name] += 1
    return counts, findings


def _failed(name: str, error: Exception) -> Finding:
    """An exception of an invariant as a finding, by the place of the package where it was raised."""
    import traceback

    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/symaware_cli/" in frame.filename]
    place = f"{frames[-1].filename.rpartition('/')[2]}:{frames[-1].name}" if frames else "here"
    text = "".join(traceback.format_exception(error))
    return Finding(name, text, f"{type(error).__name__} in {place}")
