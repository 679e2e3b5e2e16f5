"""Operations on the vectors of few agents and of many."""

import numpy as np

from symaware_cli.engine.components.control.steering import along, directions, scaled


def test_few_agents_and_many_have_the_same_bits() -> None:
    drawn = np.random.default_rng(1)
    position, vector = drawn.normal(size=(2, 300, 2)) * 100.0
    length, travelled = drawn.uniform(0.0, 3.0, 300), drawn.uniform(0.0, 9.0, (300, 5))
    for begin, end in ((0, 1), (7, 20), (100, 290)):
        rows = slice(begin, end)
        assert np.array_equal(
            along(position, vector, travelled)[rows], along(position[rows], vector[rows], travelled[rows])
        )
        assert np.array_equal(scaled(vector, length)[rows], scaled(vector[rows], length[rows]))
        assert np.array_equal(directions(vector, length)[rows], directions(vector[rows], length[rows]))
