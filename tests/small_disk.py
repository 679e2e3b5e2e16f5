"""A file system that is soon full, for one command."""

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

_NAMESPACE = ("unshare", "--map-root-user", "--mount")
"""The command by which an ordinary user can mount a file system in a private namespace."""


def on_a_small_disk(
    folder: Path, line: Sequence[str], *, size: str = "64k", then: str = "true"
) -> subprocess.CompletedProcess[str]:
    """Run a command in a file system of its own, which holds nothing but the file `old`, and is mounted on a folder.

    Args:
        folder: An empty folder.
        line: The command.
        size: Of the file system.
        then: A command for the file system before it is used, such as `mount -o remount,ro .`
    """
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    if (
        not shutil.which("unshare")
        or subprocess.run([*_NAMESPACE, *mount], capture_output=True, check=False).returncode
    ):
        pytest.skip("mounting a small file system takes rights that are not given here")
    script = f'folder=$1; shift; mount -t tmpfs -o size={size} tmpfs "$folder" && cd "$folder" && echo old > old'
    return subprocess.run(
        [
            *_NAMESPACE,
            "bash",
            "-c",
            f'{script} && {then} && "$@"; status=$?; ls; exit $status',
            "bash",
            str(folder),
            *line,
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
