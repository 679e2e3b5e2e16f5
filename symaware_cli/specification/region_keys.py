"""Names of regions in expressions, in which brackets may take the place of underscores.

Reasons: docs/decisions/0115-regions-by-kind-and-name.md
"""

from __future__ import annotations

from collections.abc import Iterable

from symaware_cli.specification.columns import TAKEN
from symaware_cli.specification.parser import Keys


def region_names(regions: Iterable[str]) -> dict[str, Keys | None]:
    """Return the names of regions as expressions may refer to them, with the keys that follow them.

    A region `KIND_NAME` is also ``KIND("NAME")``, and a region `OTHER_PART` beside a region `OTHER` is also
    ``OTHER.PART``: ``lane("2").centre`` is the region `lane_2_centre`.

    Args:
        regions: Their names.
    """
    names: dict[str, Keys | None] = dict.fromkeys(regions)
    kinds: dict[str, list[str]] = {}
    for name in names:
        places = [place for place, character in enumerate(name) if character == "_"]
        for number, place in enumerate(places):
            if number == 0 or name[:place] in names:
                kinds.setdefault(name[:place], []).append(name[place + 1 :])
    for kind, following in kinds.items():
        if kind in names:
            names[kind] = Keys("part", following, is_joined=True, is_optional=True)
        elif kind and kind not in TAKEN:
            names[kind] = Keys(kind, following, is_joined=True)
    return names
