"""The process of an FMU, as the run uses it."""

from __future__ import annotations

import json
import select
import tempfile
import weakref
from contextlib import suppress
from pathlib import Path
from typing import Any

from symaware_cli.fmi.fmu_archive import FmuError
from symaware_cli.world import PythonChild, how_it_ended, read, write

PATIENCE = 60.0
"""The longest wait for an answer [s]."""


class FmuProcess:
    """Calls the methods of an `FmuServer` in another process."""

    def __init__(self, path: Path) -> None:
        """Start the process.

        Args:
            path: The FMU.

        Raises:
            FmuError: The FMU cannot be used.
        """
        # Not the child's: it is killed, and could not remove it.
        self._folder = tempfile.TemporaryDirectory(prefix="symaware-fmu-")
        self._child = PythonChild("symaware_cli.fmi.fmu_server:serve")
        self._end = weakref.finalize(self, _end, self._child, self._folder)
        try:
            self._ask({"path": str(path.resolve()), "folder": self._folder.name})
        except FmuError:
            self.close()
            raise

    def call(self, name: str, **given: Any) -> Any:
        """Call a method of the server.

        Raises:
            FmuError: The method fails, the process does not answer, or it has ended.
        """
        return self._ask({"call": name, "with": given})

    def close(self) -> None:
        """End the process."""
        self._end()

    def _ask(self, request: Any) -> Any:
        try:
            write(self._child.requests, json.dumps(request).encode())
            ready, _, _ = select.select([self._child.answers], [], [], PATIENCE)
            if not ready:
                self.close()
                raise FmuError(f"its process did not answer within {PATIENCE:g} s")
            answer = json.loads(read(self._child.answers))
        except (EOFError, BrokenPipeError, ValueError) as error:
            self._end.detach()
            self._child.kill()
            status = self._child.close()
            self._folder.cleanup()
            raise FmuError(f"its process {how_it_ended(status)}") from error
        if "error" in answer:
            raise FmuError(answer["error"])
        return answer["answer"]


def _end(child: PythonChild, folder: tempfile.TemporaryDirectory[str]) -> None:
    child.kill()
    with suppress(OSError):
        child.close()
    folder.cleanup()
