"""Flights: scenarios of the package, run by the command line and read from their logs."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from numpy.typing import NDArray
from simulating import Command, in_process

from symaware_cli import Log, open_log
from symaware_cli.log.logged_events import LoggedEvent

# How long an example takes says more about the machine than about the code.
settings.register_profile("aircraft", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("aircraft")


class Flight(NamedTuple):
    """A run.

    Attributes:
        log: What was recorded.
        own: The true states of the ownship; shape (steps + 1, 3).
        intruder: Those of the intruder, or of intruder.0.
    """

    log: Log
    own: NDArray[np.float64]
    intruder: NDArray[np.float64]

    @property
    def separation(self) -> NDArray[np.float64]:
        """The distance at every step [m]; shape (steps + 1,)."""
        apart: NDArray[np.float64] = np.hypot(*(self.own - self.intruder)[:, :2].T)
        return apart

    def events(self, name: str) -> list[LoggedEvent]:
        """The events of a name."""
        return [event for event in self.log.events() if event.name == name]


Fly = Callable[..., Flight]


@pytest.fixture(scope="session")
def scenarios() -> Path:
    """The folder of the package's scenarios."""
    return Path(__file__).parent.parent / "scenarios"


@pytest.fixture(scope="session")
def command() -> Command:
    """Run a verb of the command line, in this process."""
    return in_process


@pytest.fixture(scope="session")
def fly(tmp_path_factory: pytest.TempPathFactory, scenarios: Path, command: Command) -> Fly:
    """Run a scenario of the package, once for the same values."""
    flown: dict[tuple[object, ...], Flight] = {}

    def fly(scenario: str, *overrides: str, seed: int = 0) -> Flight:
        key = scenario, overrides, seed
        if key not in flown:
            path = tmp_path_factory.mktemp("flight") / "flight.mcap"
            sets = [word for override in overrides for word in ("--set", override)]
            done = command("run", scenarios / scenario, "--quiet", "--output", path, "--seed", seed, *sets)
            assert done.returncode in (0, 3), done.stderr
            log = open_log(path)
            # An aircraft that comes too close reports an error.
            assert (done.returncode == 3) == any(event.name == "too-close" for event in log.events()), done.stderr
            name = "intruder" if "intruder" in log.manifest["roster"] else "intruder.0"
            flown[key] = Flight(log, *(log.series(id, "world").values for id in ("ownship", name)))
        return flown[key]

    return fly
