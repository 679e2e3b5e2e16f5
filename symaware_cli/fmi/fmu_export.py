"""Exports the scenario of a run as an FMU (FMI 3, co-simulation), which other simulators step.

Reasons: docs/decisions/0094-fmi.md
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import ClassVar

from symaware_cli.fmi.fmu_archive import MOST_BYTES
from symaware_cli.log import Log, LogError, OutputError
from symaware_cli.views import Exported, ExportFormat, Progress, Selection

_INSTALL = "pip install 'symaware-cli[fmi]'"
#: Builds in a separate process, because the builder imports the script, whose module would stay loaded.
_BUILD = """
import sys
from pythonfmu3 import FmuBuilder
script, dest, log = sys.argv[1:]
FmuBuilder.build_FMU(script, dest=dest, project_files=[log], canHandleVariableCommunicationStepSize="false")
"""


class ScenarioFmu(ExportFormat):
    """The scenario of a run as an FMU, whose outputs are the true states of all agents.

    The FMU contains the log, from which it repeats the run, and needs SymAware in the Python that loads it.
    """

    suffix: ClassVar = ".fmu"
    requires: ClassVar = {"pythonfmu3": _INSTALL}
    selects: ClassVar = False

    def write(self, log: Log, place: Path, selection: Selection, on_progress: Progress) -> Exported:
        """Write the FMU."""
        if log.path.stat().st_size > MOST_BYTES:
            raise LogError(f"{log.path} has more than {MOST_BYTES >> 20} MiB, and an FMU of it would be larger")
        if "resolved.yaml" not in log.attachments:
            raise LogError(f"{log.path} has no scenario")
        text = files("symaware_cli.fmi").joinpath("scenario_unit.template").read_text(encoding="utf-8")
        about = (
            f"The scenario {log.manifest['name']} of SymAware {version('symaware-cli')}. It needs Python "
            f"{sys.version_info.major}.{sys.version_info.minor} with this version of symaware-cli on the host."
        )
        with tempfile.TemporaryDirectory(prefix="symaware-fmu-") as folder:
            script, copy = Path(folder, "scenario_unit.py"), Path(folder, "run.mcap")
            script.write_text(text.replace('"@DESCRIPTION@"', json.dumps(about)), encoding="utf-8")
            shutil.copy(log.path, copy)
            made = Path(folder, "made")
            # The log is beside the script for the builder, as in the FMU.
            command = [sys.executable, "-c", _BUILD, str(script), str(made), str(copy)]
            done = subprocess.run(command, capture_output=True, text=True, check=False, env=dict(os.environ))
            if done.returncode:
                reason = (done.stderr.strip().splitlines() or ["without an error message"])[-1]
                raise OutputError(f"cannot make an FMU of {log.path}: {reason}")
            (built,) = made.glob("*.fmu")
            shutil.copy(built, place)
        groups = log.manifest["groups"]
        counts = [
            (
                name,
                len(group["agents"]) * (len(group["model"]["state"]) + len(group["model"]["control_input"]) + 1),
                None,
            )
            for name, group in groups.items()
        ]
        size = place.stat().st_size
        return Exported(
            counts, ("group", "variables"), size, {"variables": {name: n for name, n, _ in counts}, "size": size}
        )
