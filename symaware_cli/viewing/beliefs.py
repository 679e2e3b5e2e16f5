"""Beliefs of agents about others, decoded from awareness messages into columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import others_message
from symaware_cli.viewing.views import in_space

Array = NDArray[np.float64]
Integers = NDArray[np.intp]


@dataclass(frozen=True)
class Beliefs:
    """Beliefs of the agents of one group, ordered by message and observer.

    Attributes:
        times: (k,) of the messages [ns].
        told: (k, n) which agents each message covers; it contains all beliefs of these agents.
        message: (m,) index of the message of each belief.
        observer: (m,) row in the group of the agent that believes.
        who: (m,) roster index of the agent that the belief is about.
        places: (m, 3) believed position [m].
        covariances: (m, d, d) of the position [m^2], NaN where unknown; None if it is unknown for all.
        ages: (m,) age of the belief [s].
    """

    times: NDArray[np.int64]
    told: NDArray[np.bool_]
    message: Integers
    observer: Integers
    who: Integers
    places: Array
    covariances: Array | None
    ages: Array

    def of(self, row: int) -> tuple[NDArray[np.int64], Integers, NDArray[np.intp]]:
        """Return the beliefs of one agent.

        Returns:
            The times of the messages that cover it (j,) [ns], the number of beliefs in each (j,), and the indices of
            these beliefs.
        """
        telling, mine = self.told[:, row], np.flatnonzero(self.observer == row)
        counts = np.bincount(self.message[mine], minlength=len(self.times))
        return self.times[telling], counts[telling], mine


def read_beliefs(
    entries: Sequence[tuple[int, others_message.Awareness]], count: int, wanted: Sequence[int], dimension: int
) -> Beliefs:
    """Read the messages of one group.

    Args:
        entries: The time [ns] and content of each; agents that know the whole world have no beliefs besides it.
        count: How many agents the group has.
        wanted: The agents whose beliefs are read, as rows of the group.
        dimension: In how many dimensions they move; a belief begins with the position.
    """
    times = np.array([time for time, _ in entries], np.int64)
    told = np.zeros((len(entries), count), bool)
    for number, (_, message) in enumerate(entries):
        told[number, slice(None) if message.rows is None else message.rows] = True
    known = [(number * count, message) for number, (_, message) in enumerate(entries) if len(message.entities)]
    everyone = np.array(wanted)[None] + count * np.arange(len(entries))[:, None]
    others = _joined(known, count).others(count, dimension, everyone)
    return Beliefs(
        times=times,
        told=told,
        message=others.rows // count,
        observer=others.rows % count,
        who=others.entities,
        places=in_space(others.values),
        covariances=others.covariances,
        ages=others.ages,
    )


def _joined(entries: Sequence[tuple[int, others_message.Awareness]], count: int) -> others_message.Awareness:
    """Join messages into one; rows are counted from a first row that is given with each."""
    rows, lengths, columns = [], [], []
    for first, message in entries:
        here = np.arange(count) if message.rows is None else message.rows
        rows.append(first + here)
        lengths.append(np.broadcast_to(message.lengths, len(here)))
        columns.append(np.broadcast_to(message.columns, len(message.entities)))
    messages = [message for _, message in entries]
    # Zeros stand for covariances and ages that a message does not have.
    squares = [np.zeros(int((each.astype(np.int64) ** 2).sum())) for each in columns]
    spreads = [
        each.covariances if len(each.covariances) else zero for each, zero in zip(messages, squares, strict=True)
    ]
    whole: dict[str, Any] = {"rows": rows, "lengths": lengths, "columns": columns}
    whole |= {"entities": [each.entities for each in messages], "values": [each.values for each in messages]}
    whole["ages"] = [each.ages if len(each.ages) else np.zeros(len(each.entities)) for each in messages]
    whole["covariances"] = spreads if any(len(each.covariances) for each in messages) else []
    nothing = np.empty(0, np.int64)
    given: Any = {name: np.concatenate([nothing, *parts]) for name, parts in whole.items()}
    return others_message.Awareness(world=False, **given)
