"""What the components of this package know of the agents and of their tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from symaware_cli import AgentGroup, EntityGroup, Links
from symaware_cli.formulas import Specification
from symaware_drones.schedule import check_links, task_graph
from symaware_drones.task import Task, tasks_of


def order_of(groups: Sequence[EntityGroup]) -> dict[str, int]:
    """Return the index in the roster of each agent, in its order."""
    ids = [id for group in sorted(groups, key=lambda group: group.name) for id in group.ids]
    return {id: number for number, id in enumerate(ids)}


def tasks_in(specification: Specification, order: Mapping[str, int] | None = None) -> list[Task]:
    """Return the tasks of a specification; without an order of agents, only to see whether it consists of tasks.

    Raises:
        ValueError: It consists of something else.
    """
    if order is None:
        scope = specification.scope
        ids = [id for row in range(scope.rows) for id in scope.agents(row)]
        ids += [placed.region.around for placed in scope.regions.values() if placed.region.around is not None]
        order = dict.fromkeys(ids, 0)
    return list(tasks_of(specification, order))


def checked_tasks(
    specifications: Mapping[str, Specification], order: Mapping[str, int], links: Links | None
) -> list[Task]:
    """Return the tasks of all specifications.

    Raises:
        ValueError: Two drones of a task have no link, or the graph of tasks has a cycle.
    """
    tasks = [task for each in specifications.values() for task in tasks_in(each, order)]
    task_graph(tasks, order)
    check_links(tasks, _reached_by(list(order), links))
    return tasks


def tasks_of_run(group: AgentGroup, names: Sequence[str], order: Mapping[str, int]) -> list[Task]:
    """Return the tasks that the specifications of a run consist of."""
    return [task for name in names for task in tasks_in(group.specifications[name].specification, order)]


def _reached_by(ids: Sequence[str], links: Links | None) -> Mapping[str, Sequence[str]]:
    """Return the agents that each agent reaches; all if it is not known."""
    if links is None:
        return dict.fromkeys(ids, ids)
    return {id: [ids[other] for other in links.of_sender(number)] for number, id in enumerate(ids)}
