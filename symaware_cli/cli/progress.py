"""The bar that shows how far long work is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress(name: str, start: int, end: int, shown: bool) -> Iterator[Callable[[int], None] | None]:
    """Show a bar of simulated time on the terminal.

    Args:
        name: What goes on.
        start: Where simulated time begins [ns].
        end: Where it will be in the end [ns].
        shown: Whether to; otherwise nothing happens.

    Yields:
        What to call with the simulated time [ns] that is reached; None if nothing is shown.
    """
    if not shown:
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[simulated]:.1f} of {task.fields[whole]:g} s"),
        TextColumn("ends in"),
        TimeRemainingColumn(compact=True),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=max(end - start, 1), simulated=0.0, whole=end / 1e9)
        yield lambda now: bar.update(task, completed=now - start, simulated=now / 1e9)
