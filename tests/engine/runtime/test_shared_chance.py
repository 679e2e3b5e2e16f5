"""Two variants of a scenario share their chance as far as they share their agents."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from faulting import fault
from simulating import STEP, Team, execute, simulation

from symaware_cli import AgentSelection, Component, ComponentSelection, Fault, GroupComponent
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.engine.faults.blind import Blind
from symaware_cli.engine.faults.measurement_fault import Noise
from symaware_cli.engine.faults.slow import Slow
from symaware_cli.engine.faults.stop import Stop
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.engine.runtime.timing import Timing, Trigger
from symaware_cli.language.build import build
from symaware_cli.world import ProbabilityDistribution
from symaware_cli.world.chance import Turn
from symaware_cli.world.probability_distribution import always

Teams = dict[str, Team]

MILLISECOND = 1_000_000
STEPS = 12
NOISY = SingleIntegrator(SingleIntegrator.Parameters(process_noise=0.05))


@dataclass
class Notes:
    """What was drawn: for each agent and instant its motion, and what it measured of itself and of others."""

    truth: dict[tuple[str, int], list[float]] = field(default_factory=dict)
    own: dict[tuple[str, int], list[float]] = field(default_factory=dict)
    others: dict[tuple[str, str, int], list[float]] = field(default_factory=dict)
    own_draws: dict[tuple[str, int], list[tuple[float, float]]] = field(default_factory=lambda: defaultdict(list))


class Probe(GroupComponent):
    """Takes note of what the component before it has measured."""

    def __init__(self, notes: Notes) -> None:
        super().__init__()
        self.notes = notes

    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        group, world = self._group, self.environment
        truth, observation = world.state(group), group.awareness.observation
        for row, id in enumerate(group.ids):
            self.notes.truth[id, self.now] = truth[row].tolist()
            self.notes.own[id, self.now] = group.awareness.state[row].tolist()
        if observation is None:
            return  # the sensor has not begun
        tracks = observation.tracks
        for place, observer in enumerate(tracks.observers.tolist()):
            pair = group.ids[observer], world.roster.ids[tracks.others[place]]
            self.notes.others[*pair, self.now] = [*tracks.positions[place].tolist(), *tracks.velocities[place].tolist()]


class Drawing(Component):
    """An author's component, which draws as it likes."""

    def __init__(self, notes: Notes, many: int = 1) -> None:
        super().__init__()
        self.notes = notes
        self.many = many

    def initialise_component(self, *arguments: Any) -> None:
        super().initialise_component(*arguments)
        self._bias = self.random.uniform()

    def _compute(self) -> Any:
        return self.random.standard_normal(self.many)[0] + self._bias

    def _update(self, value: Any) -> None:
        self.notes.own_draws[self.agent.id, self.now].append((value, self.random.random()))


def sensor(**changed: float) -> Callable[[], RangePerception]:
    parameters = {"range": 100.0, "position_noise": 0.1, "velocity_noise": 0.2, "self_noise": 0.3, "dropout": 0.3}
    return lambda: RangePerception(RangePerception.Parameters(**{**parameters, **changed}))


def team(
    notes: Notes,
    count: int = 4,
    y: float = 0.0,
    many: int = 1,
    timings: Mapping[str, Timing] | None = None,
    before: Mapping[str, Callable[[], Component | GroupComponent]] | None = None,
    sense: Callable[[], RangePerception] | None = None,
) -> Team:
    components = {
        **(before or {}),
        "sense": sense or sensor(),
        "probe": lambda: Probe(notes),
        "draw": lambda: Drawing(notes, many),
    }
    state = [[2.0 * row, y] for row in range(count)]
    return Team(components, count=count, state=state, model=NOISY, timings=timings or {})


def run(
    change: Callable[[Teams, Notes], Teams] = lambda teams, notes: teams,
    steps: int = STEPS,
    options: RunOptions | None = None,
    faults: Callable[[Simulation], Sequence[Fault]] = lambda ready: (),
    seed: int = 7,
) -> Notes:
    """Run four robots and three cars, or a variant of that, and return what was drawn."""
    notes = Notes()
    ready = simulation(change({"robot": team(notes), "car": team(notes, 3, 5.0)}, notes), seed=seed)
    summary = execute(ready, steps, options=replace(options or RunOptions(), faults=tuple(faults(ready))))
    assert summary.status == "finished", summary.failure
    return notes


