"""Builds the monitored specifications from the sections of a scenario, and reports problems with them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import combinations, islice, permutations, product

import numpy as np

from symaware_cli.core import AgentGroup, Environment, nanoseconds
from symaware_cli.core.verdict import OFFERS
from symaware_cli.engine import ComponentEntry, Trigger, WorldColumns
from symaware_cli.geometry import Region
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.problem import nearest, quoted
from symaware_cli.language.section import TriggerSection
from symaware_cli.language.source import Path
from symaware_cli.language.specification_section import OfferSection, SpecificationUse
from symaware_cli.language.timing_check import TimingCheck, trigger_of
from symaware_cli.specification import (
    PAIR_UNITS,
    AgentScope,
    Automaton,
    AutomatonError,
    AwarenessScope,
    BeliefScope,
    ClosestPairScope,
    ExpressionError,
    Formulation,
    Offer,
    PairScope,
    RegionError,
    Scope,
    Specification,
    check_least,
    check_names,
    check_units,
    formulate,
    parse,
)
from symaware_cli.specification.columns import ARGUMENTS, NO_VALUE, TAKEN
from symaware_cli.specification.node import Name, Node, walk

#: The maximum number of pairs with a verdict each; of more pairs, only the closest is evaluated at each instant.
MOST_PAIRS = 10_000


class SpecificationBuilder:
    """Builds the specifications of a scenario, and reports problems with them."""

    def __init__(
        self,
        check: TimingCheck,
        environment: Environment,
        groups: Sequence[AgentGroup],
        entries: Sequence[ComponentEntry],
    ) -> None:
        """Prepare.

        Args:
            check: Parses expressions and events, and takes problems.
            environment: The world.
            groups: All groups.
            entries: All components.
        """
        self._report = check.diagnosis.report
        self._report_expression = check.diagnosis.report_expression
        self._check = check
        self._world = environment
        self._groups = {group.name: group for group in groups}
        self._entries = entries
        self._ids = {id: (group, row) for group in groups for row, id in enumerate(group.ids)}
        self._regions: Mapping[str, Region] = {}
        self._entities: Collection[str] = ()
        self._steps = 0
        #: The events with which instances of specifications begin, by name.
        self.triggers: dict[str, Trigger] = {}

    def build(self, document: ScenarioDocument) -> Sequence[Specification]:
        """Build the valid specifications, and report the problems of the others."""
        self._regions = self._sound_regions(document.regions)
        self._entities = tuple(document.environment.entities)
        self._steps = nanoseconds(document.run.duration) // self._world.time_step + 1
        found = {name: self._specification(name, use) for name, use in document.specifications.items()}
        for entry in self._entries:
            self._check_named(entry, document, found)
        return [each for each in found.values() if each is not None]

    def _check_named(
        self, entry: ComponentEntry, document: ScenarioDocument, found: Mapping[str, Specification | None]
    ) -> None:
        """Report specifications that a component names but cannot predict."""
        component, group = entry.components[0], entry.group.name
        if component.specifications is None:
            return
        path: Path = (*entry.section, "with", component.specifications)
        for place, name in enumerate(getattr(component.parameters, component.specifications)):
            use = document.specifications.get(name)
            if use is None:
                self._unknown(name, "specification", (*path, place), document.specifications)
            elif use.of != "truth":
                said = f"{quoted(name)} is about beliefs, and future beliefs are not predicted"
                self._report("unsuitable", said, (*path, place), expected="a specification of the truth")
            elif (use.each not in (None, group) and not component.specifications_of_others) or (
                use.each is None and use.pairs is None
            ):
                about = "the world" if use.each is None else quoted(use.each)
                said = f"{quoted(name)} is about {about}, not about the agents of {quoted(group)}"
                self._report("unsuitable", said, (*path, place), expected=f"`each: {group}`, or pairs")
            elif isinstance(getattr(found[name], "scope", None), ClosestPairScope):
                said = f"{quoted(name)} is about too many pairs for a monitor of each"
                self._report("unsuitable", said, (*path, place), expected=f"at most {MOST_PAIRS:,} pairs")
            elif found[name] is not None:
                try:
                    component.check_specification(found[name], entry.group)
                except ValueError as error:
                    self._report(
                        "unsuitable", f"{quoted(name)} does not suit {quoted(component.use)}: {error}", (*path, place)
                    )

    def _sound_regions(self, regions: Mapping[str, Region]) -> Mapping[str, Region]:
        """Return the valid regions, and report the problems of the others."""
        sound = dict(regions)
        for name, region in regions.items():
            path: Path = ("regions", name)
            if name in TAKEN:
                self._report("invalid-value", f"{quoted(name)} means something else in formulas", path, key=True)
                del sound[name]
            elif region.around is not None and region.around not in self._ids:
                self._unknown(region.around, "agent", (*path, "around"), self._ids)
                del sound[name]
        while True:
            try:
                check_names(sound)
            except RegionError as error:
                if error.name not in regions or error.name in sound:
                    suggestion = nearest(error.name, [each for each in regions if each != error.region])
                    path = ("regions", error.region)
                    self._report("unknown-region", str(error), path, key=True, suggestion=suggestion)
                del sound[error.region]
            else:
                return sound

    def _specification(self, name: str, use: SpecificationUse) -> Specification | None:
        path: Path = ("specifications", name)
        scope = self._scope(use, path)
        formulation = None if scope is None else self._formulation(use, scope, path)
        event, place = use.from_, (*path, "from")
        if use.offer is not None:
            event, place = use.offer.at, (*path, "offer", "at")
        if isinstance(event, TriggerSection):
            trigger = trigger_of(event.event, event.of)
            if use.each is None and trigger.source is None:
                said = "an event of an agent's own components belongs to a specification with `each`"
                self._report("invalid-value", said, place, expected="an `of` that names the source of the event")
                return None
            self._check.source(trigger, use.each, self._entries, place)
            self.triggers[name] = trigger
        offer = None if use.offer is None or use.each is None else self._offer(use.offer, use.each, (*path, "offer"))
        if scope is None or formulation is None:
            return None
        automaton = None
        if use.logic == "ltl":
            try:
                automaton = Automaton(formulation.formula, len(formulation.atoms))
            except AutomatonError as error:
                self._report("bad-expression", f"{quoted(name)}: {error}", (*path, "formula"))
                return None
        start = 0.0 if isinstance(use.from_, TriggerSection) else use.from_
        if use.offer is not None and not isinstance(use.offer.at, TriggerSection):
            start = max(start, use.offer.at)
        return Specification(
            name=name,
            of=use.of,
            each=use.each,
            scope=scope,
            formulation=formulation,
            start=nanoseconds(start),
            end=None if use.to is None else nanoseconds(use.to),
            on_violation=use.on_violation,
            interval=use.interval and automaton is None,
            automaton=automaton,
            offer=offer,
        )

    def _offer(self, use: OfferSection, each: str, path: Path) -> Offer | None:
        """The offer of a specification to agents; None after a problem."""
        said = [each] if use.to is None else [use.to] if isinstance(use.to, str) else use.to
        known = {name: group.ids for name, group in self._groups.items()} | {id: (id,) for id in self._ids}
        if each not in self._groups:
            return None
        wrong = False
        for place, name in enumerate(said):
            if name not in known:
                wrong = True
                whose = (*path, "to") if isinstance(use.to, str) else (*path, "to", place)
                self._unknown(name, "agent or group", whose, known)
        if wrong:
            return None
        told = tuple(dict.fromkeys(id for name in said for id in known[name]))
        for id in told:
            group, row = self._ids[id]
            if group.knowledge[row].setdefault(OFFERS, {}):
                said_of = f"`{OFFERS}` is the knowledge that contains the offers to agents"
                self._report("invalid-value", said_of, ("agents", group.name, "knowledge", OFFERS), key=True)
                return None
        return Offer(
            at=None if isinstance(use.at, TriggerSection) else nanoseconds(use.at),
            open_for=None if use.open_for is None else nanoseconds(use.open_for),
            epsilon=use.epsilon,
            to=told,
            knowledge=use.knowledge,
        )

    def _scope(self, use: SpecificationUse, path: Path) -> Scope | None:
        """The agents, pairs or world that a specification is about; None after a problem."""
        groups = list(self._groups.values())
        if use.each is not None:
            if use.each not in self._groups:
                self._unknown(use.each, "group", (*path, "each"), self._groups)
                return None
            kind = BeliefScope if use.of == "belief" else AgentScope
            return kind(self._groups[use.each], self._world, groups, self._regions)
        if use.pairs is None:
            return WorldColumns(self._world, groups, self._regions, self._entities, self._check.specifications)
        return self._pair_scope(use.pairs, (*path, "pairs"), of_awareness=use.of == "awareness")

    def _pair_scope(
        self, said: str | Sequence[tuple[str, str]], path: Path, *, of_awareness: bool = False
    ) -> Scope | None:
        """The scope of pairs of agents, in both orders if it is about awareness; None after a problem."""
        sets = self._pairs(said, path)
        if sets is None:
            return None
        groups = list(self._groups.values())
        every: Iterator[tuple[str, str]]
        if isinstance(said, str):
            paired = permutations if of_awareness else combinations
            every = (pair for ids, _ in sets for pair in paired(ids, 2))
        else:
            every = (pair for first, second in sets for pair in product(first, second) if pair[0] != pair[1])
        most = MOST_PAIRS * max((group.runs for group in groups), default=1)
        found = dict.fromkeys(islice(every, most))
        # The same pair may be named several times.
        while len(found) <= most and (more := next(every, None)) is not None:
            found[more] = None
        if not found:
            self._report("invalid-value", "there is no pair: it takes two agents", path, expected="two agents")
            return None
        if len(found) > most and of_awareness:
            said_of = f"awareness is of more than {MOST_PAIRS:,} ordered pairs"
            self._report("unsuitable", said_of, path, expected=f"`pairs` that name at most {MOST_PAIRS:,}")
            return None
        if of_awareness:
            return AwarenessScope(list(found), self._world, groups, self._regions)
        if len(found) > most:
            return ClosestPairScope(sets, self._world, groups, self._regions)
        return PairScope(list(found), self._world, groups, self._regions)

    def _pairs(
        self, said: str | Sequence[tuple[str, str]], path: Path
    ) -> Sequence[tuple[Sequence[str], Sequence[str]]] | None:
        """Sets of ids that are paired with each other; None after a problem."""
        if isinstance(said, str):
            if said not in self._groups:
                self._unknown(said, "group", path, self._groups)
                return None
            return [(ids, ids) for ids in _ids_by_run(self._groups[said])]
        known = {name: _ids_by_run(group) for name, group in self._groups.items()}
        known |= {id: [(id,)] for id in self._ids}
        wrong = [
            (number, place, name)
            for number, pair in enumerate(said)
            for place, name in enumerate(pair)
            if name not in known
        ]
        for number, place, name in wrong:
            self._unknown(name, "agent or group", (*path, number, place), known)
        if wrong:
            return None
        runs = max(group.runs for group in self._groups.values())
        return [(known[first][run], known[second][run]) for run in range(runs) for first, second in said]

    def _formulation(self, use: SpecificationUse, scope: Scope, path: Path) -> Formulation | None:
        """The formula, with the definitions under `where`; None after a problem."""
        definitions: dict[str, Node] = {}
        # A definition may be called as several regions begin.
        own = {name for name, keys in scope.names.items() if keys is None or keys.is_optional or not keys.is_joined}
        for name, text in use.where.items():
            place: Path = (*path, "where", name)
            if name in own or name in TAKEN:
                self._report("invalid-value", f"{quoted(name)} means something else in formulas", place, key=True)
                return None
            tree = self._tree(text, scope, definitions, place)
            if tree is None:
                return None
            definitions[name] = tree[0]
        found = self._tree(use.formula, scope, definitions, (*path, "formula"))
        if found is not None and isinstance(scope, ClosestPairScope):
            try:
                check_least(found[0])
            except ExpressionError as error:
                self._report_expression(use.formula, (*path, "formula"), error)
                return None
        return None if found is None else found[1]

    def _tree(
        self, text: str, scope: Scope, definitions: Mapping[str, Node], path: Path
    ) -> tuple[Node, Formulation] | None:
        try:
            tree = parse(text, scope.names, ARGUMENTS, definitions)
        except ExpressionError as error:
            word = text[error.start : error.end]
            if word in PAIR_UNITS and word not in scope.names and not text[error.end :].lstrip().startswith("("):
                said = f"`{word}` alone is of pairs of agents: give the specification `pairs` instead of `each`"
                error = ExpressionError(said, (error.start, error.end))
            self._report_expression(text, path, error, "a formula such as `always risk < 0.2`")
            return None
        try:
            for node in walk(tree):
                if isinstance(node, Name) and node.name in scope.ambiguous:
                    said = f"`{node.name}` is {scope.ambiguous[node.name]}; rename one of them"
                    raise ExpressionError(said, node.span)
            formulation = formulate(tree, self._world.time_step, self._steps)
            check_units(tree, scope.units)
        except ExpressionError as error:
            self._report_expression(text, path, error)
            return None
        return tree, formulation

    def _unknown(self, name: str, what: str, path: Path, known: Collection[str]) -> None:
        self._report(
            f"unknown-{what.split()[0]}",
            f"there is no {what} {quoted(name)}",
            path,
            expected=f"one of {', '.join(known)}" if len(known) <= 20 else f"the name of an {what}",
            suggestion=nearest(name, known),
        )


def _ids_by_run(group: AgentGroup) -> Sequence[tuple[str, ...]]:
    """The ids of a group, for each run that its rows belong to."""
    share = len(group) // group.runs
    return [group.ids[start : start + share] for start in range(0, len(group), share)]


def check_values(specifications: Sequence[Specification], diagnosis: Diagnosis) -> None:
    """Evaluate the predicates of specifications once, and report those that have no value at the beginning."""
    for specification in specifications:
        if isinstance(specification.scope, WorldColumns):
            continue
        path: Path = ("specifications", specification.name, "formula")
        for atom in specification.formulation.atoms:
            try:
                with np.errstate(all="ignore"):
                    atom.robustness(specification.scope.look_up)
            except NO_VALUE as error:
                said = str(error).strip("'\"")
                diagnosis.report(
                    "bad-expression", f"{quoted(specification.name)}: `{atom.text}` has no value: {said}", path
                )
