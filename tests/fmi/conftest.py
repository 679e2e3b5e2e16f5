"""Small FMUs, made of Python by pythonfmu3."""

import gc
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pythonfmu3 import FmuBuilder

CART = '''
from pythonfmu3 import Float64, Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Variability


class Cart(Fmi3Slave):
    """Integrates a speed; it breaks beyond 5 m."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.x, self.speed, self.gain, self.count = 0.0, 0.0, 0.0, 1.0, 7.0
        add = self.register_variable
        causes, varies = Fmi3Causality, Fmi3Variability
        add(Float64("time", causality=causes.independent, variability=varies.continuous))
        add(Float64("x", causality=causes.output, initial=Fmi3Initial.exact, start=0.0))
        add(Float64("count", causality=causes.output, initial=Fmi3Initial.calculated))
        add(Float64("speed", causality=causes.input, start=0.0))
        add(Float64("gain", causality=causes.parameter, variability=varies.fixed, start=1.0))

    def do_step(self, current_time, step_size):
        self.x += self.gain * self.speed * step_size
        if self.x > 5.0:
            raise ValueError("the cart has left the track")
        return True

    def _get_fmu_state(self):
        return {"x": self.x, "speed": self.speed, "gain": self.gain}

    def _set_fmu_state(self, state):
        self.x, self.speed, self.gain = state["x"], state["speed"], state["gain"]
'''


def made(folder: Path, **options: Any) -> Path:
    """Build the FMU of a cart, and return the folder with it."""
    script = folder / "cart.py"
    script.write_text(CART, encoding="utf-8")
    FmuBuilder.build_FMU(script, dest=folder, **options)
    script.unlink()
    return folder


@pytest.fixture(autouse=True)
def unpacked(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Check that each test leaves no unpacked files behind, also if its FMU fails."""
    folder = tmp_path_factory.mktemp("unpacked")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setenv("TMPDIR", str(folder))
    yield
    gc.collect()  # simulations that nobody closes end with their last reference
    assert [*folder.glob("symaware-fmu-*")] == []


@pytest.fixture(scope="session")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `Cart.fmu`, which can get, set and serialise its state."""
    options = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
    return made(tmp_path_factory.mktemp("cart"), **options)


@pytest.fixture(scope="session")
def plain_cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an FMU that cannot get, set or serialise its state."""
    return made(tmp_path_factory.mktemp("plain"))