@pytest.fixture(scope="module")
def base() -> Notes:
    return run()


def assert_shared(one: Notes, other: Notes, among: Sequence[str]) -> int:
    """What those have drawn who are in both is the same, where they took a turn at the same instant."""
    compared = 0
    for kind in ("truth", "own", "others", "own_draws"):
        for key in getattr(one, kind).keys() & getattr(other, kind).keys():
            if all(id in among for id in key[:-1]):
                assert getattr(one, kind)[key] == getattr(other, kind)[key], (kind, key)
                compared += 1
    return compared


ROBOTS, CARS = [f"robot.{row}" for row in range(4)], [f"car.{row}" for row in range(3)]


def with_more(teams: Teams, notes: Notes) -> Teams:
    return {**teams, "robot": team(notes, 5), "van": team(notes, 6, -3.0), "a": team(notes, 2, 9.0)}


def with_fewer(teams: Teams, notes: Notes) -> Teams:
    return {**teams, "robot": team(notes, 3)}


def without_cars(teams: Teams, notes: Notes) -> Teams:
    return {"robot": teams["robot"]}


def reordered(teams: Teams, notes: Notes) -> Teams:
    return dict(reversed(teams.items()))


def with_another_component(teams: Teams, notes: Notes) -> Teams:
    class Another(Drawing):
        def _update(self, value: Any) -> None:
            self.random.random(5)

    return {**teams, "robot": team(notes, before={"another": lambda: Another(notes, 9), "more": sensor(dropout=0.9)})}


def short_sighted_cars(teams: Teams, notes: Notes) -> Teams:
    return {**teams, "car": team(notes, 3, 5.0, sense=sensor(range=4.0, dropout=0.0))}


def cars_far_away(teams: Teams, notes: Notes) -> Teams:
    return {**teams, "car": team(notes, 3, 500.0)}


def cars_at_other_times(teams: Teams, notes: Notes) -> Teams:
    timing = Timing(period=3 * STEP, offset=STEP)
    return {**teams, "car": team(notes, 3, 5.0, timings={"sense": timing, "draw": timing})}


def cars_that_draw_more(teams: Teams, notes: Notes) -> Teams:
    return {**teams, "car": team(notes, 3, 5.0, many=17)}


@pytest.mark.parametrize(
    ("change", "among"),
    [
        (with_more, ROBOTS + CARS),
        (with_fewer, ROBOTS[:3] + CARS),
        (without_cars, ROBOTS),
        (reordered, ROBOTS + CARS),
        (with_another_component, CARS),
        (short_sighted_cars, ROBOTS),
        (cars_far_away, ROBOTS),
        (cars_at_other_times, ROBOTS),
        (cars_that_draw_more, ROBOTS),
    ],
)
def test_nobody_elses_draws_change(base: Notes, change: Callable[[Teams, Notes], Teams], among: list[str]) -> None:
    # Of each agent its motion and what it measures of itself, in each turn; of each pair about seven of ten.
    own, pairs = len(among) * STEPS, len(among) * (len(among) - 1) * STEPS
    assert assert_shared(base, run(change), among) > 3 * own + 0.4 * pairs


def test_a_component_that_is_put_before_another_leaves_what_that_one_draws(base: Notes) -> None:
    another = run(with_another_component)
    # The sensor that came before gave it another state in between, and nothing else.
    assert another.own == base.own
    assert another.others == base.others
    assert another.own_draws == base.own_draws


def test_another_seed_draws_otherwise(base: Notes) -> None:
    other = run(seed=8)
    for kind in ("own", "others", "own_draws"):
        one, two = getattr(base, kind), getattr(other, kind)
        assert not any(one[key] == two[key] for key in one.keys() & two.keys())


def test_nothing_is_drawn_twice(base: Notes) -> None:
    errors = [number - true for key, own in base.own.items() for number, true in zip(own, base.truth[key], strict=True)]
    assert len(np.unique(np.round(errors, 9))) == len(errors)
    drawn = [number for values in base.own_draws.values() for pair in values for number in pair]
    assert len(set(drawn)) == len(drawn)


