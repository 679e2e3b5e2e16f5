"""The check of what components write: every number must be finite, and no state beyond all measure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from symaware_cli.awareness.column import Array
from symaware_cli.core import AgentGroup
from symaware_cli.world.arrays import FARTHEST, MOST, said_of


class FinitenessCheck:
    """Looks at the control inputs and the believed states of a group."""

    def __init__(self, group: AgentGroup) -> None:
        # A control input may be asked for that is beyond all limits: models have theirs.
        self._columns = (
            (group.control_column, "control input", MOST),
            (group.awareness.state_column, "state", FARTHEST),
        )

    @property
    def is_due(self) -> bool:
        """Whether something was written since the last time."""
        (control_input, *_), (state, *_) = self._columns
        return control_input.fresh or state.fresh

    def present(self) -> Sequence[Array]:
        """What stands there now; a column that is written gets another array, so this is no copy."""
        return [column.values for column, *_ in self._columns]

    def offences(self, before: Sequence[Array] | None) -> Iterator[tuple[Sequence[int], str]]:
        """Find what was written since the last time and is not finite or has run away.

        Args:
            before: What stood there before and is put back in its place; None to leave it.

        Yields:
            Rows, ascending, and what is wrong with the first of them.
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
