"""Scenarios with roads."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli import Log, open_log
from symaware_cli.language.build import Built, build
from symaware_cli.language.execution import execute


@pytest.fixture
def road(tmp_path: Path) -> Callable[..., Built]:
    """Build a scenario with roads and groups."""

    def built(
        roads: dict[str, Any],
        duration: float = 10.0,
        step: float = 0.1,
        more: Mapping[str, Any] | None = None,
        **agents: Any,
    ) -> Built:
        document = {
            "symaware": 1,
            "name": "road",
            "run": {"duration": duration},
            "environment": {"use": "kinematic", "with": {"time_step": step}},
            "roads": roads,
            "agents": agents,
            **(more or {}),
        }
        path = tmp_path / "road.yaml"
        path.write_text(yaml.safe_dump(document), encoding="utf-8")
        return build(path, [], None)

    return built


@pytest.fixture
def drive(road: Callable[..., Built], tmp_path: Path) -> Callable[..., Log]:
    """Run a scenario with roads and groups."""

    def run(*given: Any, **more: Any) -> Log:
        log = tmp_path / "road.mcap"
        execute(road(*given, **more), log)
        return open_log(log)

    return run
