"""Finite transition systems: states, initial states, transitions, observations, and labels that hold in states."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

from symaware_cli.knowledge.abstraction.dot import DotError, DotGraph, read_dot

#: The node of a graph from which arrows lead to the initial states.
INITIAL = "init"


class GraphError(ValueError):
    """Data describe no transition system.

    Attributes:
        place: The keys and indices of the part of the data that is wrong.
    """

    def __init__(self, message: str, *place: str | int) -> None:
        super().__init__(message)
        self.place = place


@dataclass(frozen=True)
class TransitionSystem:
    """A finite transition system. A state is referred to by its index in `states`.

    Attributes:
        states: The names of the states.
        initial: The states in which it may begin, ascending.
        successors: For each state the states that may follow, each once; those of a state are in the order in which a
            synthesised strategy prefers them.
        labels: The states in which each label holds, by label.
        observations: The set of observations, by name; the states themselves by default.
        observed: The observation map: the index of the observation of each state; by default each has its own.
    """

    states: tuple[str, ...]
    initial: tuple[int, ...]
    successors: tuple[tuple[int, ...], ...]
    labels: Mapping[str, frozenset[int]] = field(default_factory=dict)
    observations: tuple[str, ...] = ()
    observed: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        known = range(len(self.states))
        if not self.observations and not self.observed:
            object.__setattr__(self, "observations", self.states)
            object.__setattr__(self, "observed", tuple(known))
        if len(set(self.observations)) < len(self.observations):
            raise ValueError("no two observations of a transition system have one name")
        if len(self.observed) != len(self.states) or any(
            each not in range(len(self.observations)) for each in self.observed
        ):
            raise ValueError("each state of a transition system has one observation of its set")
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
        observations: Mapping[str, Iterable[str]] | None = None,
    ) -> Self:
        """Create a transition system from names.

        Args:
            transitions: The states that may follow each state; every state is a key.
            initial: The initial states; all by default.
            labels: The states in which each label holds.
            observations: The states in which each observation is made, every state once; by default, every state has an
                observation of its own, with its name.

        Raises:
            ValueError: A name is not that of a state, or a state has no observation or several.
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
            *_observation_map(tuple(index), {name: list(where) for name, where in (observations or {}).items()}),
        )

    @classmethod
    def from_data(cls, data: Any) -> Self:
        """Create a transition system from plain data, as in a YAML file: see docs/knowledge.md.

        Raises:
            GraphError: The data do not describe a transition system.
        """
        if not isinstance(data, Mapping) or not isinstance(data.get("transitions"), Mapping):
            raise GraphError("a transition system has `transitions`: a list of following states for each state")
        for key in data:
            if key not in ("transitions", "initial", "labels", "observations"):
                said = f"a transition system has no `{key}`; it has transitions, initial, labels and observations"
                raise GraphError(said, str(key))
        marked, initial, seen = data.get("labels") or {}, data.get("initial"), data.get("observations") or {}
        for key, value in (("labels", marked), ("observations", seen)):
            if not isinstance(value, Mapping):
                raise GraphError(f"`{key}` of a transition system is a list of states for each of the {key}", key)
        known = [str(name) for name in data["transitions"]]
        if not known:
            raise GraphError("a transition system has at least one state", "transitions")
        transitions = {
            str(name): _names(after, f"the states after `{name}`", known, "transitions", str(name))
            for name, after in data["transitions"].items()
        }
        labels = {
            str(name): _names(where, f"the states with the label `{name}`", known, "labels", str(name))
            for name, where in marked.items()
        }
        observations = {
            str(name): _names(where, f"the states with the observation `{name}`", known, "observations", str(name))
            for name, where in seen.items()
        }
        begins = None if initial is None else _names(initial, "`initial`", known, "initial")
        try:
            return cls.of(transitions, begins, labels, observations)
        except ValueError as error:
            raise GraphError(str(error), "observations") from error

    @classmethod
    def from_dot(cls, text: str) -> Self:
        """Create a transition system from a directed graph in the language DOT.

        The attribute ``labels="a b"`` of a node has its labels, ``observation="c"`` its observation; a node ``init``
        that is an arrow's start marks initial states.

        Raises:
            ValueError: The text is no such graph; the message begins with its line and column.
        """
        try:
            return cls.from_graph(read_dot(text))
        except DotError as error:
            raise ValueError(f"line {error.line}, column {error.column}: {error}") from error

    @classmethod
    def from_graph(cls, graph: DotGraph) -> Self:
        """Create a transition system from a graph; see `from_dot`.

        Raises:
            DotError: It has no node, two equal edges although it is not strict, or observations of some nodes only.
        """
        transitions: dict[str, list[str]] = {name: [] for name in graph.nodes if name != INITIAL}
        initial: list[str] = []
        for one, other, token in graph.edges:
            if other == INITIAL:
                token.refuse(f"`{INITIAL}` marks initial states, and no state precedes it")
            after = initial if one == INITIAL else transitions[one]
            if other not in after:
                after.append(other)
            elif not graph.is_strict:
                token.refuse(f"the edge from `{one}` to `{other}` is there twice; only a `strict` graph may repeat it")
        if not transitions:
            raise DotError("a transition system has at least one state", 1, 1)
        labels: dict[str, list[str]] = {}
        observations: dict[str, list[str]] = {}
        for name in transitions:
            for label in dict.fromkeys(graph.nodes[name].get("labels", "").split()):
                labels.setdefault(label, []).append(name)
            if "observation" in graph.nodes[name]:
                observations.setdefault(graph.nodes[name]["observation"], []).append(name)
        seen = {name for where in observations.values() for name in where}
        for name in transitions:
            if seen and name not in seen:
                graph.tokens[name].refuse(f"the state `{name}` has no observation, and others have one")
        return cls.of(transitions, initial or None, labels, observations)

    def observation(self, state: int) -> str:
        """Return the observation of a state."""
        return self.observations[self.observed[state]]

    def labels_in(self, state: int) -> frozenset[str]:
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
        """Return the synchronous product: both move at each step, each keeps its labels, and both are observed."""
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
            tuple(f"{one},{another}" for one in self.observations for another in other.observations),
            tuple(one * len(other.observations) + another for one in self.observed for another in other.observed),
        )

    def dot(self) -> str:
        """Return the system as a graph in the language DOT, which `from_dot` reads."""
        lines = ["digraph {", "  init [shape=point];"]
        for state, name in enumerate(self.states):
            seen = "" if self.observations == self.states else f', observation="{self.observation(state)}"'
            lines.append(f'  "{name}" [labels="{" ".join(sorted(self.labels_in(state)))}"{seen}];')
        lines += [f'  init -> "{self.states[state]}";' for state in self.initial]
        for state, after in enumerate(self.successors):
            lines += [f'  "{self.states[state]}" -> "{self.states[following]}";' for following in after]
        return "\n".join([*lines, "}", ""])


