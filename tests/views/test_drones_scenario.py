"""What scenarios/drones.yaml promises of its pictures."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from plot_logs import log_of

#: Drones are darker than the mast, the ground and the sky.
DARK = 60


def test_each_camera_sees_another_drone_and_the_risk_is_no_flat_line(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    log = log_of(tmp_path, "drones.yaml", "run.duration=2.6")
    seen: dict[Any, Any] = {}
    for image in log.images("drone"):
        if image.kind == "COLOUR":
            shown = np.asarray(Image.open(io.BytesIO(image.data)).convert("L"))
            seen.setdefault(image.agent, []).append(bool((shown < DARK).any()))
    assert len(seen) == 4
    for sees in seen.values():
        assert np.mean(sees[-8:]) > 0.6
    risk = log.series("drone", "risk").values
    assert np.ptp(risk) > 0.5
