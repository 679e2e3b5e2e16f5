"""Executes the notebooks of this folder and stores their outputs: python docs/notebooks/execute.py [NOTEBOOK...].

Each runs in an empty temporary folder, so that outputs have no paths of this machine.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

HERE = Path(__file__).parent


def executed(path: Path, folder: Path) -> nbformat.NotebookNode:
    """Return a notebook with the outputs of an execution.

    Args:
        path: The notebook.
        folder: The working folder of its kernel.

    Raises:
        CellExecutionError: A cell raised an exception.
    """
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(
        notebook, timeout=300, kernel_name="python3", record_timing=False, resources={"metadata": {"path": str(folder)}}
    )
    with tempfile.TemporaryDirectory() as configuration:
        # The kernel reads none of the user's settings.
        client.execute(env={**os.environ, "IPYTHONDIR": configuration, "XDG_CONFIG_HOME": configuration})
    # The version of the interpreter says nothing about the notebook.
    notebook.metadata["language_info"] = {"name": "python"}
    return notebook


if __name__ == "__main__":
    for each in map(Path, sys.argv[1:]) if sys.argv[1:] else sorted(HERE.glob("*.ipynb")):
        with tempfile.TemporaryDirectory() as temporary:
            found = executed(each, Path(temporary))
        nbformat.write(found, each)
        print(f"{each}: {each.stat().st_size / 1000:.1f} kB")