def test_more_draws_in_one_turn_do_not_change_those_of_the_next(base: Notes) -> None:
    more = run(cars_that_draw_more)
    for key in base.own_draws:
        assert [each[0] for each in base.own_draws[key]] == [each[0] for each in more.own_draws[key]]


def components_of(ready: Simulation, group: str, name: str) -> ComponentSelection:
    entry = next(entry for entry in ready.entries if entry.group.name == group and entry.name == name)
    return ComponentSelection(entry, range(len(entry.components) if name == "draw" else len(entry.group)))


def test_faults_of_some_agents_change_nothing_for_others_nor_later_draws(base: Notes) -> None:
    def blind(ready: Simulation) -> list[Fault]:
        sense = components_of(ready, "car", "sense")
        return [fault(Blind, at=3, lasting=4, components=[sense._replace(rows=[0, 2])])]

    def stop(ready: Simulation) -> list[Fault]:
        agents = AgentSelection(components_of(ready, "car", "sense").entry.group, [1])
        return [fault(Stop, at=3, lasting=4, agents=[agents])]

    for faults in (blind, stop):
        after = run(faults=faults)
        assert assert_shared(base, after, ROBOTS) > 3 * len(ROBOTS) * STEPS
        late = {key: value for key, value in after.others.items() if key[-1] >= 8 * STEP and key[0] in CARS}
        assert len(late) > 20
        if faults is blind:
            assert late == {key: base.others[key] for key in late}


def test_errors_that_a_fault_adds_depend_on_neither_the_other_agents_nor_when_it_began() -> None:
    def wrong(rows: Sequence[int], at: int, lasting: int = 4) -> Notes:
        def faults(ready: Simulation) -> list[Fault]:
            sense = components_of(ready, "car", "sense")._replace(rows=rows)
            written = {"of": "*", "deviation": [1.0, 1.0]}
            return [fault(Noise, written, at, lasting, components=[sense], bias=np.zeros(2), deviation=np.ones(2))]

        return run(faults=faults)

    one, other = wrong([0, 1, 2], 3), wrong([1], 5)
    both = [5 * STEP, 6 * STEP]
    for instant in both:
        assert one.own["car.1", instant] == other.own["car.1", instant]
        assert one.own["car.0", instant] != other.own["car.0", instant]
    errors = [np.subtract(one.own[id, instant], one.truth[id, instant]) for id in CARS for instant in both]
    assert len(np.unique(errors)) == 12


def test_process_noise_depends_on_the_step_and_not_on_earlier_draws() -> None:
    notes = Notes()
    ready, pushed = (simulation({"robot": team(notes)}) for _ in range(2))
    moves = []
    for each in (ready, pushed):
        each.environment.step()
        group = each.groups[0]
        if each is pushed:
            each.environment.push(group, [1], np.array([3.0, 0.0]))
        before = each.environment.state(group)
        each.environment.step()
        moves.append(each.environment.state(group) - before)
    assert moves[0] == pytest.approx(moves[1], abs=1e-12)


def latencies(
    change: Callable[[Teams], Teams] = lambda teams: teams,
    faults: Callable[[Simulation], Sequence[Fault]] = lambda ready: (),
    options: RunOptions | None = None,
) -> dict[tuple[str, int], Any]:
    """When the updates of each landed, by when they were computed."""
    landed = {}

    class Slowly(Component):
        def _compute(self) -> Any:
            return self.now

        def _update(self, value: Any) -> None:
            landed[self.agent.id, value] = self.now - value

    timing = Timing(latency=ProbabilityDistribution(uniform=(0.0, 0.04)), period=STEP, jitter=10 * MILLISECOND)
    members = {name: Team({"slow": Slowly}, 3, timings={"slow": timing}) for name in ("a", "b")}
    ready = simulation(change(members))
    execute(ready, STEPS, options=replace(options or RunOptions("asynchronous"), faults=tuple(faults(ready))))
    return landed


