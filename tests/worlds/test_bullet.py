"""The engine of the spatial world, and its output."""

import subprocess
import sys
from pathlib import Path

import pytest

from symaware_cli.worlds.body_builder import told
from symaware_cli.worlds.bullet import engine, quiet


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_the_engine_works_without_standard_streams(closed: str) -> None:
    program = "import sys; from symaware_cli.worlds.bullet import Client; Client(False).close(); sys.exit(7)"
    line = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-P", "-c", program]
    assert subprocess.run(line, capture_output=True, timeout=60, check=False).returncode == 7


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            '<link name="a"/><joint name="j" type="fixed"><parent link="ghost"/><child link="a"/></joint>',
            ["Cannot find parent link for a joint", "j"],
        ),
    ],
    ids=["parent"],
)
def test_the_output_of_the_engine_about_a_failure_is_reported(text: str, said: list[str], tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r">{text}</robot>')
    client = engine.connect(engine.DIRECT)
    with quiet() as output, pytest.raises(engine.error):
        engine.loadURDF(str(path), physicsClientId=client)
    engine.disconnect(client)
    assert all(part in told(output) for part in said)
    assert "BulletUrdfImporter" not in told(output)
