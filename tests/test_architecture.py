"""The picture of the architecture shows the imports there are."""

import runpy

from checkout import CHECKOUT

PICTURES = CHECKOUT / "docs" / "pictures"


def test_the_picture_of_the_architecture_is_fresh() -> None:
    drawn = runpy.run_path(str(PICTURES / "architecture.py"))["drawn"]()
    assert (PICTURES / "architecture.svg").read_text(encoding="utf-8") == drawn, "python docs/pictures/architecture.py"


def test_every_room_is_in_the_picture_and_no_arrow_points_up() -> None:
    module = runpy.run_path(str(PICTURES / "architecture.py"))
    places = {each.name for each in module["PACKAGE"].iterdir() if (each / "__init__.py").exists()}
    assert places | {"testing"} == module["ROOMS"].keys()
    for start, end in module["reduced"](module["imports"]()):
        (_, top, _), (_, bottom, _) = module["ROOMS"][start], module["ROOMS"][end]
        assert (top, start) < (bottom, end) or top == bottom, f"{start} imports {end}"
