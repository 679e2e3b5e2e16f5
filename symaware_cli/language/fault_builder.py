"""Builds the faults of a scenario: creates an instance of the class of each kind, which checks itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from symaware_cli.core import AgentGroup, Environment, nanoseconds
from symaware_cli.engine import ComponentEntry, Fault, Trigger
from symaware_cli.language.diagnosis import ReportedError
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.fault_context import ScenarioContext
from symaware_cli.language.fault_section import FaultUse
from symaware_cli.language.plugin_factory import PluginFactory, words
from symaware_cli.language.problem import quoted
from symaware_cli.language.source import Path
from symaware_cli.language.substitute_builder import SubstituteBuilder
from symaware_cli.language.target_finder import TargetFinder
from symaware_cli.language.timing_check import TimingCheck, trigger_of
from symaware_cli.world import ParameterError


class FaultBuilder:
    """Builds the faults of a scenario and reports problems with them.

    Attributes:
        declared: An instance of each fault in the order of the document, whether it fits the scenario or not; None for
            one that cannot be made.
    """

    def __init__(
        self,
        check: TimingCheck,
        environment: Environment,
        groups: Sequence[AgentGroup],
        entries: list[ComponentEntry],
        document: ScenarioDocument,
        factory: PluginFactory,
    ) -> None:
        """Create the instances.

        Args:
            check: Checks times and events, and takes problems.
            environment: The environment, not initialised yet.
            groups: All groups.
            entries: All component entries, with their timing; `build` adds substitutes.
            document: The validated document.
            factory: Creates components.
        """
        self._diagnosis = check.diagnosis
        self._report = check.diagnosis.report
        self._check = check
        self._environment = environment
        self._groups = groups
        self._entries = entries
        self._uses = document.faults
        self._factory = factory
        self._targets = TargetFinder(check.diagnosis, groups, entries)
        self._substitutes = SubstituteBuilder(factory, check, document)
        self.declared: Mapping[str, Fault | None] = {
            name: self._instance(name, use) for name, use in self._uses.items()
        }

    def build(self) -> Sequence[Fault]:
        """Return the faults that fit the scenario, in the order of the document; problems of others are reported."""
        # Other faults act on substitutes as well, wherever they are in the file.
        made = [fault for fault in self.declared.values() if fault is not None]
        sound = {id(fault) for fault in sorted(made, key=lambda fault: not fault.adds_components) if self._fits(fault)}
        return [fault for fault in made if id(fault) in sound]

    def _instance(self, name: str, use: FaultUse) -> Fault | None:
        """Create the instance of a fault; None after a problem."""
        if use.plugin is None:
            return None
        fault: Fault | None = self._factory.instance(use.plugin, use.kind, use.content, ("faults", name, use.kind))
        if fault is not None:
            fault.kind, fault.name = use.kind, name
            fault.at = None if use.at is None else nanoseconds(use.at)
            fault.lasting = None if use.for_ is None else nanoseconds(use.for_)
        return fault

    def _fits(self, fault: Fault) -> bool:
        """Let a fault check itself, with the event on which it begins; report why it does not fit."""
        section: Path = ("faults", fault.name)
        on = self._uses[fault.name].on
        if on is not None:
            fault.on = trigger_of(on.event, on.of or "*")
            if not self._is_known(fault.on, section):
                return False
        others = {name: other for name, other in self.declared.items() if name != fault.name}
        path = (*section, fault.kind)
        context = ScenarioContext(
            *(path, others, self._diagnosis, self._environment, self._groups),
            *(self._targets, self._factory, self._substitutes),
        )
        try:
            fault.resolve(context)
            # Those of plugins are called here for the first time, where a mistake can be reported.
            _ = (fault.source, fault.text, fault.effect_before)
        except ReportedError:
            return False
        except KeyboardInterrupt:
            raise
        except ParameterError as error:
            self._report("unsuitable", f"{quoted(fault.kind)} cannot work here: {error}", (*path, *error.place))
            return False
        except BaseException as error:
            self._report("unsuitable", f"{quoted(fault.kind)} cannot work here: {words(error)}", path, key=True)
            return False
        for before, substitute in context.added:
            self._entries.insert(self._entries.index(before) + 1, substitute)
        return True

    def _is_known(self, trigger: Trigger, section: Path) -> bool:
        """Check the event on which a fault begins; the fault can be checked even if nothing fires the event."""
        if trigger.component is not None:
            # A fault belongs to no agent whose component this could be.
            message = f"{quoted(trigger.component)} does not name the agent of the component"
            expected = "`environment`, or the path of a component such as `agents.robot.*.steer`"
            self._report("unknown-source", message, (*section, "on", "of"), expected=expected)
            return False
        self._check.source(trigger, None, self._entries, (*section, "on"))
        return True
