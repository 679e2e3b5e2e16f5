"""Simulations of batches: the agents of B runs of a group of n are one group of B x n rows.

Rows interact only with rows of the same run and draw the same random numbers as when run alone, so each run of a batch
is bitwise equal to the same run executed alone. Every component must declare that it can be batched; `refusal` names
the first that does not.

Reasons: docs/decisions/0032-batches.md
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, GroupComponent
from symaware_cli.engine import ComponentEntry, Simulation, Timing
from symaware_cli.language import (
    Diagnosis,
    Sampler,
    ScenarioError,
    SpecificationBuilder,
    TimingCheck,
    contains,
    is_placed,
)
from symaware_cli.language.build import Built
from symaware_cli.language.compose import Composition
from symaware_cli.specification import AgentScope, PairScope, Specification
from symaware_cli.studies.batch_ends import BATCH_NAMES
from symaware_cli.world import RANDOM, Plugin

Array = NDArray[np.float64]

#: The initial condition of a group: its states, shape (n, nx), and the knowledge of each.
Start = tuple[Array, Sequence[Mapping[str, Any]]]

#: The maximum numbers of agents and of pairs of agents in a batch; their arrays take some hundred bytes each.
_MOST_AGENTS, _MOST_PAIRS = 20_000, 400_000


def batch_size(built: Built) -> int:
    """Return the number of runs per batch, limited so that memory stays bounded."""
    agents = built.simulation.agent_count
    return max(1, min(_MOST_AGENTS // agents, _MOST_PAIRS // max(1, agents * (agents - 1) // 2)))


def refusal(built: Built) -> str | None:
    """Return a one-line reason why runs of a scenario cannot be batched; None if they can."""
    return next(_refusals(built), None)


def _refusals(built: Built) -> Iterator[str]:
    simulation, options, document = built.simulation, built.options, built.document
    environment, groups = simulation.environment, {group.name for group in simulation.groups}
    if options.mode != "synchronous":
        yield "components of the asynchronous mode take their turns at instants of their own"
    if built.drawn_sections:
        yield f"the section `{built.drawn_sections[0]}` draws other bodies in each run"
    if options.until is not None:
        unknown = {*options.until.names} - {*BATCH_NAMES, *document.regions}
        if unknown:
            yield f"`run.until` refers to `{min(unknown)}`"
        elif options.specifications:
            yield "specifications are final when `run.until` ends their run"
    if options.pace is not None:
        yield "a paced run keeps to the clock on the wall"
    if document.subscribers:
        yield "subscribers are called at the events of single runs"
    if options.faults:
        yield "faults are about single runs"
    if simulation.overrides is not None:
        yield "the control inputs of one run are given"
    if options.presence:
        yield "agents enter and leave"
    if simulation.exchange.network is not None or document.topology is not None:
        yield "messages go over a network"
    if not _declares(type(environment)):
        yield f"the environment `{simulation.environment_use}` moves one world"
    if environment.on_contact not in (None, "pass"):
        yield "contacts change how a run goes on"
    for name, region in document.regions.items():
        if region.around is not None:
            yield f"the region `{name}` moves with an agent"
    for group in simulation.groups:
        if is_placed(built.data["agents"][group.name]):
            yield f"agents or goals of `{group.name}` are placed in the free space of each run"
        if not _declares(type(group.model)):
            yield f"the model of `{group.name}` does not say that it can be batched"
    for entry in simulation.entries:
        first = entry.components[0]
        if entry.own or entry.rows is not None:
            yield f"`{entry.path}` has other parameters for some agents"
        elif not isinstance(first, GroupComponent):
            yield f"`{entry.path}` computes for one agent at a time"
        elif type(first).bodies:
            yield f"`{entry.path}` ({entry.use}) names single agents"
        elif not _declares(type(first)):
            yield f"`{entry.path}` ({entry.use}) does not say that it can be batched"
        elif first.repeatable_to is not None:
            yield f"`{entry.path}` ({entry.use}) repeats its results to a tolerance only"
        elif replace(entry.timing, period=None, offset=0) != Timing():
            yield f"`{entry.path}` has turns that depend on its run"
    for each in options.specifications:
        if each.of == "awareness":
            yield f"the contract `{each.name}` is about what single agents believe of each other"
        elif not isinstance(each.scope, AgentScope | PairScope):
            yield f"the specification `{each.name}` is about the world, or about too many pairs"
        elif isinstance(pairs := document.specifications[each.name].pairs, list) and not groups >= set(chain(*pairs)):
            yield f"the specification `{each.name}` is about single agents"
        elif each.on_violation == "end":
            yield f"the specification `{each.name}` ends runs at different steps"
        elif each.offer is not None:
            yield f"the specification `{each.name}` is offered while the run goes on"
        elif each.name in options.instances:
            yield f"instances of the specification `{each.name}` begin by events"


def _declares(kind: type[Plugin]) -> bool:
    """Return whether a class itself declares that it can be batched; the flag of a base class does not count."""
    return bool(vars(kind).get("batchable", False))


def starts_of(built: Built) -> Mapping[str, Start]:
    """Return the initial condition of each group in a run."""
    return {group.name: (group.initial_state, group.knowledge) for group in built.simulation.groups}


class BatchSimulation:
    """The simulation of runs of one scenario that differ in their seeds and, optionally, in their initial conditions.

    Attributes:
        simulation: The simulation; the ids of its agents begin with the number of their run, as in ``3:robot.0``.
        specifications: The specifications, stated for the rows of all runs.
    """

    def __init__(
        self,
        composition: Composition,
        built: Built,
        seeds: Sequence[int],
        starts: Sequence[Mapping[str, Start]] = (),
    ) -> None:
        """Build the simulation.

        Args:
            composition: The scenario.
            built: The same scenario, built for an arbitrary seed; it is used as a template and not run.
            seeds: The seed of each run.
            starts: The initial conditions of each run, by group, if they differ between runs; by default those of
                `composition`.

        Raises:
            ScenarioError: Values drawn for a seed are invalid.
        """
        self._built = built
        self._seeds = tuple(seeds)
        self._starts = starts
        self.simulation = self._simulated(composition)
        self.specifications = self._stated(composition)

    def take_seeds(self, seeds: Sequence[int]) -> None:
        """Keep other seeds, once everything that draws was given them; see `StateMark.go_back`."""
        self._seeds = tuple(seeds)
        self.simulation.seed = self._seeds[0]
        for group in self.simulation.groups:
            group.seeds = self._seeds
            group.surroundings.seed = self._seeds[0]

    def _simulated(self, composition: Composition) -> Simulation:
        built = self._built
        template = built.simulation
        kind = type(template.environment)
        environment = kind(template.environment.parameters)
        environment.folder = template.environment.folder
        environment.further_folders = template.environment.further_folders
        groups = {group.name: self._group(composition, group) for group in template.groups}
        entries = []
        for entry in template.entries:
            first = entry.components[0]
            component: Any = (
                type(first)() if type(first).Parameters is Plugin.Parameters else type(first)(first.parameters)
            )
            group = groups[entry.group.name]
            component.check(group)
            entries.append(ComponentEntry(group, entry.name, entry.use, [component], entry.timing))
        return Simulation(
            name=template.name,
            seed=self._seeds[0],
            environment=environment,
            environment_use=template.environment_use,
            groups=list(groups.values()),
            entries=entries,
            obstacles=built.document.environment.entities,
        )

    def _group(self, composition: Composition, template: AgentGroup) -> AgentGroup:
        """Return the group that holds the rows of all runs."""
        content = composition.data["agents"][template.name]
        states, knowledge = self._values(composition, template, content)
        group = AgentGroup(
            template.name,
            template.ids,
            template.model,
            template.entity,
            states,
            knowledge,
            tuple(template.awareness.parts.values()),
            template.awareness.signals,
            self._seeds,
        )
        group.regions, group.folder, group.sections = template.regions, template.folder, template.sections
        return group

    def _values(
        self, composition: Composition, template: AgentGroup, content: Mapping[str, Any]
    ) -> tuple[Array, Sequence[Mapping[str, Any]]]:
        """Return the initial state and the knowledge of each row."""
        count = len(self._seeds)
        if self._starts:
            own = [each[template.name] for each in self._starts]
            return np.concatenate([states for states, _ in own]), [dict(each) for _, known in own for each in known]
        if not contains([content.get("state"), content.get("knowledge")], RANDOM):
            return np.tile(template.initial_state, (count, 1)), [dict(each) for each in template.knowledge] * count
        sampler = Sampler(composition, self._seeds, template.ids, content.get("count") is not None, template.model)
        path = ("agents", template.name)
        states = sampler.states(content.get("state"), (*path, "state"))
        knowledge = sampler.known(content.get("knowledge") or {}, (*path, "knowledge"))
        if sampler.problems:
            raise ScenarioError(sampler.problems)
        return states, knowledge

    def _stated(self, composition: Composition) -> Sequence[Specification]:
        """Return the specifications, stated for the rows of all runs."""
        built, environment = self._built, self.simulation.environment
        diagnosis = Diagnosis(composition)
        check = TimingCheck(diagnosis, environment, built.document.regions, built.document.specifications)
        builder = SpecificationBuilder(check, environment, self.simulation.groups, self.simulation.entries)
        specifications = [replace(each, explains=False) for each in builder.build(built.document)]
        assert not diagnosis.problems, f"the scenario was found to be sound: {diagnosis.problems}"
        return specifications
