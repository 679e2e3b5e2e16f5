"""Groups of cars, and a lane for them."""

from typing import Any

CAR = {"shape": {"box": {"length": 4.0, "width": 2.0}}}
BICYCLE = {"use": "bicycle", "with": {"wheelbase": 2.5, "max_speed": 50}}
LANES = {"one": {"points": [[0, 0], [5000, 0]], "speed_limit": 30}}


def group(state: Any, controller: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A group of cars."""
    components = {"see": {"use": "perception.omniscient"}, "drive": controller}
    return {"entity": CAR, "model": BICYCLE, "state": state, "components": components, **more}