def _observation_map(
    states: Sequence[str], observations: Mapping[str, Sequence[str]]
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return the observations, and the index of that of each state; nothing if none are given.

    Raises:
        ValueError: A state has no observation or several, or there is no such state.
    """
    if not observations:
        return (), ()
    found: dict[str, int] = {}
    for place, (name, where) in enumerate(observations.items()):
        for state in where:
            if state not in states:
                raise ValueError(f"there is no state `{state}`, which has the observation `{name}`")
            if found.setdefault(state, place) != place:
                raise ValueError(f"the state `{state}` has two observations; a state has one")
    for state in states:
        if state not in found:
            raise ValueError(f"the state `{state}` has no observation; either every state has one, or none is given")
    return tuple(observations), tuple(found[state] for state in states)


def _names(value: Any, what: str, known: Collection[str], *place: str) -> list[str]:
    """Return the names in a list of plain data; nothing at all is an empty list.

    Raises:
        GraphError: The value is no list, or has a name that is not known or is there twice.
    """
    if value is None:
        return []
    if not isinstance(value, list | tuple):
        raise GraphError(f"{what}: {value!r} is no list of states", *place)
    found: list[str] = []
    for number, each in enumerate(value):
        name = str(each)
        if name not in known:
            raise GraphError(f"{what}: there is no state `{name}`", *place, number)
        if name in found:
            raise GraphError(f"{what}: `{name}` is there twice", *place, number)
        found.append(name)
    return found
