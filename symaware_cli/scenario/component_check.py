"""Checks that a component can work for a group: its agents have the required knowledge, and `check` raises nothing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from symaware_cli.core import AgentGroup
from symaware_cli.core.component import BaseComponent
from symaware_cli.scenario.compose import Composition
from symaware_cli.scenario.parts import name_columns
from symaware_cli.scenario.plugin_factory import words
from symaware_cli.scenario.problem import Problem, dotted, nearest, quoted
from symaware_cli.scenario.source import Path
from symaware_cli.scenario.timing_check import expression_problem
from symaware_cli.specification.token import ExpressionError
from symaware_cli.world.plugin import ParameterError


class ComponentCheck:
    """Checks whether components can work, and reports problems at the sections that they are written in."""

    def __init__(
        self,
        composition: Composition,
        report: Callable[..., None],
        report_all: Callable[[Sequence[Problem]], None],
    ) -> None:
        """Prepare.

        Args:
            composition: The composed document.
            report: Takes the code and the message of a problem, the path, and hints.
            report_all: Takes problems.
        """
        self._composition = composition
        self._report = report
        self._report_all = report_all

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
        self, group: AgentGroup, component: BaseComponent[Any], path: Path, use: str, wrong: Collection[str] = ()
    ) -> bool:
        """Check that a component can work for a group, as far as that is known before the run.

        Args:
            group: The group.
            component: The component; it has the knowledge that it needs.
            path: The path of its section.
            use: Its entry-point name.
            wrong: The names of components of the group that are themselves wrong, which is reported there.
        """
        try:
            component.check(group)
            # If several components set a series, the columns of the last one apply.
            name_columns(group, component)
        except KeyboardInterrupt:
            raise
        except ParameterError as error:
            where = (*path, "with", *error.place)
            named = getattr(component.parameters, str(error.place[0]), None) if len(error.place) == 1 else None
            if error.is_consequence or (isinstance(named, str) and named in wrong):
                return False
            if isinstance(error.__cause__, ExpressionError):
                self._report_all([expression_problem(self._composition, str(error), where, error.__cause__)])
            else:
                self._report("unsuitable", f"{quoted(use)} cannot work here: {error}", where)
                for place, said in error.related:
                    self._report("unsuitable", f"{quoted(use)} cannot work here: {said}", (*path, "with", *place))
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
