"""Changes of a scenario while its run goes on: other components or parameters, states and knowledge that are set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from symaware_cli.core import GroupComponent
from symaware_cli.core.component import BaseComponent
from symaware_cli.runtime.faults import AgentSelection, Array, ComponentSelection, Effect, Targets
from symaware_cli.runtime.simulation import ComponentEntry

if TYPE_CHECKING:
    # Validating a scenario does not import the modules that run it.
    from symaware_cli.runtime.scheduler import TurnScheduler


@dataclass(frozen=True)
class Reconfigure(Effect):
    """Components begin anew with other parameters; when that ends, with their own again.

    Attributes:
        components: The components.
        substitutes: For each selection, a new instance of each of its components, which takes over its attributes: the
            components themselves stay, since others refer to them.
    """

    components: Sequence[ComponentSelection]
    substitutes: Sequence[Sequence[BaseComponent[Any]]]

    def begin(self, targets: Targets, name: str) -> Any:
        """Take over the attributes of the new instances, and initialise the components."""
        begun = []
        for selected, instances in zip(self.components, self.substitutes, strict=True):
            begun.append((selected, [each.parameters for each in _instances(selected)]))
            self._restart(targets, selected, instances)
        return begun

    def end(self, targets: Targets, begun: Any) -> None:
        """Initialise the components with their former parameters."""
        for selected, parameters in begun:
            present = _instances(selected)
            self._restart(
                targets, selected, [type(each)(former) for each, former in zip(present, parameters, strict=True)]
            )

    def _restart(self, targets: Targets, selected: ComponentSelection, instances: Sequence[BaseComponent[Any]]) -> None:
        for component, instance in zip(_instances(selected), instances, strict=True):
            identity = {key: getattr(component, key) for key in ("name", "use", "path")}
            vars(component).clear()
            vars(component).update({**vars(instance), **identity})
        targets.scheduler(selected).restart_agents(selected.rows)


def _instances(selected: ComponentSelection) -> Sequence[BaseComponent[Any]]:
    """The components of a selection; a group component is one for all rows."""
    components = selected.entry.components
    return components if isinstance(components[0], GroupComponent) else [components[row] for row in selected.rows]


@dataclass(frozen=True)
class Replace(Effect):
    """Other components take the turns of some components; when that ends, these begin anew.

    Attributes:
        components: The components, each with the entry of its substitutes, which are made before the run.
    """

    components: Sequence[tuple[ComponentSelection, ComponentEntry]]

    def begin(self, targets: Targets, name: str) -> Any:
        """Initialise the substitutes, which take all turns from now on."""
        begun = []
        for (_, rows), substitute in self.components:
            others = self._others(targets, substitute)
            for other in others:
                for row in rows:
                    other.put_out_of_use(row)
            own = targets.scheduler(ComponentSelection(substitute, rows))
            own.stands_in = True
            begun.append((own, others, rows))
            for row in rows:
                own.put_into_use(row)
            if isinstance(substitute.components[0], GroupComponent):
                with own.supervision.supervised():
                    own.restart(0)
            else:
                own.restart_agents(rows)
        return begun

    def end(self, targets: Targets, begun: Any) -> None:
        """Let the other components take their turns again."""
        for own, others, rows in begun:
            own.stands_in = False
            for row in rows:
                own.put_out_of_use(row)
            for other in others:
                for row in rows:
                    other.put_into_use(row)
                other.restart_agents(rows)

    def _others(self, targets: Targets, substitute: ComponentEntry) -> Sequence[TurnScheduler]:
        """The schedulers of the component that is replaced, and of its substitutes at the moment."""
        return [
            each
            for each in targets.schedulers
            if each.entry.group is substitute.group and each.entry.name == substitute.name
            if each.stands_in or not each.entry.is_substitute
        ]


@dataclass(frozen=True)
class SetState(Effect):
    """The true state of agents is set.

    Attributes:
        agents: The agents.
        state: Their new state; shape (nx,).
    """

    agents: Sequence[AgentSelection]
    state: Array

    def begin(self, targets: Targets, name: str) -> Any:
        """Change each state by what it differs."""
        environment = targets.simulation.environment
        for group, rows in self.agents:
            for row in rows:
                targets.stepper.push(group, [row], self.state - environment.state(group)[row])


@dataclass(frozen=True)
class Inform(Effect):
    """Knowledge of agents about themselves is replaced.

    Attributes:
        agents: The agents.
        knowledge: For each selection, the new values of each of its rows, by name.
    """

    agents: Sequence[AgentSelection]
    knowledge: Sequence[Sequence[Mapping[str, Any]]]

    def begin(self, targets: Targets, name: str) -> Any:
        """Replace the values."""
        for (group, rows), known in zip(self.agents, self.knowledge, strict=True):
            for row, values in zip(rows, known, strict=True):
                group.knowledge[row].update(values)
