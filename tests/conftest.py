"""Fixtures for tests of every folder: the command in a separate process, and plugins installed for one test."""

import ctypes
import gc
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import changed
import durations
import pytest
from features import (
    item_needs_pybullet,
    item_uses_missing,
    missing,
    module_needs_pybullet,
    module_uses_missing,
    without_pybullet,
)
from hypothesis import HealthCheck, settings
from simulating import COMMAND, Command, in_process
from symaware_doubles import COMPONENTS, ENVIRONMENTS, SUBSCRIBERS


def pytest_addoption(parser: pytest.Parser) -> None:
    durations.add_options(parser)
    changed.add_option(parser)


def pytest_configure(config: pytest.Config) -> None:
    """Enable Ctrl-C, which background jobs of a shell may ignore; distinguish short tests from long ones."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    durations.register(config)
    # Collecting twenty thousand tests makes no garbage to speak of, and looking for it took two fifths of the time.
    gc.disable()


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Look for garbage again, except among the tests and all that they imported."""
    gc.freeze()
    gc.enable()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out tests that a change does not concern and, in a copy without a feature, those that use it."""
    if changed.leaves_out(config, collection_path):
        return True
    if without_pybullet():
        file = collection_path / "conftest.py" if collection_path.is_dir() else collection_path
        if file.is_file() and file.suffix == ".py" and file != Path(__file__) and module_needs_pybullet(file):
            return True
    if missing() and collection_path.match("test_*.py"):
        return module_uses_missing(collection_path) or None
    return None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out, in such a copy, tests about scenarios that use the feature."""
    if missing():
        items[:] = [item for item in items if not item_uses_missing(item)]
    if without_pybullet():
        items[:] = [item for item in items if not item_needs_pybullet(item)]


# How long an example takes says more about the machine than about the code.
settings.register_profile("symaware", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("symaware")


@pytest.fixture
def process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """Run `symaware ARGUMENTS` to its end in a separate process, in an empty folder that becomes the present one."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
        line = [*COMMAND, *(str(argument) for argument in arguments)]
        settings: dict[str, Any] = {
            "stdin": subprocess.DEVNULL,
            "capture_output": True,
            "text": True,
            "timeout": 120,
            **options,
        }
        if "preexec_fn" in options:
            # A process with a limit would leave byte code that is cut off, for all that come after it.
            settings["env"] = {**(options.get("env") or os.environ), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(line, **settings)
        assert "Traceback (most recent call last)" not in (done.stderr or ""), done.stderr
        return done

    return run


@pytest.fixture
def command(process: Command) -> Command:
    """Run `symaware ARGUMENTS` in an empty folder; in a process of its own only if options of one are given.

    Most tests ask what the command says and does, not how it starts. What depends on a process takes `process`:
    terminals, signals, packages that come and go.
    """

    def run(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
        if options:
            return process(*arguments, **options)
        return in_process(*arguments)

    return run


@pytest.fixture
def ordinary_rights() -> Iterator[None]:
    """Take from root, for one test, the rights to read and write what its permissions forbid; others have none.

    The test stays the owner of its files. Another user might not even be able to read the installed Python.
    """
    if os.geteuid() != 0:
        yield
        return
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # _LINUX_CAPABILITY_VERSION_3, this thread
    sets = (ctypes.c_uint32 * 6)()  # effective, permitted, inheritable; then their upper halves
    assert libc.capget(header, sets) == 0
    effective = sets[0]
    sets[0] &= ~(1 << 1 | 1 << 2)  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
    assert libc.capset(header, sets) == 0, os.strerror(ctypes.get_errno())
    try:
        yield
    finally:
        sets[0] = effective
        assert libc.capset(header, sets) == 0


@pytest.fixture
def doubles(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install the plugins of symaware_doubles.py, here and for processes that are started, for one test."""
    here, installed = Path(__file__).parent, tmp_path_factory.mktemp("installed")
    information = installed / "symaware_doubles-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: symaware-doubles\nVersion: 1.0\n")
    lines = [
        *("[symaware.components]", "doubles.paper = paper_controller:MyController"),
        *(f"{name} = symaware_doubles:{kind}" for name, kind in COMPONENTS.items()),
        *("[symaware.environments]", *(f"{name} = symaware_doubles:{kind}" for name, kind in ENVIRONMENTS.items())),
        *("[symaware.transports]", "doubles.loud = transport_doubles:Loud"),
        *("[symaware.subscribers]", *(f"{name} = symaware_doubles:{kind}" for name, kind in SUBSCRIBERS.items())),
    ]
    (information / "entry_points.txt").write_text("\n".join(lines))
    path = [str(installed), str(here), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, path)))
    monkeypatch.syspath_prepend(installed)
    return here / "symaware_doubles.py"


@pytest.fixture(scope="session")
def scenarios() -> Path:
    """The folder of the runnable examples."""
    return Path(__file__).parent.parent / "scenarios"


SWAP = """\
symaware: 1
name: swap
seed: 5
run: {duration: 2.0}
environment: {use: kinematic}
agents:
  lone: {model: {use: single-integrator}, state: [9.0, 9.0]}
  robot:
    count: 3
    entity: {shape: {circle: {radius: 0.5}}}
    model: {use: unicycle, with: {max_speed: 3.0}}
    state: {circle: {radius: 1.5}}
    knowledge: {goal: {circle: {radius: 1.5, phase: 3.14159}}}
    components:
      sense: {use: perception.range, with: {range: 9.0, position_noise: 0.1}}
      steer: {use: control.go-to-goal, with: {speed: 3.0}}
"""


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small scenario, in a folder of its own that is the present one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swap.yaml").write_text(SWAP)
    return tmp_path / "swap.yaml"
