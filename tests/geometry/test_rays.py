"""Only the rays that may meet a piece are tested against it, and that changes no distance."""

from typing import Any

import numpy as np
import pytest

from symaware_cli.geometry import Pieces
from symaware_cli.geometry.rays import _entry, nearest_hits
from symaware_cli.geometry.vectors import Array


def every_pair(origins: Array, directions: Array, pieces: Pieces) -> Array:
    """The distances with each ray tested against each piece."""
    count, width = directions.shape[:2]
    fan, ray, piece = (each.ravel() for each in np.indices((count, width, len(pieces))))
    hits = _entry(origins[fan], directions[fan, ray], pieces.take(piece))
    return np.asarray(hits.reshape(count, width, -1).min(axis=2))


def drawn(random: np.random.Generator, count: int) -> Pieces:
    """Discs, walls and polygons of many sizes."""
    cores: list[tuple[list[Any], float]] = []
    for _ in range(count):
        x, y = random.normal(size=2) * random.choice([1.0, 10.0])
        kind = random.integers(3)
        if kind < 2:
            ends = [(x, y), tuple(random.normal(size=2) * 5.0)][: kind + 1]
            cores.append((ends, float(random.uniform(0.0, 0.8))))
        else:
            angles, size = np.sort(random.uniform(0.0, 2 * np.pi, random.integers(3, 6))), random.uniform(0.01, 4.0)
            corners = [(x + size * np.cos(angle), y + size * np.sin(angle)) for angle in angles]
            cores.append((corners, float(random.choice([0.0, 0.2]))))
    return Pieces.of(cores)


@pytest.mark.parametrize("seed", range(20))
def test_distances_are_those_of_all_rays_against_all_pieces(seed: int) -> None:
    random = np.random.default_rng(seed)
    count, width = int(random.integers(1, 6)), int(random.integers(1, 60))
    pieces = drawn(random, int(random.integers(1, 40)))
    # Some origins are within pieces, and some directions at the ends of the range of angles.
    origins = np.concatenate([random.normal(size=(count, 2)) * 4.0, pieces.vertices[:1, 0]])
    angles = random.uniform(-np.pi, np.pi, (count + 1, width))
    angles[0] = np.linspace(-np.pi, np.pi, width)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    directions[-1, 0] = (-1.0, -0.0)
    fans, each = (every.ravel() for every in np.indices((count + 1, len(pieces))))
    assert np.array_equal(
        nearest_hits(origins, directions, pieces, fans, each), every_pair(origins, directions, pieces)
    )


def test_rays_along_sides_and_through_corners_of_a_grid_of_boxes_hit_the_boxes() -> None:
    boxes = [([(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)], 0.0) for x in range(-6, 6, 2) for y in range(-6, 6, 2)]
    pieces = Pieces.of(boxes)
    origins = np.array([[-1.0, -1.0], [1.5, 1.5], [-8.0, 0.0], [0.5, 0.5]])
    steps = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1], [2, 1]])
    directions = np.broadcast_to(steps / np.hypot(*steps.T)[:, None], (4, 9, 2))
    fans, each = (every.ravel() for every in np.indices((4, len(pieces))))
    assert np.array_equal(
        nearest_hits(origins, directions, pieces, fans, each), every_pair(origins, directions, pieces)
    )
