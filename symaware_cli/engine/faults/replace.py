"""Other components in place of some."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from symaware_cli import core
from symaware_cli.core import GroupComponent
from symaware_cli.core.identifiers import ComponentPattern
from symaware_cli.engine.faults.component_fault import ComponentFault
from symaware_cli.engine.runtime.fault import ComponentSelection, FaultContext, FaultTargets

if TYPE_CHECKING:
    # Validating a scenario does not import the modules that run it.
    from symaware_cli.engine.runtime.scheduler import TurnScheduler
    from symaware_cli.engine.runtime.simulation import ComponentEntry


class Replace(ComponentFault):
    """Another component that takes the turns of one; afterwards that one begins anew."""

    class Parameters(core.Parameters):
        """Another component in place of one; it has the same name and takes its turns at the same times."""

        use: str = Field(description="Entry-point name of the plugin, such as `perception.self`.")
        with_: dict[str, Any] = Field(default_factory=dict, alias="with", description="The plugin's own parameters.")
        of: ComponentPattern

    component_key: ClassVar = True
    adds_components: ClassVar = True

    #: For each selection, the entry of its substitutes, which are made before the run.
    substitutes: Sequence[ComponentEntry]

    @property
    def text(self) -> str:
        """Names both components."""
        return f"replaces {self.of} by {self.parameters.use}"

    @property
    def effect_before(self) -> str | None:
        """The substitutes are there."""
        return "another component is part of a run from its beginning, though it takes no turns"

    def resolve(self, context: FaultContext) -> None:
        """Create the substitutes, and check that they can work."""
        found = context.components(self.of, "of", substitutes=False)
        self.substitutes = [context.substitute(each) for each in found]
        self.components = found

    def begin(self, run: FaultTargets) -> Any:
        """Initialise the substitutes, which take all turns from now on."""
        return [
            stand_in(run, selected, substitute)
            for selected, substitute in zip(self.components, self.substitutes, strict=True)
        ]

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Let the other components take their turns again."""
        for each in begun:
            stand_down(each)


#: The scheduler of a substitute, those of the components in whose place it is, and the rows of the agents.
StandIn = tuple["TurnScheduler", Sequence["TurnScheduler"], Sequence[int]]


def stand_in(run: FaultTargets, selected: ComponentSelection, substitute: ComponentEntry) -> StandIn:
    """Initialise a substitute, which takes all turns for some agents from now on."""
    rows = selected.rows
    # The component that is replaced, and its substitutes at the moment.
    others = [
        each
        for each in run.schedulers
        if each.entry.group is substitute.group and each.entry.name == substitute.name
        if each.stands_in or not each.entry.is_substitute
    ]
    for other in others:
        for row in rows:
            other.put_out_of_use(row)
    own = run.scheduler(ComponentSelection(substitute, rows))
    own.stands_in = True
    for row in rows:
        own.put_into_use(row)
    if isinstance(substitute.components[0], GroupComponent):
        with own.supervision.supervised():
            own.restart(0)
    else:
        own.restart_agents(rows)
    return own, others, rows


def stand_down(begun: StandIn) -> None:
    """Let the other components take their turns again."""
    own, others, rows = begun
    own.stands_in = False
    for row in rows:
        own.put_out_of_use(row)
    for other in others:
        for row in rows:
            other.put_into_use(row)
        other.restart_agents(rows)
