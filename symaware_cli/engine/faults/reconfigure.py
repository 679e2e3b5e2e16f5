"""Components with other parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from symaware_cli import core
from symaware_cli.core import GroupComponent
from symaware_cli.core.component import BaseComponent
from symaware_cli.core.identifiers import ComponentPattern
from symaware_cli.engine.faults.component_fault import ComponentFault
from symaware_cli.engine.faults.replace import stand_down, stand_in
from symaware_cli.engine.runtime.fault import ComponentSelection, FaultContext, FaultTargets

if TYPE_CHECKING:
    # Validating a scenario does not import the modules that run it.
    from symaware_cli.engine.runtime.simulation import ComponentEntry


class Reconfigure(ComponentFault):
    """Components that begin anew with other parameters, and afterwards with their own again."""

    class Parameters(core.Parameters):
        """A component with other parameters."""

        of: ComponentPattern
        with_: dict[str, Any] = Field(
            min_length=1, alias="with", description="The parameters that change, in place of those under `with`."
        )

    adds_components: ClassVar = True

    #: For each selection, an instance of each of its components with the other parameters. The components themselves
    #: stay, since others refer to them, and take over the attributes of new instances. For some agents of a group
    #: component, another one that takes the turns for these.
    variants: Sequence[Sequence[BaseComponent[Any]] | ComponentEntry]

    @property
    def text(self) -> str:
        """Names the parameters and the components."""
        return f"changes {', '.join(self.parameters.with_)} of {self.of}"

    @property
    def effect_before(self) -> str | None:
        """Components for some agents of a group component are there."""
        if all(isinstance(each, Sequence) for each in self.variants):
            return None
        return "a component for some agents of a group is part of a run from its beginning, though it takes no turns"

    def resolve(self, context: FaultContext) -> None:
        """Create the components with the other parameters, and check that they can work."""
        self.components = context.components(self.of, "of", substitutes=False)
        self._check_present(context)
        self.variants = [self._variants(context, each) for each in self.components]

    def _check_present(self, context: FaultContext) -> None:
        """Check that no other fault puts another component in the place of one of these when this fault begins."""
        for name, other in context.others.items():
            if not isinstance(other, ComponentFault) or not other.component_key:
                continue
            if self.at is None or other.at is None or self.at < other.at:
                continue
            if other.lasting is not None and self.at >= other.at + other.lasting:
                continue
            for one in self.components:
                for replaced in other.components:
                    if one.entry is replaced.entry and not set(one.rows).isdisjoint(replaced.rows):
                        said = f"{context.quoted(self.of)} is replaced by the fault {context.quoted(name)}"
                        expected = f"another `{other.kind}`, or a time outside of it"
                        context.refuse(f"at {self.at / 1e9:g} s {said}", "of", code="unsuitable", expected=expected)

    def _variants(
        self, context: FaultContext, selected: ComponentSelection
    ) -> Sequence[BaseComponent[Any]] | ComponentEntry:
        entry, changed = selected.entry, self.parameters.with_
        group, present, name = entry.group, entry.components[0], context.quoted(entry.name)
        if entry.timing.in_process:
            context.refuse(f"{name} runs in a process of its own, where its parameters are fixed")
        if present.specifications is not None and present.specifications in changed:
            context.refuse(f"{context.quoted(present.specifications)} is fixed: it names specifications", "with")
        if isinstance(present, GroupComponent) and len(selected.rows) < len(entry.rows or group):
            return context.substitute(selected, changed, "with")
        made = context.variants(selected, changed, "with")
        if [*made[0].parts, *made[0].signals] != [*present.parts, *present.signals]:
            context.refuse(f"{context.quoted(entry.use)} would record other values with these parameters", "with")
        return made

    def begin(self, run: FaultTargets) -> Any:
        """Take over the attributes of the new instances, and initialise the components."""
        former: list[Any] = []
        for selected, variant in zip(self.components, self.variants, strict=True):
            if isinstance(variant, Sequence):
                former.append([each.parameters for each in _instances(selected)])
                self._restart(run, selected, [each.parameters for each in variant])
            else:
                former.append(stand_in(run, selected, variant))
        return former

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Initialise the components with their former parameters."""
        for selected, variant, former in zip(self.components, self.variants, begun, strict=True):
            if isinstance(variant, Sequence):
                self._restart(run, selected, former)
            else:
                stand_down(former)

    def _restart(self, run: FaultTargets, selected: ComponentSelection, parameters: Sequence[Any]) -> None:
        for component, changed in zip(_instances(selected), parameters, strict=True):
            identity = {key: getattr(component, key) for key in ("name", "use", "path", "period")}
            # A new instance each time: what a component changes in its attributes is not part of the scenario.
            vars(component).clear()
            vars(component).update({**vars(type(component)(changed)), **identity})
        run.restart(selected)


def _instances(selected: ComponentSelection) -> Sequence[BaseComponent[Any]]:
    """The components of a selection; a group component is one for all rows."""
    components = selected.entry.components
    return components if isinstance(components[0], GroupComponent) else [components[row] for row in selected.rows]