def test_latency_and_jitter_are_those_of_the_agent_and_the_turn() -> None:
    everybody, some = latencies(), latencies(lambda members: {"a": members["a"]})
    assert len(some) >= 3 * (STEPS - 2)
    assert some == {key: value for key, value in everybody.items() if key[0] in {"a.0", "a.1", "a.2"}}
    assert len(set(everybody.values())) == len(everybody)

    def slower(ready: Simulation) -> list[Fault]:
        rows = ComponentSelection(ready.entries[0], [1])
        written, duration = {"of": "*", "latency": 0.02}, ProbabilityDistribution(normal=(0.02, 0.005), least=0)
        return [fault(Slow, written, 2, 3, components=[rows], duration=duration)]

    faulty = latencies(faults=slower)
    differing = {key for key in everybody.keys() | faulty.keys() if everybody.get(key) != faulty.get(key)}
    assert {id for id, _ in differing} == {"a.1"}
    assert all(2 * STEP <= instant < 5 * STEP for _, instant in differing)


def test_a_period_of_its_own_does_not_change_draws_at_common_instants() -> None:
    def at_times(period: int) -> dict[Any, Any]:
        timing = Timing(period=period * STEP)
        return run(lambda teams, notes: {"car": team(notes, 3, timings={"draw": timing})}).own_draws

    often, seldom = at_times(2), at_times(3)
    common = often.keys() & seldom.keys()
    assert {instant // STEP for _, instant in common} == {0, 6}
    assert {key: often[key] for key in common} == {key: seldom[key] for key in common}


def test_turns_at_one_instant_draw_different_numbers() -> None:
    turns = []

    class Twice(Component):
        events = {"again": "take another turn"}  # noqa: RUF012 (as a plugin has it)

        def _compute(self) -> Any:
            return self.random.random()

        def _update(self, value: Any) -> None:
            turns.append((self.turn, value))
            if self.turn.repetition < 2:
                self.emit("again")

    trigger = Timing(period=STEP, trigger=Trigger("again"))
    execute(
        simulation({"a": Team({"twice": Twice}, timings={"twice": trigger})}), 4, options=RunOptions("asynchronous")
    )
    assert [turn for turn, _ in turns] == [Turn(step * STEP, time) for step in range(4) for time in range(3)]
    assert len({value for _, value in turns}) == 12


def test_draws_of_an_update_belong_to_its_turn_even_if_it_is_applied_late() -> None:
    def drawn(latency: float) -> list[Any]:
        timing = Timing(period=4 * STEP, latency=always(latency))
        found = run(lambda teams, notes: {"car": team(notes, 3, timings={"draw": timing})}, steps=16).own_draws
        return [found[key] for key in sorted(found)]

    assert drawn(0.0) == drawn(0.1)


def test_components_that_draw_nothing_have_no_generator() -> None:
    made = []

    class Idle(Component):
        def initialise_component(self, *arguments: Any) -> None:
            super().initialise_component(*arguments)
            made.append(self)

        def _compute(self) -> None:
            return None

        def _update(self, value: Any) -> None:
            pass

    execute(simulation({"a": Team({"idle": Idle}, 50)}), 3)
    assert len(made) == 50
    assert not any("_random" in vars(each) for each in made)


SCENARIO = """
symaware: 1
name: sampled
seed: 3
run: {duration: 0.1}
environment: {use: kinematic}
agents:
  robot:
    count: 4
    model: {use: single-integrator}
    state: {uniform: [-50, 50]}
    knowledge: {goal: {normal: [[0, 1], [2, 3]]}, own: {each: [{uniform: [0, 1]}, {normal: [0, 1]}, 3, 4]}}
    components: {see: {use: perception.self}}
"""


def test_the_first_four_of_five_begin_as_the_four_did(tmp_path: Path) -> None:
    begun = []
    for count in (4, 5):
        document = yaml.safe_load(SCENARIO)
        document["agents"]["robot"]["count"] = count
        if count == 5:
            document["agents"]["robot"]["knowledge"]["own"]["each"].append({"uniform": [0, 1]})
        (tmp_path / f"{count}.yaml").write_text(yaml.safe_dump(document))
        group = build(tmp_path / f"{count}.yaml").simulation.groups[0]
        known = [(each["goal"].tolist(), each["own"]) for each in group.knowledge[:4]]
        begun.append((group.initial_state[:4].tolist(), known))
    assert begun[0] == begun[1]
    states, known = begun[0]
    assert len({number for state, (goal, _) in zip(states, known, strict=True) for number in [*state, *goal]}) == 16
