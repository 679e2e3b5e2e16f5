"""What tests of every folder share: the command in a process of its own, and plugins installed for one test."""

import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from simulating import COMMAND, Command
from symaware_doubles import COMPONENTS, ENVIRONMENTS, TRANSPORTS


def pytest_configure() -> None:
    """Keep no strategies, and make Ctrl-C count: what runs in the background of a shell may ignore it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ["SYMAWARE_CACHE"] = ""  # nothing is kept from test to test


# How long an example takes says more about the machine than about the code.
settings.register_profile("symaware", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("symaware")


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """Run `symaware ARGUMENTS` to its end, in an empty folder that becomes the present one."""
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
        done = subprocess.run(line, **settings)
        assert "Traceback (most recent call last)" not in (done.stderr or ""), done.stderr
        return done

    return run


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
        *("[symaware.transports]", *(f"{name} = symaware_doubles:{kind}" for name, kind in TRANSPORTS.items())),
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
