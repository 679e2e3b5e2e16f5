"""Agents whose components need other sections of the scenario: strategies, plans for specifications, estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fuzzing.draft import Draft, Tree
from fuzzing.values import Values

_GOALS = (
    *("always eventually hall", "always eventually lab", "eventually lab", "always eventually (hall or lab)"),
    *("always (hall implies eventually lab)", "always (met implies not next lab)", "always (lab or hall)"),
    "always eventually met",
)


class Ensembles:
    """Adds agents together with what their components need."""

    def __init__(self, draft: Draft, values: Values) -> None:
        self._draft = draft
        self._values = values

    def add(self) -> None:
        """Add an agent of some kind, unless the scenario has one already."""
        ways: Sequence[Callable[[], None]] = (self._strategist, self._planner, self._driver, self._estimator)
        if "extra" not in self._draft.tree["agents"]:
            self._draft.chance.choice(ways)()

    def _agent(self, model: Tree, state: Sequence[float], components: Tree) -> Tree:
        group: Tree = {"model": model, "state": list(state), "components": components}
        if self._draft.chance.random() < 0.5:
            group["entity"] = {"shape": {"circle": {"radius": 0.2}}}
        self._draft.tree["agents"]["extra"] = group
        return group

    def _strategist(self) -> None:
        """An agent that goes from cell to cell by a strategy."""
        draft, chance = self._draft, self._draft.chance
        tree = draft.tree
        tree["regions"] |= {"hall": {"box": [-4, 0, -3, 3]}, "lab": {"box": [0, 4, -3, 3]}}
        tree["regions"]["arena"] = {"box": [-4, 4, -3, 3]}
        models = tree.setdefault("knowledge_models", {})
        kind = chance.choice(["grid", "regions", "file", "product"])
        grid: Tree = {"cell": chance.choice([1.0, 2.0, 0.5]), "region": "arena"}
        if chance.random() < 0.3:
            tree["regions"]["pit"] = {"box": [1, 2, 1, 2]}
            grid["obstacles"] = ["pit"]
        if kind == "regions":
            models["floor"] = {"use": "abstraction.regions", "with": {"regions": ["hall", "lab"]}}
        elif kind == "file":
            file = chance.choice(["halls.yaml", "halls.dot"])
            models["floor"] = {"use": "abstraction.file", "with": {"graph": {"file": file}}}
        else:
            models["floor"] = {"use": "abstraction.grid", "with": grid}
        if kind == "product":
            gripper = {"graph": {"file": "gripper.dot"}, "places": False}
            models["gripper"] = {"use": "abstraction.file", "with": gripper}
            models["both"] = {"use": "abstraction.product", "with": {"models": ["floor", "gripper"]}}
        model = "both" if kind == "product" else "floor"
        other = chance.choice([each for each in draft.agents() if each != "extra"])
        place = {"agent": other, "inside": "zone" if "zone" in tree["regions"] else "lab"}
        labels: Tree = chance.choice([{"met": place}, {"met": "time > 1"}, {}])
        if kind != "product" and chance.random() < 0.2:
            labels["other"] = {"cell_of": other}
        goals = [each for each in _GOALS if "met" not in each or "met" in labels]
        options: Tree = {"model": model, "guarantees": chance.sample(goals, chance.randint(1, 2))}
        if labels:
            options["labels"] = labels
        if "met" in labels and chance.random() < 0.5:
            options["assumptions"] = ["always eventually met"]
        components: Tree = {"sense": {"use": chance.choice(["perception.omniscient", "perception.self"])}}
        knowledge: Tree = {}
        if chance.random() < 0.3:
            components["lidar"] = {"use": "perception.lidar", "with": {"range": 3.0, "rays": 12}}
            blocked = self._values.use("component", "knowledge.blocked-cells")
            blocked["with"] = {**blocked.get("with", {}), "model": model, "scan": "lidar", "knowledge": "blocked"}
            components["learn"] = blocked
            knowledge, options["blocked"] = {"blocked": {"all": []}}, "blocked"
        more = self._values.options(
            "component:knowledge.strategy",
            chance.choice([0, 1, 2]),
            without=("model", "labels", "assumptions", "guarantees", "blocked", "knowledge"),
        )
        components["decide"] = {"use": "knowledge.strategy", "with": {**more, **options}}
        if chance.random() < 0.4:
            components["decide"]["period"] = 2 * draft.step
        steer = self._values.use("component", "control.cells")
        steer["with"] = {**steer.get("with", {}), "model": model, "certified": chance.random() < 0.3}
        components["steer"] = steer
        moves = chance.choice(["single-integrator", "unicycle"])
        state = [chance.choice([-1.5, 0.25]), 0.25, *([0.0] if moves == "unicycle" else [])]
        group = self._agent({"use": moves}, state, components)
        if knowledge:
            group["knowledge"] = knowledge

    def _planner(self) -> None:
        """An agent that plans for a specification, or weighs its risk."""
        draft, chance = self._draft, self._draft.chance
        last = f"{draft.duration:.6g}"
        formula = chance.choice(
            [
                f"eventually[0, {last}] inside(position, zone)",
                f"always[0, {last}] inside(position, zone)",
                f"always[0, {last}] not inside(position, zone)",
                f"eventually[0, {last}] x > 0.5",
            ]
        )
        draft.tree["regions"].setdefault("zone", {"box": [0, 4, -2, 2]})
        draft.tree["specifications"]["plan"] = {"each": "extra", "formula": formula}
        use = chance.choice(["control.stl", "control.stl", "control.risk-aware", "risk.specification"])
        steer = self._values.use("component", use)
        steer["with"] = {**steer.get("with", {}), "specifications": ["plan"]}
        if use == "control.stl":
            steer["with"].setdefault("interval", max(1, round(draft.duration / draft.step / 5)) * draft.step)
        components: Tree = {"sense": {"use": "perception.self"}}
        knowledge = {"goal": [2.0, 0.0]}
        if use != "control.stl":
            components["go"] = {"use": "control.go-to-goal"}
        components["act"] = steer
        model = chance.choice(["single-integrator", "double-integrator"])
        drawn = {"use": model, "with": {"process_noise": 0.05}} if chance.random() < 0.5 else {"use": model}
        state = [-0.5, 0.2, *([0.0, 0.0] if model == "double-integrator" else [])]
        self._agent(drawn, state, components)["knowledge"] = knowledge

    def _driver(self) -> None:
        """An agent that solves an optimal control problem over its own motion."""
        draft, chance = self._draft, self._draft.chance
        steps = chance.randint(3, 6)
        steer = self._values.use("component", "control.mpc", chance.choice([0, 1, 2, 3]))
        horizon = {"horizon": round(steps * max(draft.step, 0.1), 6), "steps": steps}
        steer["with"] = {**steer.get("with", {}), **horizon}
        steer["period"] = round(draft.step * chance.choice([1, 4]), 6)
        model = chance.choice(["unicycle", "single-integrator", "double-integrator"])
        state = [-2.0, -2.0, *{"unicycle": [0.0], "double-integrator": [0.0, 0.0]}.get(model, [])]
        components = {"sense": {"use": "perception.omniscient"}, "steer": steer}
        self._agent({"use": model}, state, components)["knowledge"] = {"goal": [2.0, 1.0]}

    def _estimator(self) -> None:
        """An agent with regions that are calibrated by the errors of earlier runs."""
        chance = self._draft.chance
        estimate = self._values.use("component", "uncertainty.conformal", chance.choice([0, 1]))
        estimate["with"] = {**estimate.get("with", {}), "calibration": {"file": "errors.parquet"}}
        if chance.random() < 0.3:
            estimate["with"]["calibration"]["column"] = "prediction_error"
        components = {"sense": {"use": "perception.omniscient"}, "foresee": estimate}
        components["steer"] = {"use": "control.go-to-goal"}
        self._agent({"use": "single-integrator"}, [0.0, -1.0], components)["knowledge"] = {"goal": [2.0, 1.0]}
