"""Components with alternatives, as candidates of an explanation.

Reasons: docs/decisions/0107-components-as-causes.md
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from symaware_cli.evidence.branch_changes import BranchError, overrides_of
from symaware_cli.evidence.causes.candidate import Candidate, ComponentAlternative
from symaware_cli.language import dotted
from symaware_cli.studies import Over, alternatives, varied


def component_alternatives(log: Path, over: Over) -> list[ComponentAlternative]:
    """List the alternatives of components that a request names, in its order.

    Args:
        log: The log.
        over: For each component or parameter, its alternatives: ``agents.GROUP.components.NAME.use=PLUGIN,...`` or
            ``agents.GROUP.components.NAME.with.PARAMETER=VALUE,...``; for one agent of a group, ``agents.GROUP[2]...``.

    Raises:
        BranchError: A path is not that of a component.
        ScenarioError: There is no such component, or the request cannot be read.
    """
    found: list[ComponentAlternative] = []
    for varying in varied(over):
        if "components" not in varying.path[2:4]:
            raise BranchError(
                f"--over {dotted(varying.path)}: expected a component, agents.GROUP.components.NAME.use, or a "
                "parameter of one, agents.GROUP.components.NAME.with.PARAMETER"
            )
        for change in alternatives(varying):
            (fault,) = overrides_of(log, 0.0, [change])
            content = fault.value.plain()
            del content["at"]
            ((_, parameters),) = content.items()
            found.append(ComponentAlternative(parameters["of"], str(change), content))
    return found


def possible_together(candidates: Sequence[Candidate]) -> list[list[Candidate]]:
    """Divide candidates into sets that can be corrected together: each has one alternative of each component.

    The first set has all other candidates.
    """
    sets: list[list[Candidate]] = [[]]
    taken: dict[str, int] = {}
    for each in candidates:
        number = 0
        if isinstance(each, ComponentAlternative):
            number = taken.get(each.of, 0)
            taken[each.of] = number + 1
        if number == len(sets):
            sets.append([])
        sets[number].append(each)
    return sets
