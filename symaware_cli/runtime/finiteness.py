"""The check that control inputs and believed states written by components are finite and bounded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from symaware_cli.awareness.column import Array
from symaware_cli.core import AgentGroup
from symaware_cli.world.arrays import FARTHEST, MOST, said_of


class FinitenessCheck:
    """Checks the control inputs and the believed states of a group."""

    def __init__(self, group: AgentGroup) -> None:
        # Components may request very large control inputs: models limit them.
        self._columns = (
            (group.control_column, "control input", MOST),
            (group.awareness.state_column, "state", FARTHEST),
        )

    @property
    def is_due(self) -> bool:
        """Whether something was written since the last check."""
        (control_input, *_), (state, *_) = self._columns
        return control_input.fresh or state.fresh

    def snapshot(self) -> Sequence[Array]:
        """Return the present values; writing replaces a column's array, so no copy is made."""
        return [column.values for column, *_ in self._columns]

    def violations(self, before: Sequence[Array] | None) -> Iterator[tuple[Sequence[int], str]]:
        """Find values written since the last check that are not finite or too large.

        Args:
            before: The values to restore in the rows found, from `snapshot`; None to leave them as they are.

        Yields:
            Rows, ascending, and the problem of the first of them.
        """
        for number, (column, what, most) in enumerate(self._columns):
            if not column.fresh:
                continue
            column.fresh = False
            rows = column.rows_beyond(most)
            if not rows:
                continue
            problem = f"its {what} {said_of(column.row(rows[0]))}"
            if before is not None:
                for row in rows:
                    column.set_row(row, before[number][row])
                column.fresh = False
            yield rows, problem
