"""The barrier controller: rounds of messages from the leaves of the task graph to its root, and back."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import BaseModel, Field

from symaware_cli import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    CommunicationReceiver,
    KnowledgeDatabase,
    Level,
    Message,
    Parameters,
    Quantity,
    ScenarioView,
    Signal,
    nanoseconds,
)
from symaware_cli.formulas import Specification
from symaware_drones.barrier import Barrier, BarrierSample
from symaware_drones.program import Constraint, Inputs
from symaware_drones.schedule import Activation, Beginning, Schedule
from symaware_drones.task import Task
from symaware_drones.team import check_known, checked_tasks, order_of, tasks_in, tasks_of_agent

#: The kinds of messages: the fastest growth that a leader can bring about, and what a follower leaves to it.
BEST, EPSILON = "best", "epsilon"
#: Gradients below this, relative to the speed, do not matter.
_FLAT = 1e-9
#: The greatest speed at which a height is corrected [m/s].
_CLIMB = 0.5


class _Round:
    """A round: the data of a drone at its start, and its progress.

    Attributes:
        number: Its number, the same for all drones.
        own: The barrier of its own tasks; None where none is in force.
        edges: The barrier towards each neighbour, with the gradient with respect to its own position.
        apart: The constraints by which it keeps its distance from others.
        gamma: The share of the inputs that the tasks with its leaders leave to it; None before their messages.
        wanted: The same before it is limited to [0, 1].
        is_done: Whether the control input is chosen.
    """

    def __init__(
        self,
        number: int,
        own: BarrierSample | None,
        edges: Mapping[str, BarrierSample],
        apart: Sequence[Constraint],
    ) -> None:
        self.number = number
        self.apart = apart
        self.own = own
        self.edges = edges
        self.gamma: float | None = None
        self.wanted = 1.0
        self.is_done = False


class BarrierController(CommunicationReceiver):
    """Satisfies spatio-temporal tasks of drones and of pairs of drones by barrier functions, in a decentralised way.

    The tasks are specifications of the scenario (see `symaware_drones.tasks_of` for their form). Each drone knows the
    names of its own tasks, alone and with neighbours, as the knowledge `tasks`, and no others. It evaluates the
    barriers of its own tasks and of those with its neighbours in the task graph, which must be a forest;
    `drones.leaders` determines the leaders. Every sampling period is a round:

    1. A leader j sends best_j, the fastest growth of the barrier b that it can achieve: the maximum of
       grad_j b . u over gamma_j U. Drones without a leader have gamma = 1.
    2. A follower i has w = min over U of grad_i b . u, the worst that it can do. It may use the share
       gamma_ij = -(best_j + alpha(b) + db/dt - nu) / w of its inputs, and so uses gamma_i, the least of these, limited
       to [0, 1].
    3. It sends each leader epsilon = gamma_i w.
    4. Each drone chooses the smallest input in gamma U such that, as a leader, grad_j b . u >= -db/dt - alpha(b) -
       epsilon + nu, and for its own tasks the same without epsilon. If that is impossible, it violates them as little
       as possible, the former first, and fires `relaxed`.

    A message sent in one step of the world is read in the next, so a round takes several steps. The states are those of
    its start; the control input is held until the next one is known. A drone without messages of its neighbours by the
    end of a round uses their last ones, for at most `patience` rounds; then it neglects a leader that is silent
    (`unheard`), and stands still if the follower is silent (`unanswered`).

    With a `separation` each drone also keeps its distance from all others that it perceives, regardless of its tasks.
    For each other at the distance d in the direction -n, its input satisfies n . u >= -lambda (d - separation) / 2; if
    both do so, the distance never falls below the separation. As u = 0 satisfies all of this, tasks are relaxed where
    they contradict it.

    nu compensates for inputs being held: for single integrators nu = l1 V T, with l1 = eta V + lambda for own tasks and
    (2 eta V + lambda) 2 for tasks of pairs.
    """

    knowledge: ClassVar[Mapping[str, str]] = {"tasks": "the names of the tasks of the agent, alone or with others"}
    specifications = "tasks"
    specifications_of_others = True
    events: ClassVar[Mapping[str, str]] = {
        "margin": "The margin nu in force, and the one that the sampling period requires; fired once.",
        "relaxed": "No input satisfies a constraint, which is relaxed; fired when that begins.",
        "unheard": "No message arrived for too long from the leader of this drone, which neglects its tasks.",
        "unanswered": "No message arrived for too long from the follower of this drone, which stands still.",
        "heard-again": "Messages of a neighbour arrive again.",
    }

    class Parameters(Parameters):
        """The tasks, the barriers and the inputs."""

        tasks: list[str] = Field(min_length=1, description="The specifications that are tasks, of all drones.")
        sampling: float = Field(0.01, gt=0, description="T: the time between two rounds [s].")
        speed: float = Field(3.0, gt=0, description="V: radius of the regular polygon of inputs [m/s].")
        sides: int = Field(20, ge=4, le=100, multiple_of=2, description="The number of its sides.")
        gain: float = Field(5.0, gt=0, description="lambda: alpha(b) = lambda b, for b >= 0 [1/s].")
        gain_below: float | None = Field(None, ge=0, description="The same for b < 0; equal to `gain` if null [1/s].")
        eta: float = Field(20.0, gt=0, description="Sharpness of the smooth minimum over faces [1/m].")
        margin: float | Literal["full"] = Field(
            0.0, description="nu [m/s]; `full` for the one that the sampling period requires, which must be short."
        )
        activation: Activation = Field(
            "sequence",
            description="When barriers come into force: `sequence`, each as the last task before it on its edge ends; "
            "or `start`, all at the beginning.",
        )
        beginning: Beginning = Field(
            "latest", description="Beginning of tasks that may begin within an interval (`eventually`)."
        )
        clearance: float = Field(0.1, gt=0, description="The least value of a barrier at its activation [m].")
        shrinkage: float = Field(
            0.0,
            ge=0,
            description="Distance by which the faces of all polygons are moved inwards, for tracking errors [m].",
        )
        patience: int = Field(
            5, ge=1, description="Number of rounds without a message after which a neighbour counts as silent."
        )
        separation: float | None = Field(
            None,
            gt=0,
            description="The least distance to keep from the centres of all drones that are perceived [m], before all "
            "tasks: a barrier d - separation, each of the two provides half of its growth. None is kept if null.",
        )
        tracked: bool = Field(
            False,
            description="Whether velocities are not the control input but the knowledge `velocity`, which "
            "`control.quadrotor-velocity` tracks; the height stays as it is at the start.",
        )

    def __init__(self, parameters: BaseModel | None = None) -> None:
        super().__init__(parameters)
        columns = [Quantity(name, "m") for name in self.parameters.tasks]
        self.barriers = Signal(
            "barrier", "vector", columns, description="of each task in force", nan="the task is not in force"
        )
        self.signals = (self.barriers, ROUND)  # type: ignore[misc]

    @property
    def kinds(self) -> Collection[str]:
        """The kinds of its messages."""
        return (BEST, EPSILON)

    def check(self, group: AgentGroup) -> None:
        """Check that the model can follow velocities in the plane."""
        if not self.parameters.tracked:
            group.model.follow_velocity(group.initial_state, np.zeros((len(group), len(group.model.position))))

    def check_specification(self, specification: Specification, group: AgentGroup) -> None:
        """Check that a specification consists of tasks."""
        tasks_in(specification)

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that tasks can be met, alone and together, and that the task graph has links and no cycle."""
        groups = view.groups
        tasks = checked_tasks(view.named_specifications, order_of(groups), view.links)
        check_known(tasks, groups)
        positions = {
            id: (float(place[0]), float(place[1]))
            for group in groups
            for id, place in zip(group.ids, group.model.positions(group.initial_state), strict=True)
        }
        self._schedule(tasks, positions).check(self.parameters.speed)

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Prepare; barriers are made in the first round, when positions are known."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        parameters = self.parameters
        order = order_of(self.environment.groups)
        self._tasks = tasks_of_agent(agent, order)
        self._period = nanoseconds(parameters.sampling)
        self._inputs = Inputs(parameters.sides, parameters.speed)
        self._neighbours = [id for id in order if any({id, agent.id} == {*task.agents} for task in self._tasks)]
        self._barriers: dict[tuple[str, ...], Barrier] = {}
        self._parent: str | None = None
        self._children: list[str] = []
        #: The round and the value of the newest message of each neighbour and kind.
        self._heard: dict[tuple[str, str], tuple[int, float]] = {}
        self._silent: set[str] = set()
        self._relaxed: set[str] = set()
        self._round: _Round | None = None
        self._first = 0
        self._late = 0
        below = parameters.gain if parameters.gain_below is None else parameters.gain_below
        self._gains = parameters.gain, below

    @property
    def full_margins(self) -> tuple[float, float]:
        """The margins that the sampling period requires, for own tasks and for those of pairs [m/s]."""
        parameters, bend = self.parameters, self.parameters.eta * self.parameters.speed
        per_speed = parameters.speed * parameters.sampling
        return (bend + parameters.gain) * per_speed, (2.0 * bend + parameters.gain) * 2.0 * per_speed

    @property
    def margins(self) -> tuple[float, float]:
        """The margins in force, for own tasks and for those of pairs [m/s]."""
        margin = self.parameters.margin
        return self.full_margins if margin == "full" else (margin, margin)

    def _schedule(self, tasks: Sequence[Task], positions: Mapping[str, tuple[float, float]]) -> Schedule:
        parameters = self.parameters
        return Schedule(
            tasks,
            positions,
            activation=parameters.activation,
            beginning=parameters.beginning,
            clearance=parameters.clearance,
            shrinkage=parameters.shrinkage,
        )

    def _update(self, value: Sequence[Message]) -> None:
        for message in value:
            key, heard = (message.sender, message.kind), (message.payload["round"], message.payload["value"])
            if key not in self._heard or self._heard[key][0] < heard[0]:
                self._heard[key] = heard
        if self._round is not None and not self._round.is_done:
            self._advance(self._round, is_over=False)
        if self.now % self._period == 0:
            if self._round is not None and not self._round.is_done:
                self._advance(self._round, is_over=True)
            self._begin(self.now // self._period)

    def _begin(self, number: int) -> None:
        """Begin a round, once leaders are decided."""
        edges = self.agent.self_knowledge.get("edges")
        if edges is None:
            return
        where = self._positions()
        if not self._barriers:
            self._first = number
            self._prepare(edges, where)
        x, y = where[self.agent.id]
        now, own = self.now, None
        samples: dict[str, BarrierSample] = {}
        values: dict[str, float] = {}
        for agents, barrier in self._barriers.items():
            other = next((id for id in agents if id != self.agent.id), None)
            if other is None:
                own = barrier.sample(now, x, y)
                values.update(self._values(barrier, own, x, y))
                continue
            if other not in where:
                continue
            sign = 1.0 if agents[1] == self.agent.id else -1.0
            apart = sign * (x - where[other][0]), sign * (y - where[other][1])
            found = barrier.sample(now, *apart)
            if found is not None:
                samples[other] = found._replace(x=sign * found.x, y=sign * found.y)
                for name, each in self._values(barrier, found, *apart).items():
                    values[name] = min(each, values.get(name, math.inf))
        self._round = _Round(number, own, samples, self._apart(x, y))
        self.record(self.barriers, np.array([values.get(name, math.nan) for name in self.parameters.tasks]))
        self._advance(self._round, is_over=False)

    def _values(self, barrier: Barrier, sample: BarrierSample | None, x: float, y: float) -> Mapping[str, float]:
        """Return the barrier of each task in force, by the name of its specification [m]."""
        tasks = barrier.in_force(self.now)
        if sample is not None and len(tasks) == 1:
            return {tasks[0].task.name: sample.value}
        return barrier.values(self.now, x, y)

    def _prepare(self, edges: Mapping[str, str], where: Mapping[str, tuple[float, float]]) -> None:
        """Make the barriers of the tasks of decided edges."""
        self._parent = next((id for id, role in edges.items() if role == "leader"), None)
        self._children = [id for id, role in edges.items() if role == "follower"]
        known = {self.agent.id, *(id for id, role in edges.items() if role != "none")} & {*where}
        tasks = [task for task in self._tasks if known.issuperset(task.agents)]
        schedule = self._schedule(tasks, where)
        self._barriers = {agents: Barrier(each, self.parameters.eta) for agents, each in schedule.tasks.items()}
        own, pair = self.margins
        text = f"nu is {own:.3g} m/s for own tasks and {pair:.3g} m/s for those of pairs"
        full_own, full_pair = self.full_margins
        self.emit("margin", text, own=own, pair=pair, full_own=full_own, full_pair=full_pair)

    def _positions(self) -> dict[str, tuple[float, float]]:
        """Return the positions of the drone and of its neighbours, as far as it is aware of them [m]."""
        agent = self.agent
        own = agent.group.model.position
        state = agent.self_state
        found = {agent.id: (float(state[own[0]]), float(state[own[1]]))}
        database = agent.awareness_database
        for id in self._neighbours:
            if id in database:
                motion = database[id].state
                if not math.isnan(motion[0]):
                    found[id] = float(motion[0]), float(motion[1])
        return found

    def _apart(self, x: float, y: float) -> list[Constraint]:
        """Return the constraints that keep the distance from all others, at a position [m]."""
        separation, database = self.parameters.separation, self.agent.awareness_database
        if separation is None:
            return []
        gain, found = 0.5 * self.parameters.gain, []
        for id in database:
            if id == self.agent.id or id in self._neighbours:
                continue
            motion = database[id].state
            ahead, aside = x - float(motion[0]), y - float(motion[1])
            distance = math.hypot(ahead, aside)
            # Others beyond this cannot come too near within a round: the input cannot violate the constraint.
            if distance > 0.0 and gain * (distance - separation) < self.parameters.speed:
                bound = -gain * (distance - separation)
                found.append(Constraint(id, ahead / distance, aside / distance, min(bound, 0.0)))
        return found

    def _advance(self, current: _Round, *, is_over: bool) -> None:
        """Take the steps of a round that are possible; all of them if it is over."""
        if current.gamma is None:
            missing = [id for id in self._children if self._round_of(id, BEST) < current.number]
            if missing and not is_over:
                return
            self._late += bool(missing)
            self._follow(current)
        if self._parent is not None and self._round_of(self._parent, EPSILON) < current.number:
            if not is_over:
                return
            self._late += 1
        self._steer(current)
        current.is_done = True

    def _follow(self, current: _Round) -> None:
        """Determine the remaining share of the inputs, and send the leaders its effect on their tasks."""
        wanted, margin = math.inf, self.margins[1]
        worst: dict[str, float] = {}
        for id in self._children:
            best, sample = self._last(id, BEST, current.number, "unheard"), current.edges.get(id)
            if best is None or sample is None:
                continue
            worst[id] = -self._inputs.most(-sample.x, -sample.y)
            if worst[id] < -_FLAT * self.parameters.speed:
                share = -(best + self._alpha(sample.value) + sample.rate - margin) / worst[id]
                wanted = min(wanted, share)
        current.gamma = min(max(wanted, 0.0), 1.0)
        current.wanted = wanted if math.isfinite(wanted) else 1.0
        for id, each in worst.items():
            self._say(id, EPSILON, current.number, current.gamma * each)
        if self._parent is not None:
            sample = current.edges.get(self._parent)
            best = 0.0 if sample is None else current.gamma * self._inputs.most(sample.x, sample.y)
            self._say(self._parent, BEST, current.number, best)

    def _steer(self, current: _Round) -> None:
        """Choose the control input."""
        assert current.gamma is not None
        constraints = []
        own_margin, margin = self.margins
        stands = False
        left = math.nan
        if self._parent is not None:
            epsilon, sample = (
                self._last(self._parent, EPSILON, current.number, "unanswered"),
                current.edges.get(self._parent),
            )
            if epsilon is None:
                stands = True
            elif sample is not None:
                left = epsilon
                bound = -sample.rate - self._alpha(sample.value) - epsilon + margin
                constraints.append(Constraint(self._parent, sample.x, sample.y, bound))
        if current.own is not None:
            own = current.own
            constraints.append(Constraint("", own.x, own.y, -own.rate - self._alpha(own.value) + own_margin))
        gamma = current.gamma
        chosen, relaxed = ((0.0, 0.0), []) if stands else self._inputs.smallest(gamma, constraints, current.apart)
        names = {name for name, _ in relaxed}
        for name, missing in relaxed:
            if name not in self._relaxed:
                tasks = self._names_in_force(name)
                text = (
                    f"{', '.join(tasks)}: the barrier cannot grow as fast as it should, {missing:.3g} m/s are missing"
                )
                self.emit("relaxed", text, level=Level.WARNING, tasks=tasks, missing=missing)
        self._relaxed = names
        self._apply(chosen)
        missing = max((each for _, each in relaxed), default=0.0)
        self.record(ROUND, np.array([gamma, current.wanted, left, missing, self._late]))

    def _apply(self, velocity: tuple[float, float]) -> None:
        agent = self.agent
        if not self.parameters.tracked:
            model = agent.group.model
            wanted = np.zeros((1, len(model.position)))
            wanted[0, :2] = velocity
            agent.model.control_input = model.follow_velocity(agent.self_state[None], wanted)[0]
            return
        height = agent.group.model.position[2]
        missing = float(agent.group.initial_state[agent.row, height] - agent.self_state[height])
        climb = min(max(missing, -_CLIMB), _CLIMB)
        agent.self_knowledge["velocity"] = [velocity[0], velocity[1], climb]

    def _names_in_force(self, neighbour: str) -> list[str]:
        """Return the names of the tasks that are in force, of the drone itself or with a neighbour."""
        wanted = {self.agent.id, neighbour} if neighbour else {self.agent.id}
        barrier = next((each for agents, each in self._barriers.items() if {*agents} == wanted), None)
        return [] if barrier is None else [task.task.name for task in barrier.in_force(self.now)]

    def _alpha(self, value: float) -> float:
        gain: float = self._gains[0 if value >= 0.0 else 1]
        return gain * value

    def _say(self, receiver: str, kind: str, number: int, value: float) -> None:
        self.send(Message(self.agent.id, receiver, {"round": number, "value": value}, kind=kind))

    def _round_of(self, id: str, kind: str) -> int:
        return self._heard.get((id, kind), (-1, 0.0))[0]

    def _last(self, id: str, kind: str, number: int, event: str) -> float | None:
        """Return the newest value from a neighbour; None if it is silent."""
        of_round, value = self._heard.get((id, kind), (-1, math.nan))
        if of_round < 0:
            of_round = self._first - 1
        elif number - of_round <= self.parameters.patience:
            if id in self._silent:
                self._silent.discard(id)
                self.emit("heard-again", f"{id} is heard again", neighbour=id)
            return value
        if id not in self._silent and number - of_round > self.parameters.patience:
            self._silent.add(id)
            tasks = self._names_in_force(id)
            since = of_round * self.parameters.sampling
            text = f"{id} is not heard since {since:g} s; tasks with it: {', '.join(tasks) or 'none at present'}"
            self.emit(event, text, level=Level.WARNING, neighbour=id, since=since, tasks=tasks)
        return None


#: What became of a round.
ROUND = Signal(
    "round",
    "vector",
    [
        Quantity("gamma", "1"),
        Quantity("gamma_wanted", "1"),
        Quantity("epsilon", "m/s"),
        Quantity("missing", "m/s"),
        Quantity("late", "1"),
    ],
    description="of the last round",
    nan="the drone follows nobody, or was not answered",
)
