"""Formulas of specifications as syntax trees, for components of plugins that do more with them than read their status.

A component that names specifications (`BaseComponent.specifications`) receives each as a `Specification` in
`check_specification`, and finds it during a run in `AgentGroup.specifications`. Its `formulation.tree` is made of the
nodes below; `printed` turns one into text.
"""

from symaware_cli.geometry import Region
from symaware_cli.specification import Specification, printed
from symaware_cli.specification.node import (
    Arithmetic,
    Call,
    Comparison,
    Constant,
    Element,
    Junction,
    Name,
    Node,
    Not,
    Sign,
    Temporal,
    Vector,
    walk,
)

__all__ = [
    "Arithmetic",
    "Call",
    "Comparison",
    "Constant",
    "Element",
    "Junction",
    "Name",
    "Node",
    "Not",
    "Region",
    "Sign",
    "Specification",
    "Temporal",
    "Vector",
    "printed",
    "walk",
]
