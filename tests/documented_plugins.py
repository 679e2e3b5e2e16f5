"""Plugins of docs/plugins.md, installed outside the package as the document shows them."""

import os
import re
import subprocess
from collections.abc import Callable, Mapping
from contextlib import chdir
from pathlib import Path

from simulating import COMMAND, in_process

DOCUMENT = Path(__file__).parents[1] / "docs" / "plugins.md"


def shown(language: str, beginning: str) -> str:
    """The block of the document with a given beginning."""
    found = re.findall(rf"(?ms)^```{language}\n({re.escape(beginning)}.*?)^```$", DOCUMENT.read_text(encoding="utf-8"))
    assert len(found) == 1
    return str(found[0])


def install(folder: Path, modules: Mapping[str, str], points: Mapping[str, str], scenario: str) -> Path:
    """Put a distribution into `site` of a folder, and a scenario beside it.

    Args:
        folder: Where.
        modules: The beginning of the block of each module, by its name.
        points: Its components, ``module:Class`` by entry-point name.
        scenario: The name of the scenario, with which its block begins.
    """
    about = folder / "site" / "documented-1.0.dist-info"
    about.mkdir(parents=True)
    for module, beginning in modules.items():
        about.with_name(f"{module}.py").write_text(shown("python", beginning), encoding="utf-8")
    about.joinpath("METADATA").write_text("Metadata-Version: 2.1\nName: documented\nVersion: 1.0\n", encoding="utf-8")
    lines = ["[symaware.components]", *(f"{name} = {target}" for name, target in points.items()), ""]
    about.joinpath("entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
    (folder / scenario).write_text(shown("yaml", f"# {scenario}"), encoding="utf-8")
    return folder


def command(folder: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Return a function that runs a command in a folder, with or without the plugin installed there.

    It runs within this process, which forgets the plugin afterwards; with `process`, in one of its own.
    """

    def run(
        *arguments: object, plugin: bool = True, process: bool = False, status: int = 0
    ) -> subprocess.CompletedProcess[str]:
        site = folder / "site" if plugin else None
        if process:
            environment = {**os.environ, "PYTHONPATH": str(site or "")}
            line = [*COMMAND, *map(str, arguments)]
            done = subprocess.run(
                line, cwd=folder, env=environment, capture_output=True, text=True, timeout=300, check=False
            )
            assert "Traceback" not in done.stderr, done.stderr
        else:
            with chdir(folder):
                done = in_process(*arguments, site=site)
        assert done.returncode == status, done.stderr
        return done

    return run
