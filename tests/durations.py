"""The durations of tests, and the `long` ones, which are listed in `durations.tsv`.

    pytest -n auto -m '' --record-durations            write the list anew, for the files whose tests ran
    pytest --limit SECONDS                             fail if a test that is not listed takes longer
    pytest --share 1/2                                 run the tests of about half the files, and with 2/2 the others

A duration is the processor time that a test and the processes that it waited for used, so that a busy machine does not
change it much. What prepares it is not counted: a fixture that several tests share is prepared for whichever is first.
For the same reason packages that are slow to import are imported before the first test, and a test that exceeds the
limit is measured again: Hypothesis reads all modules at its first example in a fresh clone.

Tests marked `slow` are listed only if they take longer than `FIRST`. The longest of all tests are run first, so that
with `--dist loadgroup`, which gives each worker the next test in turn, none is waited for at the end.

Reasons: docs/decisions/0074-short-and-long-tests.md
"""

import importlib
import os
import subprocess
import sys
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

LIST = Path(__file__).with_name("durations.tsv")

PACKAGES = (
    *("casadi", "matplotlib.figure", "osqp", "pandas", "polars", "pyarrow.parquet", "pybullet", "pymunk", "rerun"),
    *("scipy.stats", "xarray"),
)

LONG = 0.3
"""A test that takes longer is listed [s]."""

FIRST = 10.0
"""Tests that take longer are run before all others [s]."""


def processor_time() -> float:
    """Processor time of this process and of those that it has waited for [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def listed() -> dict[str, float]:
    """The duration [s] of each long test."""
    lines = LIST.read_text(encoding="utf-8").splitlines()
    return {name: float(seconds) for seconds, _, name in (line.partition("\t") for line in lines)}


class Durations:
    """Pytest's hooks; one object for the processes that run tests, and for the one that gets their reports.

    Attributes:
        seconds: The duration of each test that has run.
    """

    def __init__(self, record: bool, limit: float | None, once: bool = False) -> None:
        self.seconds: dict[str, float] = {}
        self._slow: set[str] = set()
        self._record, self._limit, self._once = record, limit, once
        self._long = listed()

    @property
    def exceeding(self) -> dict[str, float]:
        """Tests that are not listed and take longer than the limit."""
        limit = self._limit if self._limit is not None else float("inf")
        return {name: value for name, value in self.seconds.items() if name not in self._long and value > limit}

    def pytest_collection_finish(self) -> None:
        if self._record or self._limit is not None:
            for package in PACKAGES:
                with suppress(ImportError):
                    importlib.import_module(package)

    # `-m` selects, so the markers must be there first.
    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        for item in items:
            if item.nodeid in self._long and not item.get_closest_marker("slow"):
                item.add_marker("long")
        # The others keep their order, in which tests of a module share what prepares them.
        items.sort(key=lambda item: -seconds if (seconds := self._long.get(item.nodeid, 0.0)) > FIRST else 0.0)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        began = processor_time()
        try:
            return (yield)
        finally:
            item.user_properties.append(("processor_time", processor_time() - began))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call":
            # With --dist loadgroup, names have their group behind them.
            name = report.nodeid.partition("@")[0]
            self.seconds[name] = float(str(dict(report.user_properties)["processor_time"]))
            if "slow" in report.keywords:
                self._slow.add(name)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if hasattr(session.config, "workerinput"):
            return
        if self._record:
            ran = {name.partition("::")[0] for name in self.seconds}
            known = {name: value for name, value in self._long.items() if name.partition("::")[0] not in ran}
            known |= {n: value for n, value in self.seconds.items() if value > (FIRST if n in self._slow else LONG)}
            lines = [f"{value:.1f}\t{name}" for name, value in sorted(known.items())]
            LIST.write_text("\n".join(lines) + "\n", encoding="utf-8")
        if self.exceeding and session.exitstatus == pytest.ExitCode.OK and (self._once or self._exceed_again(session)):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def _exceed_again(self, session: pytest.Session) -> bool:
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", ""]
        again = [*command, "--limit", str(self._limit), "--once", *self.exceeding]
        # Options of this call are not for that one.
        environment = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}
        done = subprocess.run(again, cwd=session.config.rootpath, env=environment)
        return done.returncode != pytest.ExitCode.OK

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        if self._limit is None and not self._record:
            return
        terminalreporter.section("processor time")
        long = sum(value for name, value in self.seconds.items() if name in self._long)
        terminalreporter.line(f"{sum(self.seconds.values()):.0f} s, of which {long:.0f} s in tests that are listed")
        for name, value in sorted(self.exceeding.items()):
            first = "" if self._once else ", measured once"
            terminalreporter.line(f"{value:.1f} s: {name} is neither short nor in {LIST.name}{first}", red=self._once)


class Share:
    """One share of several of all test files, chosen by the checksums of their names: each file is in one share."""

    def __init__(self, text: str) -> None:
        try:
            self._number, self._count = map(int, text.split("/"))
        except ValueError:
            raise pytest.UsageError(f"--share is written like 1/2, not {text}") from None
        if not 1 <= self._number <= self._count:
            raise pytest.UsageError(f"--share {text}: the first number is from 1 to the second")

    def pytest_ignore_collect(self, collection_path: Path, config: pytest.Config) -> bool | None:
        """Leave out a file before it is imported."""
        if not collection_path.match("test_*.py"):
            return None
        name = collection_path.relative_to(config.rootpath).as_posix()
        return zlib.crc32(name.encode()) % self._count != self._number - 1 or None


def add_options(parser: pytest.Parser) -> None:
    """The options of `Durations` and `Share`."""
    group = parser.getgroup("durations")
    group.addoption("--record-durations", action="store_true", help=f"write {LIST.name} anew for the files that ran")
    group.addoption("--limit", type=float, metavar="SECONDS", help="the longest that a test may take that is not long")
    group.addoption("--share", metavar="K/N", help="run the tests of one of N shares of the files only")
    group.addoption("--once", action="store_true", help="believe the first measurement")


def register(config: pytest.Config) -> None:
    """Let `Durations` watch the tests, and `Share` choose among them, as the options ask."""
    config.pluginmanager.register(
        Durations(config.option.record_durations, config.option.limit, config.option.once), "durations"
    )
    if config.option.share:
        config.pluginmanager.register(Share(config.option.share), "share")
