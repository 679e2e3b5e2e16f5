"""The risk of a radius bounds the probability of a greater error."""

from __future__ import annotations

import numpy as np
import pytest
from symaware_warehouse import Tube
from symaware_warehouse.tube import TubeKind

VARIANCE = 0.0117082


def test_the_radii_of_the_case_study() -> None:
    tube = Tube.of("chebyshev", VARIANCE, 0.01)
    assert tube.least == pytest.approx(0.1530, abs=1e-4)
    assert tube.greatest == pytest.approx(1.5302, abs=1e-4)
    assert tube.least_risk == pytest.approx(0.01)


@pytest.mark.parametrize("kind", ["chebyshev", "gaussian"])
@pytest.mark.parametrize("chords", [1, 4])
def test_the_chords_lie_above_the_bound_and_meet_it_at_the_ends(kind: TubeKind, chords: int) -> None:
    tube = Tube.of(kind, VARIANCE, 0.002, chords)
    for radius in np.linspace(tube.least, tube.greatest, 200).tolist():
        assert tube.risk(radius) >= tube.probability(radius) - 1e-12
    for end in (tube.least, tube.greatest):
        assert tube.risk(end) == pytest.approx(tube.probability(end))


def test_one_chord_is_tighter_than_the_curve_of_the_publication() -> None:
    tube = Tube.of("chebyshev", VARIANCE, 0.01)
    for radius in np.linspace(tube.least, tube.greatest, 200).tolist():
        published = 1.01 - 0.01 / (2.0 * VARIANCE) * radius**2
        assert tube.risk(radius) <= published + 1e-12


def test_the_bound_of_normal_errors_is_their_probability_and_that_of_chebyshev_is_above_it() -> None:
    generator = np.random.Generator(np.random.PCG64(7))
    errors = np.sqrt(VARIANCE) * generator.standard_normal((200_000, 2))
    lengths = np.hypot(*errors.T)
    normal, any_error = (Tube.of(kind, VARIANCE, 0.01) for kind in ("gaussian", "chebyshev"))
    for radius in (0.15, 0.2, 0.3):
        share = float((lengths > radius).mean())
        assert share == pytest.approx(normal.probability(radius), abs=5e-3)
        assert any_error.probability(radius) >= share


def test_a_normal_error_needs_a_narrower_tube() -> None:
    assert Tube.of("gaussian", VARIANCE, 0.001).greatest < Tube.of("chebyshev", VARIANCE, 0.001).greatest / 10
