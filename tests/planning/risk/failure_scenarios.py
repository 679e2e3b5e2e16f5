"""Scenarios whose agents estimate the risk of failing a specification."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.stats import norm

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

Array = NDArray[np.float64]

STEP = 0.1


def scenario(formula: str, *, agents: int = 1, noise: Any = 0.5, **changes: Any) -> dict[str, Any]:
    """Agents that stand at 0, disturbed by noise; the risk is computed once."""
    risk = {"specifications": ["wanted"], "horizon": 1.0, "samples": 400, "follow_intents": False}
    robot = {
        "count": agents,
        "model": {"use": "single-integrator", "with": {"process_noise": noise}},
        "state": [0, 0],
        "components": {
            "see": {"use": "perception.self"},
            "risk": {"use": "risk.specification", "with": {**risk, **changes.pop("risk", {})}},
        },
        **changes.pop("robot", {}),
    }
    return {
        "symaware": 1,
        "name": "risk",
        "seed": 1,
        "run": {"duration": STEP},
        "environment": {"use": "kinematic", "with": {"time_step": STEP}},
        "agents": {"robot": robot},
        "specifications": {"wanted": {"each": "robot", "formula": formula}},
        **changes,
    }


def estimates(folder: Path, content: dict[str, Any], group: str = "robot") -> tuple[Array, Array, Array]:
    """The risk of each agent after a single turn, its standard error, and the believed state."""
    (folder / "risk.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    built = build(folder / "risk.yaml")
    assert execute(built, None).status == "finished"
    awareness = next(each for each in built.simulation.groups if each.name == group).awareness
    shared = awareness.risk.shared
    assert shared is not None
    return shared[1].ravel(), awareness["risk.standard_error"].ravel(), awareness.state


def last_step(p: float) -> str:
    """A formula that fails with probability p: x after ten steps is normal with a deviation of 0.5."""
    return f"always[1, 1] x <= {0.5 * norm.isf(p)}"
