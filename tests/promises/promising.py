"""A scenario in which Adam promises Bob to stay in a region."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

_SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "promising",
    "seed": 2,
    "run": {"duration": 2.0},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "regions": {
        "red": {"box": [-6.0, 0.0, -4.0, 4.0]},
        "blue": {"circle": {"centre": [4.0, 0.0], "radius": 2.0}},
        "near": {"box": [0.5, 3.0, -2.0, 2.0]},
        "both": {"union": ["red", "blue"]},
        "strip": {"box": [0.0, 1.0]},
        "moving": {"box": [-1.0, 1.0, -1.0, 1.0], "around": "bob"},
    },
    "agents": {
        "adam": {
            "entity": {"shape": {"circle": {"radius": 0.4}}},
            "model": {"use": "single-integrator"},
            "state": [-1.0, 0.0],
            "components": {
                "see": {"use": "perception.range", "with": {"range": 20.0}},
                "promises": {"use": "promises.monitor"},
                "drive": {"use": "control.schedule", "with": {"inputs": [{"time": 0.0, "input": [0.4, 0.0]}]}},
            },
        },
        "bob": {
            "entity": {"shape": {"circle": {"radius": 0.4}}},
            "model": {"use": "single-integrator"},
            "state": [2.0, 0.0],
            "components": {
                "see": {"use": "perception.range", "with": {"range": 20.0, "position_noise": 0.1}},
                "filter": {"use": "uncertainty.gaussian"},
                "promises": {"use": "promises.monitor"},
                "risk": {"use": "risk.collision", "with": {"horizon": 5.0}},
            },
        },
    },
    "promises": {"stay": {"of": "adam", "formula": "always inside(position, red)", "to": "bob", "confidence": 0.99}},
}


def promising(speed: float = 0.4, **promise: Any) -> dict[str, Any]:
    """Return the scenario, in which Adam drives towards Bob at a speed [m/s]; he leaves the region 1 m further on.

    Args:
        speed: The speed.
        promise: Entries of the promise to replace.
    """
    content = deepcopy(_SCENARIO)
    content["agents"]["adam"]["components"]["drive"]["with"]["inputs"][0]["input"][0] = speed
    content["promises"]["stay"].update(promise)
    return content
