"""Memory that is not released is found, and memory that is needed once is not mistaken for it."""

import pytest
from leftovers import grows_forever


@pytest.mark.parametrize("size", [200_000, 1_000_000])
def test_memory_that_is_kept_at_each_repeat_is_found(size: int) -> None:
    kept: list[bytes] = []
    assert grows_forever(lambda: kept.append(b"1" * size), repeats=5, each=10_000)


def test_memory_that_a_few_repeats_need_is_no_leak() -> None:
    kept: list[bytes] = []

    def action() -> None:
        if len(kept) < 12:
            kept.append(b"1" * 1_000_000)

    assert not grows_forever(action, repeats=5, each=10_000)
