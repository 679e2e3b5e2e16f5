"""The command line: one module per verb, which parses arguments, calls the API, prints and exits.

Imports of verbs: docs/decisions/0116-the-start.md
"""

from __future__ import annotations

import errno
import gc
import io
import os
import sys

TYPE_CHECKING = False  # as in `typing`, which `symaware --version` need not import
if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import NoReturn


def main() -> None:
    """Run the command ``symaware``."""
    open_streams()
    if sys.argv[1:] == ["--version"]:
        # Before anything is imported: scripts ask for the version most often.
        from symaware_cli.version import __version__

        print(f"symaware {__version__}")
        return
    # Imported objects stay: searching them for garbage takes a tenth of the time that a verb needs to start.
    gc.set_threshold(200_000, 50, 50)
    gc.callbacks.append(_search_more_often)
    # A plugin of pydantic might change the meaning of a scenario; and the search for one reads all installed packages.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    try:
        if sys.argv[1:] in (["--help"], ["-h"]):
            from symaware_cli.cli.help import help_text

            print(help_text(), end="")
            return
        from symaware_cli.cli.application import application

        application()
    except SystemExit as end:
        threading = sys.modules.get("threading")
        if (threading is not None and threading.active_count() > 1) or "multiprocessing.process" in sys.modules:
            from symaware_cli.cli.threads import do_not_wait

            do_not_wait(end.code)
        raise
    except OSError as error:
        _refuse_output(error)
    except KeyboardInterrupt:
        # At any time: even before the command has begun, or while it ends.
        raise SystemExit(130) from None
    finally:
        # The interpreter, which is about to end, need not search for garbage either.
        gc.freeze()


def _search_more_often(phase: str, _: Mapping[str, int]) -> None:
    """Set the threshold for the garbage of the work, after the first search."""
    if phase == "stop":
        gc.set_threshold(20_000, 50, 50)
        gc.callbacks.remove(_search_more_often)


def open_streams() -> None:
    """Open the standard streams that the process was started without, so that no other file gets their numbers."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            stream = open(os.devnull, "r" if name == "stdin" else "w")  # noqa: SIM115 (for ever)
            os.set_inheritable(stream.fileno(), True)
            setattr(sys, name, stream)
    # Names of files need not be UTF-8; they are printed as they are.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")


def _refuse_output(error: OSError) -> NoReturn:
    """Report that the output could not be written; other errors are raised again."""
    if error.filename is not None or error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO):
        raise error
    from symaware_cli.log import reason

    # Otherwise flushing the rest of the buffer would fail again when the interpreter ends.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    print(f"symaware: cannot write the output: {reason(error)}", file=sys.stderr)
    raise SystemExit(1)
