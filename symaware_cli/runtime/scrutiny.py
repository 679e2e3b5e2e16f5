"""The scrutiny of what components write: every number must be finite."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from symaware_cli.core import AgentGroup
from symaware_cli.core.column import Array


class Scrutiny:
    """Looks at the control inputs and the believed states of a group."""

    def __init__(self, group: AgentGroup) -> None:
        self._columns = ((group.control_column, "control input"), (group.awareness.state_column, "state"))

    def present(self) -> Sequence[Array]:
        """What stands there now; a column that is written gets another array, so this is no copy."""
        return [column.values for column, _ in self._columns]

    def offences(self, before: Sequence[Array] | None) -> Iterator[tuple[Sequence[int], str]]:
        """Find what was written since the last time and is not finite.

        Args:
            before: What stood there before and is put back in its place; None to leave it.

        Yields:
            Rows, ascending, and what is wrong with the first of them.
        """
        for number, (column, what) in enumerate(self._columns):
            if not column.fresh:
                continue
            column.fresh = False
            rows = column.non_finite_rows()
            if not rows:
                continue
            problem = f"its {what} is not finite: {column.row(rows[0]).tolist()}"
            if before is not None:
                for row in rows:
                    column.set_row(row, before[number][row])
                column.fresh = False
            yield rows, problem
