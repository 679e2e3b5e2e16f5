"""The process of an FMU, seen from the run."""

from __future__ import annotations

import json
import select
import weakref
from contextlib import suppress
from pathlib import Path
from typing import Any

from symaware_cli.fmi.fmu_archive import FmuError
from symaware_cli.world import PythonChild, how_it_ended, read, write

PATIENCE = 60.0
"""How long an answer may take [s]."""


class FmuProcess:
    """Calls the methods of an `FmuServer` in another process."""

    def __init__(self, path: Path) -> None:
        """Start the process.

        Args:
            path: The FMU.

        Raises:
            FmuError: It cannot be used.
        """
        self._child = PythonChild("symaware_cli.fmi.fmu_server:serve")
        self._end = weakref.finalize(self, _end, self._child)
        self._ask({"path": str(path.resolve())})

    def call(self, name: str, **given: Any) -> Any:
        """Call a method of the server.

        Raises:
            FmuError: It fails, does not answer, or the process has ended.
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
            raise FmuError(f"its process {how_it_ended(self._child.close())}") from error
        if "error" in answer:
            raise FmuError(answer["error"])
        return answer["answer"]


def _end(child: PythonChild) -> None:
    child.kill()
    with suppress(OSError):
        child.close()
