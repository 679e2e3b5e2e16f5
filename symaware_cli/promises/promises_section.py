"""The section `promises` of scenarios: the regions that agents promise to stay in, and the agents that rely on that.

Reasons: docs/decisions/0099-promises.md
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from symaware_cli.core.identifiers import Name, Target
from symaware_cli.geometry import Region
from symaware_cli.language import Additions, ScenarioSection, Section, SectionContext, SpecificationUse, nearest
from symaware_cli.promises.promise import OnBroken, Promise, Promises, Reliance
from symaware_cli.specification import ExpressionError, parse, region_names
from symaware_cli.specification.node import Call, Node, Temporal
from symaware_cli.specification.node import Name as NameNode

#: The component that an agent needs to rely on promises.
MONITOR = "promises.monitor"

#: The component of agents whose promises are known only by messages.
TELL = "promises.tell"

#: The components that rely on promises, and how if their parameter `promises` does not say: they include the declared
#: probability that one is broken, or hold if all are kept.
RELYING: Mapping[str, str] = {
    "control.barrier-filter": "if-kept",
    "control.mpc": "paid",
    "risk.collision": "paid",
    "risk.map": "paid",
    "risk.specification": "paid",
    "risk.time-to-collision": "if-kept",
    "uncertainty.conformal": "if-kept",
}

_FORM = "always inside(position, red)"


class PromiseUse(Section):
    """A promise of one agent, or of each agent of a group, to others."""

    of: Target = Field(description="Agent that makes the promise, or group whose agents each make it for themselves.")
    formula: str = Field(
        max_length=2000,
        description="Promised formula: `always inside(position, REGION)`, with a box, a circle or a polygon that stands"
        " still.",
    )
    to: Target | list[Target] = Field(description="Agents and groups that receive the promise and may rely on it.")
    confidence: float = Field(
        0.99,
        gt=0.5,
        lt=1,
        description="Probability with which the promise is kept. Risks that rely on it include the rest, and others "
        "believe that it is broken if that is more probable than this.",
    )
    on_broken: OnBroken = Field(
        "distrust",
        description="Reaction of an agent that believes that the promise is broken: it no longer relies on promises of "
        "the other (`distrust`), it also stops (`stop`), or it only fires the event (`event`).",
    )


class PromisesSection(ScenarioSection):
    """Promises by name. Each is also a specification about the agent that makes it, so its truth is monitored."""

    form: ClassVar[Any] = dict[Name, Annotated[PromiseUse, Field()]]
    description: ClassVar[str] = (
        "Promises by name: regions that agents promise to stay in; others monitor promises on their beliefs "
        f"(`{MONITOR}`) and rely on them in predictions and risks."
    )

    def additions(self, written: Any, context: SectionContext) -> Additions:
        """Return a specification for each promise, about the agents that make it."""
        found: dict[str, SpecificationUse] = {}
        for name, each in sorted(context.document.promises.items()):
            if _region(name, each, context, report=False) is None:
                continue
            # A specification about one agent of several is a specification about the world.
            stated = {"each": each.of, "formula": each.formula}
            if each.of not in context.document.agents:
                stated = {"formula": each.formula.replace("position", f'position["{each.of}"]', 1)}
            found[name] = SpecificationUse.model_validate(stated)
        return Additions(specifications=found)

    def build(self, written: Any, context: SectionContext) -> Promises | None:
        """Return the promises; None if there are none."""
        document = context.document
        if document is None or not document.promises:
            return None
        radii = {id: agents.radius for agents in context.agents() for id in agents.ids}
        ids = {id: id.partition(".")[0] for id in radii}
        found: list[Promise] = []
        for name, each in sorted(document.promises.items()):
            shape = _region(name, each, context, report=True)
            makers = _ids(each.of, ids, context, name, "of")
            listed = [each.to] if isinstance(each.to, str) else each.to
            receivers: list[str] = []
            for place, target in enumerate(listed):
                where = ("to",) if isinstance(each.to, str) else ("to", place)
                some = _ids(target, ids, context, name, *where)
                receivers += some
                for group in sorted({ids[id] for id in some}):
                    _require_monitor(group, context, name, *where)
            if len(makers) == 1 and receivers and set(receivers) <= set(makers):
                context.report("an agent makes this promise only to itself", name, "to", expected="another agent")
            if shape is None:
                continue
            for maker in makers:
                to, components = frozenset(receivers) - {maker}, document.agents[ids[maker]].components
                is_told = any(one.use == TELL for one in components.values())
                found.append(Promise(name, maker, to, shape, each.confidence, each.on_broken, each.formula, is_told))
        groups = sorted({ids[id] for each in found for id in each.to})
        costs = {
            group: sum(1.0 - each.confidence for each in found if any(ids[id] == group for id in each.to))
            for group in groups
        }
        reliance = {group: _reliance(document.agents[group].components, costs[group]) for group in groups}
        return Promises(found, radii, reliance)


def _reliance(components: Mapping[str, Any], cost: float) -> Reliance:
    """Return which of the components of a group rely on promises, and how.

    Args:
        components: The components, by name.
        cost: The declared probability that one of the promises to the group is broken.
    """
    how = {
        name: each.with_.get("promises", RELYING[each.use]) for name, each in components.items() if each.use in RELYING
    }
    for name in how:
        if components[name].use == "control.mpc" and "maximal_risk" not in components[name].with_:
            how[name] = "if-kept"  # it moves what it expects of others into their regions, and bounds no risk
        elif components[name].use == "control.mpc" and how[name] == "paid":
            # Promises that cost all of a maximal risk do not count (`ChanceConstraints.paid`).
            how[name] = "paid" if cost < float(components[name].with_["maximal_risk"]) else "ignored"
    return Reliance(*(tuple(name for name, each in how.items() if each == kind) for kind in ("paid", "if-kept")))


def _ids(target: str, ids: Mapping[str, str], context: SectionContext, *place: str | int) -> list[str]:
    """Return the agents that a target names, and report an unknown name."""
    found = [id for id, group in ids.items() if target in (id, group)]
    if not found and target not in context.document.agents:
        known = [*dict.fromkeys(ids.values()), *(id for id, group in ids.items() if id != group)]
        context.report(
            f"there is no agent or group `{target}`",
            *place,
            code="unknown-target",
            expected=f"one of {', '.join(known)}",
            suggestion=nearest(target, known),
        )
    return found


def _require_monitor(group: str, context: SectionContext, *place: str | int) -> None:
    """Report a group that receives a promise and has no component that monitors it."""
    components = context.document.agents[group].components
    if not any(each.use == MONITOR for each in components.values()):
        said = f"`{group}` has no component `{MONITOR}`, so it could neither notice a breach nor rely on the promise"
        context.report(said, *place, expected=f"agents with `promises: {{use: {MONITOR}}}` after their perception")


def _region(name: str, use: PromiseUse, context: SectionContext, *, report: bool) -> Region | None:
    """Return the region that an agent promises to stay in; None for a formula that cannot be promised."""

    def refuse(message: str, expected: str = f"a formula such as `{_FORM}`") -> None:
        if report:
            context.report(message, name, "formula", expected=expected)

    regions = context.regions or context.document.regions
    try:
        node = parse(use.formula, {**region_names(regions), "position": None}, {"inside": 2})
    except ExpressionError as error:
        known = [each for each in regions if each not in ("position",)]
        listed = f"one of the regions {', '.join(known)}" if known else "a region under `regions`"
        refuse(f"`{use.formula}`: {error.problem}", f"`{_FORM}`, with {listed}")
        return None
    place = _promised(node)
    if place is None:
        refuse(f"`{use.formula}` cannot be promised: a promise is to stay in a region")
        return None
    region: Region | None = regions.get(place)
    if region is None:
        refuse(f"`{place}` is not a region")
    elif region.members:
        refuse(f"the region `{place}` is made of others", "a box, a circle or a polygon, which are convex")
    elif region.around is not None:
        refuse(f"the region `{place}` moves with `{region.around}`", "a region that stands still")
    elif region.dimensions < 2:
        refuse(f"the region `{place}` has one coordinate", "a region of the plane: a box has [x, x, y, y]")
    else:
        return region
    return None


def _promised(node: Node) -> str | None:
    """Return the name of the region in ``always inside(position, REGION)``; None for any other formula."""
    match node:
        case Temporal(
            operator="always",
            window=None,
            operands=(Call(function="inside", arguments=(NameNode(name="position"), NameNode(name=place))),),
        ):
            return place
    return None
