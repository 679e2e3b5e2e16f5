"""Checks that what the labels of a strategy are about exists: agents, and values that agents believe."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from symaware_cli.core import AgentGroup, Environment
from symaware_cli.runtime.simulation import ComponentEntry
from symaware_cli.scenario.diagnosis import Diagnosis
from symaware_cli.scenario.problem import nearest, quoted


def check_label_agents(groups: Sequence[AgentGroup], entries: Sequence[ComponentEntry], diagnosis: Diagnosis) -> None:
    """Report each label that is about an agent that does not exist.

    Args:
        groups: All groups.
        entries: All component entries.
        diagnosis: Takes problems.
    """
    known = sorted(id for group in groups for id in group.ids)
    for entry in entries:
        # Components with strategies have `named_agents`; to import their class would slow down every run.
        named: Mapping[tuple[str, str], str] = getattr(entry.components[0], "named_agents", {})
        for (label, key), agent in named.items():
            if agent not in known:
                diagnosis.report(
                    "unknown-agent",
                    f"there is no agent {quoted(agent)}",
                    (*entry.section, "with", "labels", label, key),
                    expected=f"one of {', '.join(known)}",
                    suggestion=nearest(agent, known),
                )


def check_label_values(environment: Environment, entries: Sequence[ComponentEntry], diagnosis: Diagnosis) -> None:
    """Evaluate the conditions of labels once, and report those that have no value at the beginning.

    Args:
        environment: The environment, initialised.
        entries: All component entries.
        diagnosis: Takes problems.
    """
    for entry in entries:
        undefined: Callable[[AgentGroup, Environment], Iterator[tuple[str, str]]] | None
        undefined = getattr(entry.components[0], "undefined_labels", None)
        if undefined is None:
            continue
        for label, said in undefined(entry.group, environment):
            path = (*entry.section, "with", "labels", label)
            diagnosis.report("bad-expression", f"the label {quoted(label)} has no value: {said}", path)
