"""Labels of regions are in their own regions, outside of others, and do not overlap."""

import numpy as np
import pytest

from symaware_cli.views.plotting.region_labels import LabelledRegion, label_places

LOW, HIGH = np.array([0.0, 0.0]), np.array([10.0, 6.0])
SIZE = np.array([1.2, 0.3])


def box(left: float, right: float, low: float, high: float) -> LabelledRegion:
    corners = np.array([[left, low], [right, low], [right, high], [left, high]])
    return LabelledRegion([corners], SIZE, corners.mean(axis=0))


def disc(x: float, y: float, radius: float) -> LabelledRegion:
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    corners = np.array([x, y]) + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return LabelledRegion([corners], SIZE, np.array([x, y]))


def holds(region: LabelledRegion, point: np.ndarray) -> bool:
    for corners in region.outlines:
        edges, apart = np.roll(corners, -1, axis=0) - corners, point - corners
        if (edges[:, 0] * apart[:, 1] - edges[:, 1] * apart[:, 0] >= -1e-9).all():
            return True
    return False


def test_a_label_avoids_a_region_within_its_own() -> None:
    corridor, pond = box(0, 10, 1, 5), disc(5, 3, 1.5)
    outer, inner = label_places([corridor, pond], LOW, HIGH)
    assert outer is not None
    assert holds(corridor, outer)
    for corner in ([-1, -1], [-1, 1], [1, -1], [1, 1]):
        assert not holds(pond, outer + np.array(corner) * SIZE / 2)
    np.testing.assert_array_equal(inner, pond.preferred)


def test_a_label_stays_at_its_preferred_place_if_it_is_free() -> None:
    regions = [box(0, 4, 0, 6), disc(7, 3, 2)]
    for place, region in zip(label_places(regions, LOW, HIGH), regions, strict=True):
        np.testing.assert_array_equal(place, region.preferred)


def test_a_region_whose_middle_is_out_of_sight_is_labelled_where_it_is_visible() -> None:
    (place,) = label_places([disc(5, -1, 2)], LOW, HIGH)
    assert place is not None
    assert place[1] >= SIZE[1] / 2
    assert holds(disc(5, -1, 2), place)
    assert label_places([disc(5, -9, 2)], LOW, HIGH) == [None]


def test_equal_regions_have_their_labels_beside_each_other() -> None:
    places = label_places([box(1, 5, 1, 4)] * 4, LOW, HIGH)
    for number, place in enumerate(places):
        for other in places[:number]:
            assert place is not None
            assert other is not None
            assert (np.abs(place - other) >= SIZE).any()


@pytest.mark.parametrize("seed", range(20))
def test_labels_of_random_regions_are_in_their_regions_and_apart(seed: int) -> None:
    chance = np.random.default_rng(seed)
    regions = [
        disc(*chance.uniform([0, 0, 1.0], [10, 6, 2.5]))
        if chance.random() < 0.5
        else box(left, left + wide, low, low + tall)
        for left, wide, low, tall in chance.uniform([0, 1.5, 0, 1], [8, 4, 5, 3], (6, 4))
    ]
    places = label_places(regions, LOW, HIGH)
    for number, (place, region) in enumerate(zip(places, regions, strict=True)):
        assert place is not None
        assert holds(region, place)
        assert ((place >= LOW) & (place <= HIGH)).all()
        for other in places[:number]:
            assert other is not None
            assert (np.abs(place - other) >= SIZE).any()


def test_a_label_keeps_off_points_to_be_avoided() -> None:
    hall, avoided = box(0, 10, 0, 6), np.array([[5.0, 3.0], [5.5, 3.2]])
    (place,) = label_places([hall], LOW, HIGH, avoided)
    assert place is not None
    assert holds(hall, place)
    assert (np.abs(avoided - place) >= SIZE / 2.0).any(axis=1).all()
