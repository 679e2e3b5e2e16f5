"""Functions about agents and their tasks, shared by the components of this package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from symaware_cli import Agent, AgentGroup, EntityGroup, Links
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


def check_known(tasks: Sequence[Task], groups: Sequence[AgentGroup]) -> None:
    """Check that each agent knows the names of its tasks, and of no others.

    Raises:
        ValueError: An agent lacks the name of a task of its own, or knows one that is not; the message names both.
    """
    known = {
        id: knowledge["tasks"]
        for group in groups
        for id, knowledge in zip(group.ids, group.knowledge, strict=True)
        if "tasks" in knowledge
    }
    own: dict[str, list[str]] = {id: [] for id in known}
    for task in tasks:
        for id in task.agents:
            own.setdefault(id, []).append(task.name)
    for id, names in own.items():
        if not isinstance(known.get(id), Sequence) or isinstance(known[id], str):
            raise ValueError(f"{id} must know its `tasks`, a list of names: {', '.join(names)}")
        for name in dict.fromkeys([*names, *known[id]]):
            if name not in known[id]:
                raise ValueError(f"{id} must know `{name}`, a task of its own, in its knowledge `tasks`")
            if name not in names:
                raise ValueError(f"{id} knows `{name}` in its `tasks`, which is no task of its own")


def tasks_of_agent(agent: Agent, order: Mapping[str, int]) -> list[Task]:
    """Return the tasks that an agent knows."""
    specifications = agent.group.specifications
    tasks = [
        task for name in agent.self_knowledge["tasks"] for task in tasks_in(specifications[name].specification, order)
    ]
    return [task for task in tasks if agent.id in task.agents]


def _reached_by(ids: Sequence[str], links: Links | None) -> Mapping[str, Sequence[str]]:
    """Return the agents that each agent reaches; all if it is not known."""
    if links is None:
        return dict.fromkeys(ids, ids)
    return {id: [ids[other] for other in links.of_sender(number)] for number, id in enumerate(ids)}
