"""Builds the groups of a scenario: models, initial states, knowledge and components, and checks that these can work."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.assets import asset
from symaware_cli.core import AgentGroup, Entity, Model, Quantity, WorldError
from symaware_cli.core.component import BaseComponent
from symaware_cli.engine import ComponentEntry, faults_of
from symaware_cli.language.assets import asset_folders
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.free_places import FREE, FreeRoom, GroupPlaces, Places, Unplaced
from symaware_cli.language.own_parameters import OwnParameters, entries_of
from symaware_cli.language.parts import declared_parts, declared_signals, name_columns
from symaware_cli.language.plugin_factory import PluginFactory, mapping, words
from symaware_cli.language.problem import dotted, nearest, quoted
from symaware_cli.language.sampling import Sampler, contains
from symaware_cli.language.scenario_section import InitialAgents
from symaware_cli.language.source import Path
from symaware_cli.world import ParameterError

Array = NDArray[np.float64]


class ComponentCheck:
    """Checks whether components can work, and reports problems at the sections that they are written in."""

    def __init__(self, diagnosis: Diagnosis) -> None:
        self._diagnosis = diagnosis
        self._report = diagnosis.report

    def knows(self, component: BaseComponent[Any], known: object, path: Path, group: str, use: str) -> bool:
        """Check that the agents have all the knowledge that a component needs.

        Args:
            component: The component.
            known: The section of the group's knowledge.
            path: The path of the component's section.
            group: The name of the group.
            use: Its entry-point name.
        """
        if not isinstance(known, Mapping):
            return False
        owner: Path = ("agents", group, "knowledge")
        for name, meaning in component.knowledge.items():
            if name in known:
                continue
            meant = nearest(name, known)
            self._report(
                "missing-knowledge",
                f"{quoted(use)} needs the knowledge {quoted(name)}" + (f", not {quoted(meant)}" if meant else ""),
                (*owner, meant) if meant else path,
                key=True,
                expected=f"{quoted(name)} under {quoted(dotted(owner))}: {meaning}",
            )
        return set(component.knowledge) <= set(known)

    def can_work(
        self,
        group: AgentGroup,
        component: BaseComponent[Any],
        path: Path,
        use: str,
        wrong: Collection[str] = (),
        parameters: Path | None = None,
    ) -> bool:
        """Check that a component can work for a group, as far as that is known before the run.

        Args:
            group: The group.
            component: The component; it has the knowledge that it needs.
            path: The path of its section.
            use: Its entry-point name.
            wrong: The names of components of the group that are themselves invalid, which is reported there.
            parameters: The path of its parameters; by default ``with`` in its section.
        """
        parameters = parameters or (*path, "with")
        try:
            component.check(group)
            # If several components set a series, the columns of the last one apply.
            name_columns(group, component)
        except KeyboardInterrupt:
            raise
        except ParameterError as error:
            where = (*parameters, *error.place)
            named = getattr(component.parameters, str(error.place[0]), None) if len(error.place) == 1 else None
            if error.is_consequence or (isinstance(named, str) and named in wrong):
                return False
            from symaware_cli.specification import ExpressionError

            if isinstance(error.__cause__, ExpressionError):
                self._diagnosis.report_expression(str(error), where, error.__cause__)
            else:
                self._report("unsuitable", f"{quoted(use)} cannot work here: {error}", where)
                for place, said in error.related:
                    self._report("unsuitable", f"{quoted(use)} cannot work here: {said}", (*parameters, *place))
            return False
        except BaseException as error:
            said = words(error)
            for name in component.knowledge:
                where = ("agents", group.name, "knowledge", name)
                if not _is_numeric(group, name):
                    said = f"the knowledge {quoted(name)} is not made of numbers, as many for each agent"
                if f"`{name}`" in said:
                    self._report(
                        "unsuitable",
                        f"{quoted(use)} cannot work with this: {said}",
                        where,
                        expected=component.knowledge[name],
                    )
                    return False
            self._report("unsuitable", f"{quoted(use)} cannot work here: {said}", path, key=True)
            return False
        return True


def _is_numeric(group: AgentGroup, name: str) -> bool:
    try:
        return group.known(name).dtype == float
    except (TypeError, ValueError):
        return False


class GroupBuilder:
    """Builds the groups of a scenario, and reports problems with them.

    Attributes:
        uses: For each group, the entry-point names of its ``model`` and ``components``.
        declared: The names of the parts of awareness and signals that components declare.
        sections: The objects built from the sections of plugins, by key.
        space: The space in which agents are placed; None if none is.
    """

    def __init__(
        self, diagnosis: Diagnosis, factory: PluginFactory, document: ScenarioDocument | None, folder: FilePath
    ) -> None:
        """Prepare.

        Args:
            diagnosis: Takes problems; no groups are created if there are earlier ones.
            factory: Creates models and components.
            document: The validated document; None if it is invalid.
            folder: The folder of the scenario.
        """
        self._diagnosis = diagnosis
        self._report = diagnosis.report
        self._factory = factory
        self._document = document
        self._folder = folder
        self._check = ComponentCheck(diagnosis)
        self._own = OwnParameters(diagnosis, factory)
        self.uses: dict[str, dict[str, Any]] = {}
        self.declared: set[str] = set()
        self.sections: Mapping[str, Any] = {}
        self.space: FreeRoom | None = None

    def build(self, name: str, entry: Mapping[str, Any]) -> tuple[AgentGroup | None, list[ComponentEntry]]:
        """Build a group and its component entries; None and no entries after a problem."""
        path: Path = ("agents", name)
        model = self._model(mapping(entry.get("model")), (*path, "model"))
        if model is not None and not self._fits(model, name):
            model = None
        ids, initial = self._initial(name, entry, model, 0.0)
        components = mapping(entry.get("components"))
        uses = {component: str(mapping(content).get("use")) for component, content in components.items()}
        uses_model = mapping(entry.get("model")).get("use")
        self.uses[name] = {"model": uses_model, "components": uses}
        instances = {
            component: self._factory.make(mapping(content), (*path, "components", component), len(ids))
            for component, content in components.items()
        }
        sections = {each: (*path, "components", each) for each in components}
        variations = {
            each: self._own.variations(mapping(components[each]), sections[each], made[0], len(ids))
            for each, made in instances.items()
            if made
        }
        # Even if a component's parameters are invalid, its class declares what it writes.
        kinds = [self._factory.plugins.get(section) for section in sections.values()]
        written = {key: value for kind in kinds if kind for key, value in getattr(kind, "writes", {}).items()}
        known = entry.get("knowledge", {})
        if isinstance(known, Mapping):
            known = {**written, **known}
        capable = [
            component
            for component, made in instances.items()
            if made and self._check.knows(made[0], known, (*path, "components", component), name, uses[component])
        ]
        declaring = [(instances[each][0], uses[each], (*path, "components", each)) for each in capable]
        parts, signals = declared_parts(declaring, self._diagnosis), declared_signals(declaring, self._diagnosis)
        self.declared.update(each.name for each in (*parts, *signals.values()))
        if model is None or initial is None or self._diagnosis.earlier:
            return None, []
        states, stated = initial
        knowledge = [{**one, **{key: written[key] for key in written if key not in one}} for one in stated]
        body = self._document.agents[name].entity if self._document else Entity()
        if not self._conforms(model, str(uses_model), states[0], (*path, "model", "use")):
            return None, []
        group = AgentGroup(name, ids, model, body, states, knowledge, parts, signals)
        group.regions, group.folder = self._document.regions if self._document else {}, self._folder
        group.sections = self.sections
        wrong = instances.keys() - capable
        component_entries: list[ComponentEntry] = []
        for component in capable:
            where, use, own = (*path, "components", component), uses[component], variations[component]
            first = instances[component][0]
            if own is None or not self._check.can_work(group, first, where, use, wrong):
                continue
            if all(
                self._own.records_alike(each, first, group)
                and self._check.can_work(group, each.component, where, use, wrong, each.path)
                for each in own
            ):
                component_entries += entries_of(group, component, use, instances[component], own)
        return group, component_entries

    def initial_agents(self, agents: Mapping[str, Any]) -> list[InitialAgents]:
        """Return the agents of each group at the beginning, without building the groups.

        Args:
            agents: The section of all groups, as plain data.

        Returns:
            Coordinates of agents that are placed in free space are NaN.
        """
        found: list[InitialAgents] = []
        for name, entry in sorted(agents.items()):
            ids, initial = self._initial(name, mapping(entry), None, np.nan)
            kind = self._factory.plugins.get(("agents", name, "model"))
            if initial is not None and kind is not None and self._document is not None:
                found.append(_SampledAgents(ids, self._document.agents[name].entity.radius, kind, *initial))
        return found

    def _initial(
        self, name: str, entry: Mapping[str, Any], model: Model | None, unknown: float
    ) -> tuple[list[str], tuple[Array, Sequence[Mapping[str, Any]]] | None]:
        """Return the ids of the agents, and their initial states and knowledge; None after a problem with these.

        Args:
            name: The name of the group.
            entry: The group, as plain data.
            model: The model; None if there is only its class.
            unknown: The value of the coordinates of agents that are not placed yet.
        """
        path: Path = ("agents", name)
        count = entry.get("count")
        sound = isinstance(count, int) and not isinstance(count, bool) and 1 <= count <= 100_000
        indexed = count is not None
        ids = [f"{name}.{row}" for row in range(count)] if sound and count else [name]
        if indexed and not sound:
            return ids, None
        # Even if the model's parameters are invalid, its class declares the columns of the state.
        kind = self._factory.plugins.get((*path, "model"))
        described = model or (kind if kind is not None and _fault_of(kind) is None else None)
        places: Places | None = Unplaced(unknown) if is_placed(entry) else None
        if self.space is not None and self._document is not None:
            places = GroupPlaces(self.space, ids, self._document.agents[name].entity.radius)
        seed = self._document.seed if self._document else 0
        sampler = Sampler(self._diagnosis.composition, seed, ids, indexed, described, places)
        states = sampler.states(entry.get("state"), (*path, "state"))
        knowledge = sampler.known(mapping(entry.get("knowledge")), (*path, "knowledge"))
        self._diagnosis.problems += sampler.problems
        return ids, None if sampler.problems else (states, knowledge)

    def _model(self, entry: Mapping[str, Any], path: Path) -> Model | None:
        made = self._factory.make(entry, path)
        if not made:
            return None
        model: Model = made[0]
        fault = _fault_of(model)
        if fault:
            self._report("broken-plugin", f"the model {quoted(entry['use'])} {fault}", (*path, "use"))
            return None
        return model

    def _fits(self, model: Model, name: str) -> bool:
        """Pass the body of its agents to a model, and report a body that does not suit."""
        if self._document is None:
            return True
        entity, folders = self._document.agents[name].entity, asset_folders(self._document, self._folder)
        try:
            if entity.shape and entity.shape.robot:
                asset.check(entity.shape.robot.file, folders, missing=entity.shape.robot.missing)
        except WorldError:
            return False  # `check_assets` reports the file, whatever the model is
        try:
            model.fit(entity, folders, "agents", name)
        except WorldError as error:
            self._report("unsuitable", str(error), error.path)
            return False
        return True

    def _conforms(self, model: Model, use: str, state: Array, path: Path) -> bool:
        """Check that a model returns arrays of the declared shapes; done once, as checks in a run would cost time."""
        faults = list(faults_of(model, state))
        for fault in faults:
            self._report("broken-plugin", f"the model {quoted(use)} {fault}", path)
        return not faults


class _SampledAgents(InitialAgents):
    """The agents of a group with sampled states and knowledge."""

    def __init__(
        self,
        ids: Sequence[str],
        radius: float,
        model: type[Model],
        states: Array,
        knowledge: Sequence[Mapping[str, Any]],
    ) -> None:
        self.ids, self.radius = ids, radius
        self._places, self._knowledge = states[:, list(model.position)], knowledge

    @property
    def positions(self) -> Array:
        return self._places

    def known(self, name: str) -> Sequence[Any]:
        return [each.get(name) for each in self._knowledge]


def is_placed(entry: Mapping[str, Any]) -> bool:
    """Return whether a group, as plain data, has agents or goals in free space."""
    return contains([entry.get("state"), entry.get("knowledge")], (FREE,))


def _fault_of(model: Model | type[Model]) -> str | None:
    """Return the fault in a model's declarations as a predicate; None if they are valid."""
    for name in ("state", "control_input"):
        declared = getattr(model, name, ())
        if not isinstance(declared, Sequence) or not declared or not all(isinstance(x, Quantity) for x in declared):
            return f"declares no `{name}` as quantities"
    indices = [*model.position, *(() if model.heading is None else (model.heading,))]
    if not all(0 <= index < len(model.state) for index in indices):
        return "places its position or heading outside its state"
    if not all(0 <= index < len(model.state) for index in (*model.velocities, *model.angles)):
        return "places its velocities or angles outside its state"
    if len(model.velocities) not in (0, len(model.position)):
        return f"has {len(model.velocities)} velocities for {len(model.position)} coordinates of its position"
    return None
