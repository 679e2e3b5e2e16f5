"""Progress bars."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


@contextmanager
def progress(name: str, start: int, end: int, shown: bool) -> Iterator[Callable[[int], None] | None]:
    """Show a bar of simulated time, on the terminal or in a notebook.

    Args:
        name: The name of the work.
        start: Where simulated time begins [ns].
        end: Where simulated time ends [ns].
        shown: Whether to show it; otherwise nothing happens.

    Yields:
        A function to call with the simulated time [ns] that is reached; None if nothing is shown.
    """
    if not shown:
        yield None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[simulated]:.1f} of {task.fields[whole]:g} s"),
        TextColumn("ends in"),
        TimeRemainingColumn(compact=True),
    )
    with Progress(*columns, console=_console(), transient=True) as bar:
        task = bar.add_task(name, total=max(end - start, 1), simulated=0.0, whole=end / 1e9)
        yield lambda now: bar.update(task, completed=now - start, simulated=now / 1e9)


def _console() -> Console:
    from rich.console import Console

    console = Console(stderr=True)
    if console.is_jupyter and find_spec("ipywidgets") is None:
        # Rich draws in a notebook by a package that need not be there; a line that is written over does as well.
        return Console(stderr=True, force_jupyter=False, force_terminal=True)
    return console
