"""What composed scenarios begin with: agents that sense and move, or a short form of a shipped scenario."""

from __future__ import annotations

import copy
from functools import cache
from pathlib import Path
from typing import Any

from fuzzing.draft import Draft, Tree
from fuzzing.side_files import SCENARIOS
from fuzzing.values import Values

#: The greatest number of agents, which keeps runs short.
_AGENTS = 6

#: The steps of the short form of a shipped scenario.
_STEPS = (8, 25)

#: Shipped scenarios with so many agents or such long computations that their checks take minutes.
_TOO_LONG = frozenset(
    {
        *("circle-swap", "consensus", "flooding", "rumour", "swarm", "star", "window", "as-recorded"),
        *(
            "four-intruders",
            "_auctioned",
            "_weak-motors",
            "failing-robots",
            "grades",
            "drives-apart",
            "two-robots",
            "intent-avoidance",
        ),
    }
)

#: Those that are drawn less often.
_LONG = frozenset({"drives", "either-or", "gusts", "quay", "turning-carts"})


def foundation(draft: Draft, values: Values) -> Tree:
    """Draw what a scenario begins with."""
    shipped = _shipped(draft)
    return _short(draft, shipped) if shipped and draft.chance.random() < 0.4 else _plain(draft, values)


def _shipped(draft: Draft) -> list[Path]:
    """The shipped scenarios whose plugins are installed, and that are not too long."""
    folders = [SCENARIOS, *sorted((SCENARIOS.parent / "plugins").glob("*/scenarios"))]
    known = [SCENARIOS] + [each for each in folders[1:] if _family(each) in _families(draft)]
    files = [path for folder in known for path in sorted(folder.glob("*.[yt]*ml"))]
    light = [path for path in files if path.stem not in (*_TOO_LONG, *_LONG)]
    return [*(light * 4), *(path for path in files if path.stem in _LONG)]


def _family(folder: Path) -> str:
    """The first part of the names of a plugin's components, which is part of the name of its package."""
    return folder.parent.name.rpartition("-")[2]


def _families(draft: Draft) -> set[str]:
    return {name.partition(".")[0] for name in draft.plugins("component")}


@cache
def _composed(path: Path) -> Tree:
    from symaware_cli.language.compose import compose

    return compose(path).data


def _short(draft: Draft, paths: list[Path]) -> Tree:
    """A shipped scenario in one file, with a short duration."""
    chance = draft.chance
    tree: Tree = copy.deepcopy(_composed(chance.choice(paths)))
    world = tree["environment"]
    default: Any = draft.definitions[f"environment:{world['use']}"]["properties"]["time_step"].get("default")
    step = world.setdefault("with", {}).setdefault("time_step", default)
    tree["run"]["duration"] = round(chance.randint(*_STEPS) * step, 6)
    tree |= {"name": "composed", "seed": chance.randrange(1000)}
    tree.pop("description", None)
    for section in ("agents", "regions", "specifications"):
        tree.setdefault(section, {})
    for group in tree["agents"].values():
        group.setdefault("components", {})
    if not tree["regions"]:
        tree["regions"]["zone"] = {"box": [0, 4, -2, 2]}
    return tree


def _plain(draft: Draft, values: Values) -> Tree:
    """A world with agents that sense and move."""
    chance = draft.chance
    step = chance.choice([0.02, 0.05, 0.1, 0.25])
    world = chance.choice(["kinematic", "kinematic", *draft.plugins("environment")])
    steps = chance.randint(5, 40)
    tree: Tree = {
        "symaware": 1,
        "name": "composed",
        "seed": chance.randrange(1000),
        "run": {"duration": round(steps * step, 6), "mode": chance.choice(["synchronous", "asynchronous"])},
        "environment": {"use": world, "with": {"time_step": step}},
        "agents": {},
        "regions": {
            "zone": {"box": [0, 4, -2, 2]},
            "disc": {"circle": {"centre": [1, 1], "radius": 1.5}},
            "hall": {"box": [-4, 0, -3, 3]},
            "lab": {"box": [0, 4, -3, 3]},
        },
        "specifications": {},
    }
    draft.tree = tree  # values of groups depend on the world
    left = _AGENTS
    for name in chance.sample(["robot", "car", "aide"], chance.randint(1, 3)):
        count = chance.randint(1, min(3, left - 1)) if left > 1 else 1
        left -= count
        tree["agents"][name] = _group(draft, values, count)
    return tree


def _group(draft: Draft, values: Values, count: int) -> Tree:
    chance = draft.chance
    model = chance.choice(["single-integrator", "unicycle", *draft.plugins("model")])
    group: Tree = {
        "model": values.use("model", model),
        "knowledge": {
            "goal": _each(draft, count, 2),
            "waypoints": {"all": [[1, 1], [2, 0]]},
            "timed_waypoints": {"all": [[0, 1, 1], [2, 2, 0]]},
        },
        "components": {"sense": values.use("component", chance.choice(draft.plugins("component:perception")))},
    }
    if chance.random() < 0.2:
        group["knowledge"]["value"] = {"uniform": [0.0, 4.0]}  # of which consensus makes the mean
    if count > 1 or chance.random() < 0.5:
        group["count"] = count
    if chance.random() < 0.8:
        group["entity"] = {"shape": {"circle": {"radius": round(chance.uniform(0.1, 0.5), 2)}}}
    circle = {**values.options("CirclePlacement", 1), "radius": chance.choice([1.0, 3.0])}
    grid = {"spacing": 1.5, **values.options("GridPlacement", 1)}
    group["state"] = chance.choice(
        [{"circle": {**circle, "phase": round(chance.uniform(0, 6), 2)}}, {"grid": grid}, {"uniform": [-3, 3]}]
    )
    return group


def _each(draft: Draft, count: int, length: int) -> Any:
    values = [[round(draft.chance.uniform(-5, 5), 1) for _ in range(length)] for _ in range(count)]
    return {"each": values} if count > 1 else {"all": values[0]}
