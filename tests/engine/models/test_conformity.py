"""What a model returns is compared with what it declares, whatever it returns and however many elements it has."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from symaware_cli import Model
from symaware_cli.engine.models.conformity import faults_of
from symaware_cli.testing import assert_conforming

sys.path.append(str(Path(__file__).parent.parent / "models"))
from specimens import SPECIMENS, VEHICLES

EVERYTHING = SPECIMENS | VEHICLES


@pytest.mark.parametrize("model", EVERYTHING.values(), ids=EVERYTHING)
def test_every_model_that_ships_conforms(model: Model) -> None:
    assert_conforming(model)


def longer(values: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    return [*values, values[0]]


def shorter(values: Sequence[Any]) -> list[Any]:
    return list(values)[:-1]


def wider(array: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([array, array[..., :1]], axis=-1)


def narrower(array: NDArray[Any]) -> NDArray[Any]:
    narrowed: NDArray[Any] = np.asarray(array)[..., :-1]
    return narrowed


def imaginary(values: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(values) * (1 + 1j)


BROKEN = [
    *((name, how) for name in ("derivative", "successor") for how in (longer, shorter)),
    *((name, how) for name in ("positions", "velocity", "limit", "jacobian") for how in (wider, narrower, imaginary)),
    *((name, how) for name in ("exact_step", "turn_rate") for how in (wider, narrower)),
    *((name, how) for name in ("noise_deviation", "noise_covariance", "slowed") for how in (wider, narrower)),
    ("follow_velocity", narrower),
    ("input_bounds", lambda bounds: (bounds[0], longer(bounds[1]))),
    ("input_bounds", lambda bounds: (bounds[1], bounds[0])),
    ("input_bounds", lambda bounds: bounds[0]),
    ("derivative", lambda rates: [rates[0], *rates[1:-1], np.stack([rates[-1]] * 2)]),
    ("derivative", lambda rates: [imaginary(each) for each in rates]),
    ("derivative", lambda rates: None),
]


@pytest.mark.parametrize("model", EVERYTHING.values(), ids=EVERYTHING)
@pytest.mark.parametrize(("name", "how"), BROKEN)
def test_values_of_another_form_are_reported_with_the_method(
    model: Model, name: str, how: Callable[..., list[NDArray[np.float64]]]
) -> None:
    def called(*arguments: Any) -> Any:
        returned = getattr(model, name)(*arguments)
        return None if returned is None else how(returned)

    broken: Any = Changed(model, name, called)
    try:
        changed = getattr(model, name)(*Changed(model, "", None).arguments(name))
    except NotImplementedError:
        changed = None
    told = list(faults_of(broken))
    if changed is None:
        assert told == []
        return
    assert any(f"`{name}`" in fault for fault in told)
    with pytest.raises(AssertionError, match=f"`{name}`"):
        assert_conforming(broken)


class Changed:
    """A model of which one method is another."""

    def __init__(self, model: Model, name: str, method: Callable[..., Any] | None) -> None:
        self._model, self._name, self._method = model, name, method

    def __getattr__(self, name: str) -> Any:
        return self._method if name == self._name else getattr(self._model, name)

    def arguments(self, name: str) -> tuple[Any, ...]:
        """Arguments with which a method can be called."""
        nx, nu, d = len(self._model.state), len(self._model.control_input), len(self._model.position)
        step = self._model.time_step or 0.1
        rows = np.zeros((1, nx)), np.zeros((1, nu))
        arguments: dict[str, tuple[Any, ...]] = {
            "derivative": (rows[0].T, rows[1].T, np),
            "successor": (rows[0].T, rows[1].T, step, np),
            "positions": rows[:1],
            "exact_step": (*rows, step),
            "limit": rows[1:],
            "noise_deviation": (step,),
            "noise_covariance": (step,),
            "follow_velocity": (rows[0], np.zeros((1, d))),
            "slowed": (*rows, np.full(1, 0.5)),
            "input_bounds": (),
        }
        return arguments.get(name, rows)
