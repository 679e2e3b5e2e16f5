"""Finite transition systems: states, initial states, transitions, and the labels that hold in each state."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

_EDGE = re.compile(r'^\s*"?([^"\[\]{};>]+?)"?\s*->\s*"?([^"\[\]{};>]+?)"?\s*(?:\[.*\])?;?\s*$')
_NODE = re.compile(r'^\s*"?([^"\[\]{};>=]+?)"?\s*(?:\[(.*)\])?;?\s*$')
_LABELS = re.compile(r'labels\s*=\s*"([^"]*)"')


@dataclass(frozen=True)
class TransitionSystem:
    """A finite transition system. A state is referred to by its index in `states`.

    Attributes:
        states: The names of the states.
        initial: The states in which it may begin, ascending.
        successors: For each state the states that may follow, each once; those of a state are in the order in which a
            synthesised strategy prefers them.
        labels: The states in which each label holds, by label. The labels that hold in a state are its observation.
    """

    states: tuple[str, ...]
    initial: tuple[int, ...]
    successors: tuple[tuple[int, ...], ...]
    labels: Mapping[str, frozenset[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        known = range(len(self.states))
        if not self.states or len(set(self.states)) < len(self.states):
            raise ValueError("a transition system has at least one state, and no two of one name")
        if len(self.successors) != len(self.states):
            raise ValueError(f"there are {len(self.states)} states, and successors of {len(self.successors)}")
        named = (self.initial, *self.successors, *self.labels.values())
        if any(each not in known for states in named for each in states):
            raise ValueError("initial states, transitions and labels refer to states of the system")
        if any(len(set(states)) < len(states) for states in self.successors):
            raise ValueError("a state follows another at most once")

    @classmethod
    def of(
        cls,
        transitions: Mapping[str, Collection[str]],
        initial: Iterable[str] | None = None,
        labels: Mapping[str, Iterable[str]] | None = None,
    ) -> Self:
        """Create a transition system from names.

        Args:
            transitions: The states that may follow each state; every state is a key.
            initial: The initial states; all by default.
            labels: The states in which each label holds.

        Raises:
            ValueError: A name is not that of a state.
        """
        index = {name: place for place, name in enumerate(transitions)}

        def places(names: Iterable[str]) -> tuple[int, ...]:
            for name in names:
                if name not in index:
                    raise ValueError(f"there is no state `{name}`")
            return tuple(index[name] for name in names)

        return cls(
            tuple(index),
            tuple(sorted(places(list(index if initial is None else initial)))),
            tuple(places(list(following)) for following in transitions.values()),
            {label: frozenset(places(list(where))) for label, where in (labels or {}).items()},
        )

    @classmethod
    def from_data(cls, data: Any) -> Self:
        """Create a transition system from plain data, as in a YAML file: see docs/knowledge.md.

        Raises:
            ValueError: The data do not describe a transition system.
        """
        if not isinstance(data, Mapping) or not isinstance(data.get("transitions"), Mapping):
            raise ValueError("a transition system has `transitions`: a list of following states for each state")
        unknown = sorted(map(str, data.keys() - {"transitions", "initial", "labels"}))
        if unknown:
            raise ValueError(f"a transition system has no `{unknown[0]}`; it has transitions, initial and labels")
        marked, initial = data.get("labels") or {}, data.get("initial")
        if not isinstance(marked, Mapping):
            raise ValueError("`labels` of a transition system is a list of states for each label")
        transitions = {
            str(name): _names(after, f"the states after `{name}`") for name, after in data["transitions"].items()
        }
        labels = {str(name): _names(where, f"the states with the label `{name}`") for name, where in marked.items()}
        return cls.of(transitions, None if initial is None else _names(initial, "`initial`"), labels)

    @classmethod
    def from_dot(cls, text: str) -> Self:
        """Create a transition system from a graph in the language DOT, one statement per line.

        The attribute ``labels="a b"`` of a node has its labels; a node ``init`` that is an arrow's start marks initial
        states.

        Raises:
            ValueError: A line is not a node or an edge.
        """
        transitions: dict[str, list[str]] = {}
        labels: dict[str, list[str]] = {}
        initial: list[str] = []
        for number, line in enumerate(text.splitlines(), 1):
            bare = line.split("//")[0].strip()
            if (
                not bare
                or bare == "}"
                or (bare.startswith("digraph") and bare.endswith("{"))
                or bare.startswith(("rankdir", "node ", "edge ", "#", "init;", "init ["))
            ):
                continue
            if edge := _EDGE.match(bare):
                start, end = edge.groups()
                transitions.setdefault(end, [])
                if start == "init":
                    initial.append(end)
                else:
                    transitions.setdefault(start, []).append(end)
            elif node := _NODE.match(bare):
                name, attributes = node.groups()
                transitions.setdefault(name, [])
                if found := _LABELS.search(attributes or ""):
                    for label in found.group(1).split():
                        labels.setdefault(label, []).append(name)
            else:
                raise ValueError(f"line {number} is not a node or an edge: {bare}; write one on each line")
        return cls.of(transitions, initial or None, labels)

    def observation(self, state: int) -> frozenset[str]:
        """Return the labels that hold in a state."""
        return frozenset(label for label, where in self.labels.items() if state in where)

    def avoiding(self, states: Collection[int]) -> TransitionSystem:
        """Return the system without transitions to some states.

        All states stay, with their indices; those that are avoided can be left, but neither be entered nor stayed in.
        """
        avoided = frozenset(states)
        successors = tuple(tuple(each for each in after if each not in avoided) for after in self.successors)
        return replace(self, successors=successors)

    def product(self, other: TransitionSystem) -> TransitionSystem:
        """Return the synchronous product: both move at each step, and each keeps its labels."""
        width = len(other.states)

        def joint(mine: Iterable[int], its: Sequence[int]) -> tuple[int, ...]:
            return tuple(one * width + another for one in mine for another in its)

        every, others = range(len(self.states)), range(width)
        shared = sorted(self.labels.keys() & other.labels.keys())
        if shared:
            raise ValueError(f"both have the label `{shared[0]}`")
        return TransitionSystem(
            tuple(f"{one},{another}" for one in self.states for another in other.states),
            joint(self.initial, other.initial),
            tuple(joint(self.successors[one], other.successors[another]) for one in every for another in others),
            {
                **{label: frozenset(joint(sorted(where), others)) for label, where in self.labels.items()},
                **{label: frozenset(joint(every, sorted(where))) for label, where in other.labels.items()},
            },
        )

    def dot(self) -> str:
        """Return the system as a graph in the language DOT, which `from_dot` reads."""
        lines = ["digraph {", "  init [shape=point];"]
        for state, name in enumerate(self.states):
            lines.append(f'  "{name}" [labels="{" ".join(sorted(self.observation(state)))}"];')
        lines += [f'  init -> "{self.states[state]}";' for state in self.initial]
        for state, after in enumerate(self.successors):
            lines += [f'  "{self.states[state]}" -> "{self.states[following]}";' for following in after]
        return "\n".join([*lines, "}", ""])


def _names(value: Any, what: str) -> list[str]:
    """Return the names in a list of plain data; nothing at all is an empty list.

    Raises:
        ValueError: The value is no list.
    """
    if value is None:
        return []
    if not isinstance(value, list | tuple):
        raise ValueError(f"{what}: {value!r} is no list of states")
    return [str(each) for each in value]
