"""Which specifications can be evaluated with others at the worst places of their regions: where nearer is worse."""

from __future__ import annotations

from symaware_cli.specification.formula import Formula, Not, Predicate, operands
from symaware_cli.specification.node import Comparison, Name, Node, walk
from symaware_cli.specification.specification import Specification

#: The names that grow with the distance of others.
_DISTANCES = frozenset({"distance", "nearest"})

#: The names that depend on others in another way, in specifications of pairs.
_OF_PAIRS = frozenset({"closing_speed", "position", "speed", "velocity"})


def check_worst_case(specification: Specification) -> None:
    """Check that the worst place of another in its region is the nearest one.

    Raises:
        ValueError: A predicate depends on others otherwise than by their distance, or fails where they are far away.
    """
    if specification.automaton is not None:
        raise ValueError("with `others: regions`, it must not be in linear temporal logic")
    moving = {name for name, each in specification.scope.regions.items() if each.region.around is not None}
    dependent = _DISTANCES | moving | (_OF_PAIRS if specification.each is None else frozenset())
    atoms = specification.formulation.atoms
    for index, is_positive in sorted(_polarities(specification.formulation.formula, is_positive=True)):
        node = atoms[index].node
        if _names(node) & dependent and not _is_worst_nearby(node, is_positive, dependent):
            raise ValueError(
                f"with `others: regions`, `{atoms[index].text}` has no worst place of another: predicates about others "
                "are comparisons such as `distance > 0.6` or `nearest > 0.6`, which hold if they are far away"
            )


def _is_worst_nearby(node: Node, is_positive: bool, dependent: frozenset[str]) -> bool:
    match node:
        case Comparison(operators=(operator,), operands=(left, right)) if operator in ("<", "<=", ">", ">="):
            greater, less = (left, right) if operator in (">", ">=") else (right, left)
            far, near = (greater, less) if is_positive else (less, greater)
            return isinstance(far, Name) and far.name in _DISTANCES and not _names(near) & dependent
    return False


def _names(node: Node) -> set[str]:
    return {each.name for each in walk(node) if isinstance(each, Name)}


def _polarities(formula: Formula, *, is_positive: bool) -> set[tuple[int, bool]]:
    """Return each predicate with whether the formula can only gain from its truth, or only lose."""
    match formula:
        case Predicate(index):
            return {(index, is_positive)}
        case Not(operand):
            return _polarities(operand, is_positive=not is_positive)
    return {found for each in operands(formula) for found in _polarities(each, is_positive=is_positive)}
