"""Prints a page of HTML into a PDF, with a browser that is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from symaware_cli.log import LogError, OutputError, UnknownNameError, whole_file

#: Browsers that print without a window, by the names of their commands.
_BROWSERS = (
    *("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"),
    *("microsoft-edge", "microsoft-edge-stable", "msedge"),
)
_FLAGS = (
    *("--headless", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--no-pdf-header-footer"),
)

#: Time limit for printing [s].
_TIMEOUT = 300.0


def require_printing(output: Path) -> str:
    """Return the browser that prints.

    Raises:
        LogError: There is none.
        UnknownNameError: The name of the file does not end in .pdf.
    """
    if output.suffix.lower() != ".pdf":
        raise UnknownNameError(f"a PDF ends in .pdf, not as {output}", output.suffix.lower(), [".pdf"])
    found = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if found is None:
        raise LogError(
            "a PDF needs Chromium, Chrome or Edge on the PATH, and there is none: install one (Debian: apt install "
            "chromium), or open the page in any browser and print it from there"
        )
    return found


def print_page(page: Path, output: Path) -> None:
    """Print a page into a PDF, which appears whole or not at all.

    Args:
        page: A page of HTML.
        output: The PDF.

    Raises:
        LogError: There is no browser.
        OutputError: The browser failed, or the PDF cannot be written.
    """
    command = [require_printing(output), *_FLAGS]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        command.append("--no-sandbox")  # Chromium refuses to start otherwise
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile, whole_file(output, page) as partial:
        partial.touch()  # what cannot be written is reported as such
        command += [f"--user-data-dir={profile}", f"--print-to-pdf={partial.resolve()}", page.resolve().as_uri()]
        try:
            ended = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_TIMEOUT)
        except subprocess.TimeoutExpired:
            raise OutputError(f"cannot write {output}: {command[0]} printed nothing within {_TIMEOUT:g} s") from None
        if ended.returncode or not partial.stat().st_size:
            said = ended.stderr.decode(errors="replace").strip().splitlines()[-1:] or [f"status {ended.returncode}"]
            raise OutputError(f"cannot write {output}: {command[0]} failed: {said[0]}")
