"""The game of an agent against its environment, from the parameters of a strategy, and the beliefs about its state."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, cast

import numpy as np
from pydantic import Discriminator, Field, Tag

from symaware_cli.core import AgentGroup, Environment, Parameters
from symaware_cli.geometry import Array, Indices
from symaware_cli.knowledge.abstraction.knowledge_model import model_named
from symaware_cli.knowledge.synthesis.fair_play import can_be_kept
from symaware_cli.knowledge.synthesis.fragment import LIVENESS, clauses
from symaware_cli.knowledge.synthesis.game import Game, Statement
from symaware_cli.knowledge.synthesis.vocabulary import Variable, Vocabulary, names_in_formula
from symaware_cli.specification import (
    BeliefScope,
    ExpressionError,
    Formulation,
    PlacedRegion,
    World,
    formulate,
    parse,
    region_names,
)
from symaware_cli.specification import formula as stl
from symaware_cli.specification.columns import ARGUMENTS, NO_VALUE, TAKEN, check_momentary
from symaware_cli.world import SECOND, ParameterError, Roster


class AgentInRegion(Parameters):
    """Whether another agent is in a region."""

    agent: str = Field(description="The id of the agent, such as `door`.")
    inside: str = Field(description="The name of the region.")

    @property
    def other(self) -> str:
        """The id of the agent."""
        return self.agent


class AgentCell(Parameters):
    """The cell of another agent."""

    cell_of: str = Field(description="The id of the agent, such as `robot.1`.")

    @property
    def other(self) -> str:
        """The id of the agent."""
        return self.cell_of


def _kind(label: object) -> str:
    """Return which kind of label was meant."""
    if isinstance(label, AgentCell) or (isinstance(label, Mapping) and {"agent", "inside"}.isdisjoint(label)):
        return "the cell of an agent"
    return "an agent in a region" if isinstance(label, Mapping | AgentInRegion) else "a condition"


#: A label; problems with it refer to the kind of label that was probably meant.
Label = Annotated[
    Annotated[str, Tag("a condition")]
    | Annotated[AgentInRegion, Tag("an agent in a region")]
    | Annotated[AgentCell, Tag("the cell of an agent")],
    Discriminator(_kind),
]


class GameParameters(Parameters):
    """Knowledge about the environment, and the goals."""

    model: str = Field(description="The knowledge model, by its name under `knowledge_models`.")
    labels: dict[str, Label] = Field(
        default_factory=dict,
        description="What formulas say about the environment, by name: a condition on what the agent believes, such"
        " as `knowledge.open > 0`; {agent: ID, inside: REGION}; or the cell of another agent, {cell_of: ID}.",
    )
    assumptions: tuple[str, ...] = Field((), description="What the environment is known to do, as formulas.")
    guarantees: tuple[str, ...] = Field(min_length=1, description="What the agent is to achieve, as formulas.")


class KnowledgeGame:
    """The game of an agent against its environment, as the parameters of a component state it.

    Attributes:
        model: The knowledge model.
        game: The game.
        starts: The cells in which the agents of the group begin, ascending.
    """

    def __init__(self, parameters: GameParameters, group: AgentGroup) -> None:
        """Make the game.

        Raises:
            ParameterError: A parameter is invalid.
            ValueError: An agent begins in no cell.
        """
        self._labels = parameters.labels
        self.model = model = model_named(parameters.model, group)
        for name, label in self._labels.items():
            if isinstance(label, AgentCell) and model.parts():
                said = f"where `{label.cell_of}` is does not tell all of its state in a product; name a region instead"
                raise ParameterError(f"{said}: {{agent: {label.cell_of}, inside: REGION}}", ("labels", name))
            _check_label(name, label, group)
        self._regions = {
            name: PlacedRegion(name, group.regions, _nowhere)
            for name, region in group.regions.items()
            if region.around is None
        }
        self._propositions = {
            name: self._proposition(name, label, group)
            for name, label in self._labels.items()
            if isinstance(label, str)
        }
        variables = [
            Variable(name, model.system if isinstance(label, AgentCell) else None)
            for name, label in self._labels.items()
        ]
        try:
            vocabulary = Vocabulary(model.system, variables)
            assumptions = _statements("assumptions", parameters.assumptions, vocabulary)
            self.game = Game(vocabulary, assumptions, _statements("guarantees", parameters.guarantees, vocabulary))
        except ParameterError:
            raise
        except ValueError as error:  # names that clash, or a game that is too large
            raise ParameterError(str(error), ("labels",) if self._labels else ()) from None
        positions = group.model.positions(group.initial_state)
        cells = model.cells(positions)
        if (cells < 0).any():
            row = int(np.flatnonzero(cells < 0)[0])
            raise ValueError(f"{group.ids[row]} begins at {positions[row].tolist()}, which is in no cell")
        initial = set(model.system.initial)
        for row, cell in enumerate(cells.tolist()):
            if cell not in initial:
                names = ", ".join(f"`{model.system.states[each]}`" for each in model.system.initial)
                said = f"{group.ids[row]} begins in `{model.system.states[cell]}`, which is no initial state"
                raise ParameterError(f"{said} of the knowledge model; there are: {names}", ("model",))
        self.starts = sorted(set(cells.tolist()))

    def _proposition(self, name: str, text: str, group: AgentGroup) -> Formulation:
        """Parse a condition on the beliefs of an agent."""
        try:
            scope = BeliefScope(group, cast("World", None), [], {})
            tree = parse(text, {**region_names(self._regions), **dict.fromkeys(scope.names)}, ARGUMENTS)
            check_momentary(tree, "a formula: a label is about one instant")
            return formulate(tree, SECOND)
        except ExpressionError as error:
            raise ParameterError(text, ("labels", name)) from error

    @property
    def awaited(self) -> dict[int, set[str]]:
        """The agents that liveness assumptions are about, by the number of the assumption."""
        found: dict[int, set[str]] = {}
        for number, statement in enumerate(self.game.assumptions):
            for clause in statement.clauses:
                if clause.kind in LIVENESS:
                    names = set[str]().union(*(names_in_formula(node) for node in (clause.node, clause.answer) if node))
                    about = [label for name, label in self._labels.items() if name in names]
                    found.setdefault(number, set()).update(each.other for each in about if not isinstance(each, str))
        return found

    @property
    def named_agents(self) -> dict[tuple[str, str], str]:
        """The agents that labels are about, by the name of the label and the key that names the agent."""
        return {
            (name, "cell_of" if isinstance(label, AgentCell) else "agent"): label.other
            for name, label in self._labels.items()
            if not isinstance(label, str)
        }

    def contradictory_assumptions(self) -> Sequence[int] | None:
        """Return the numbers of assumptions that no environment can keep, a single one if possible; None for none."""
        numbers = range(len(self.game.assumptions))
        # Each by itself first, so that the culprit is named.
        for chosen in [*((number,) for number in numbers), tuple(numbers)]:
            statements = [self.game.assumptions[number] for number in chosen]
            if not can_be_kept(Game(self.game.vocabulary, statements, ()), self.starts):
                return chosen
        return None

    def undefined(self, group: AgentGroup, environment: Environment) -> Iterator[tuple[str, str]]:
        """Yield the name of each label whose condition has no value at the beginning, and the reason."""
        scope = BeliefScope(group, environment, [], {})
        for name, formulation in self._propositions.items():
            try:
                self._truth(formulation, group, scope)
            except NO_VALUE as error:
                yield name, str(error).strip("'\"")

    def check_others(self, roster: Roster) -> None:
        """Check that the agents that labels are about exist.

        Raises:
            ValueError: One does not.
        """
        for name, label in self._labels.items():
            if not isinstance(label, str) and label.other not in roster:
                raise ValueError(f"the label `{name}` is about `{label.other}`, which is no agent")

    def observed(self, group: AgentGroup, scope: BeliefScope, roster: Roster) -> list[Indices]:
        """Return the value of each environment variable as the agents believe it.

        Returns:
            For each variable its value by agent, shape (n,); -1 for an agent without a belief.
        """
        found = []
        for name, label in self._labels.items():
            if isinstance(label, str):
                found.append(self._truth(self._propositions[name], group, scope))
                continue
            positions = _believed(group, roster.index(label.other))
            known = np.isfinite(positions).all(axis=1)
            values = np.full(len(positions), -1, np.intp)
            if known.any():
                if isinstance(label, AgentCell):
                    values[known] = self.model.cells(positions[known])
                else:
                    values[known] = self._regions[label.inside].robustness(positions[known]) > 0.0
            found.append(values)
        return found

    def _truth(self, formulation: Formulation, group: AgentGroup, scope: BeliefScope) -> Indices:
        def look_up(name: str) -> Any:
            return self._regions[name] if name in self._regions else scope.look_up(name)

        with np.errstate(all="ignore"):
            each = [np.asarray(atom.robustness(look_up)) for atom in formulation.atoms]
        truth = _holds(formulation.formula, each)
        return np.asarray(np.broadcast_to(truth, (len(group),)).astype(np.intp))


def _statements(section: str, texts: Sequence[str], vocabulary: Vocabulary) -> list[Statement]:
    found = []
    for number, text in enumerate(texts):
        try:
            found.append(Statement(text, clauses(text, vocabulary)))
        except ExpressionError as error:
            raise ParameterError(text, (section, number)) from error
    return found


def _believed(group: AgentGroup, other: int) -> Array:
    """Return the position of another agent as each agent believes it [m], NaN without a belief; shape (n, 2)."""
    tracks, world = group.awareness.tracks, group.awareness.world
    positions = np.full((len(group), 2), np.nan)
    if tracks is not None:
        rows = np.flatnonzero(tracks.others == other)
        positions[tracks.observers[rows]] = tracks.positions[rows, :2]
    elif world is not None:
        positions[:] = world.positions[other, :2]
    return positions


def _holds(formula: stl.Formula, values: Sequence[Array]) -> Any:
    """Return whether a formula about one instant holds, from the encoded robustness of its predicates."""
    match formula:
        case stl.Constant(value=value):
            return np.bool_(value)
        case stl.Predicate(index=index):
            return values[index] > 0.0
        case stl.Not(operand=operand):
            return ~_holds(operand, values)
        case stl.And(operands=operands):
            return np.logical_and.reduce(np.broadcast_arrays(*(_holds(each, values) for each in operands)))
        case stl.Or(operands=operands):
            return np.logical_or.reduce(np.broadcast_arrays(*(_holds(each, values) for each in operands)))
    raise TypeError(f"{type(formula).__name__} is not about one instant")


def _check_label(name: str, label: str | AgentInRegion | AgentCell, group: AgentGroup) -> None:
    """Check that formulas can use the name of a label, and that its region exists and does not move with an agent.

    Raises:
        ParameterError: The name or the region is invalid.
    """
    if not name.isidentifier() or name in TAKEN:
        raise ParameterError(f"`{name}` cannot be a name in a formula", ("labels", name))
    if not isinstance(label, AgentInRegion):
        return
    region = group.regions.get(label.inside)
    if region is None:
        known = ", ".join(sorted(group.regions)) or "none"
        said = f"there is no region `{label.inside}`; there are: {known}"
        raise ParameterError(said, ("labels", name, "inside"))
    if region.around is not None:
        said = f"the region `{label.inside}` moves with `{region.around}`; a label needs one that keeps its place"
        raise ParameterError(said, ("labels", name, "inside"))


def _nowhere(agent: str) -> tuple[Array, float | None]:
    raise ValueError(f"the region moves with `{agent}`")
