"""Violations of which the cause is known: a bad sensor, lost or late messages, a fault, a broken promise, or none.

Cases with a cause are kept only if the same seed without the cause has no violation. `benchmarks/explain.py` uses them
as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

import symaware_cli
from symaware_cli.evidence import Explanation, explain

GOOD = {"range": 9.0, "position_noise": 0.05, "velocity_noise": 0.05}
BAD = {"range": 9.0, "position_noise": 1.2, "velocity_noise": 0.6, "dropout": 0.4}

#: The cart drives along the x axis from here, and meets walkers around these times [m, s].
START, TIMES = -4.0, (2.6, 4.2)

#: Walkers promise to stay this far from the line on which the cart drives [m]: it passes them at that distance.
ASIDE = 0.9


class Case(NamedTuple):
    """A run with a violation.

    Attributes:
        log: The log of the run.
        cause: The planted cause, as its `Candidate.text`; None if none of the candidates is a cause.
        kinds: The kinds of candidates that are examined.
        before: The times before the violation from which on they are corrected [s].
        specification: The specification that is explained; None for the one that was violated first.
    """

    log: Path
    cause: str | None
    kinds: tuple[str, ...] = ("beliefs",)
    before: tuple[float, ...] = (0.5, 1.0)
    specification: str | None = None


def _scenario(seed: int, bad: int | None, changes: Mapping[str, Any]) -> dict[str, Any]:
    chance = np.random.default_rng(seed)
    body = {"entity": {"shape": {"circle": {"radius": 0.3}}}}
    model = {"use": "single-integrator", "with": {"max_speed": 1.2, "process_noise": 0.02}}
    agents: dict[str, Any] = {
        "cart": {
            **body,
            "model": model,
            "state": [START, 0.0],
            "knowledge": {"goal": [5.0, 0.0]},
            "components": {
                "see": {"use": "perception.self"},
                "drive": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
            },
        }
    }
    for number, time in enumerate(TIMES):
        # Both walkers would hit the cart if they did not avoid it: they cross its way, one from below, one from above.
        side, slant = (-1.0 if number else 1.0), float(chance.uniform(-0.4, 0.4))
        meeting, way = START + time + float(chance.uniform(-0.1, 0.1)), np.array([np.sin(slant), side * np.cos(slant)])
        start, goal = np.array([meeting, 0.0]) - time * way, np.array([meeting, 0.0]) + 3.0 * way
        agents[f"walker-{number}"] = {
            **body,
            "model": model,
            "state": start.round(3).tolist(),
            "knowledge": {"goal": goal.round(3).tolist()},
            "components": {
                "see": {"use": "perception.range", "with": BAD if number == bad else GOOD},
                "avoid": {
                    "use": "control.velocity-obstacle",
                    "with": {"speed": 1.0, "time_horizon": 2.5, "margin": 0.15},
                },
            },
        }
    pairs = [["cart", "walker-0"], ["cart", "walker-1"], ["walker-0", "walker-1"]]
    return {
        "symaware": 1,
        "name": "planted",
        "seed": seed,
        "run": {"duration": 6.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": agents,
        "specifications": {"apart": {"pairs": pairs, "formula": "always distance > 0.55"}},
        **changes,
    }


def _run(tree: Mapping[str, Any], folder: Path, *, logged: bool = True) -> tuple[Path, bool]:
    file, log = folder / "planted.yaml", folder / "planted.mcap"
    file.write_text(yaml.safe_dump(dict(tree), sort_keys=False))
    log.unlink(missing_ok=True)
    summary = symaware_cli.load(file).run(output=log, record=logged).summary
    return log, any(each.verdict == "violated" and each.name == "apart" for each in summary.specifications)


def planted(folder: Path) -> Iterator[Case]:
    """Yield violations by the bad sensor of one of two walkers, endlessly."""
    seed = 0
    while True:
        seed += 1
        bad = seed % 2
        if _run(_scenario(seed, None, {}), folder, logged=False)[1]:
            continue
        log, violated = _run(_scenario(seed, bad, {}), folder)
        if violated:
            yield Case(log, f"walker-{bad} about cart")


def with_lost_messages(folder: Path) -> Iterator[Case]:
    """Yield violations by lost messages of the cart to one of two walkers, endlessly; see `_with_messages`."""
    # One message that arrives is enough to avoid the cart: with a loss of 0.95, most futures have such a message, and
    # what is lost by chance in this run is no cause in general.
    return _with_messages(folder, {"loss": 0.99}, 1)


def with_late_messages(folder: Path) -> Iterator[Case]:
    """Yield violations by late messages of the cart to one of two walkers, endlessly; see `_with_messages`."""
    return _with_messages(folder, {"delay": 2.5, "jitter": 0.5}, 0)


def _with_messages(folder: Path, channel: Mapping[str, Any], half: int) -> Iterator[Case]:
    """Yield violations by a bad channel from the cart to one of two walkers, which have no sensors.

    One in five of all other messages is lost, which does no harm. Only messages are candidates: since a walker knows
    the cart by these messages only, its wrong belief about the cart is an effect of the losses, and would be a valid
    cause as well.
    """
    seed = 20_000
    while True:
        seed += 1
        if seed // 2 % 2 != half:
            continue
        bad = f"walker-{seed % 2}"
        good = talking(seed, {})
        if _run(good, folder, logged=False)[1]:
            continue
        link = {"sender": "cart", "receiver": bad, "channel": channel}
        log, violated = _run(talking(seed, {"links": [link]}), folder)
        if violated:
            yield Case(log, f"messages cart to {bad}", ("messages",), (1.5,))


def talking(seed: int, network: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scenario in which agents perceive only themselves, and send each other their states."""
    tree = _scenario(seed, None, {"topology": {"use": "complete", "channel": {"loss": 0.2}, **network}})
    for agent in tree["agents"].values():
        others = {name: use for name, use in agent["components"].items() if name != "see"}
        talk = {"inbox": {"use": "communication.inbox"}, "tell": {"use": "communication.broadcast"}}
        agent["components"] = {"see": {"use": "perception.self"}, **others, **talk}
    return tree


def with_faults(folder: Path) -> Iterator[Case]:
    """Yield violations by a declared fault, which puts a walker in the way of the cart, endlessly."""
    seed = 30_000
    while True:
        seed += 1
        if _run(_scenario(seed, None, {}), folder, logged=False)[1]:
            continue
        log, violated = _run(putting(seed), folder)
        if violated:
            yield Case(log, "fault put", ("beliefs", "messages", "faults"), (0.5,))


def putting(seed: int) -> dict[str, Any]:
    """The scenario in which a walker is put in the way of the cart."""
    number = seed // 2 % 2
    tree = _scenario(seed, None, {})
    place = {"of": f"walker-{number}", "state": [START + TIMES[number], 0.3]}
    tree["faults"] = {"put": {"at": TIMES[number], "place": place}}
    return tree


def with_broken_promises(folder: Path) -> Iterator[Case]:
    """Yield violations by one of two walkers, which breaks its promise to stay beside the way of the cart, endlessly.

    The other one breaks its promise as well, behind the cart, where it does no harm. The cart relies on both promises.
    """
    seed = 40_000
    while True:
        seed += 1
        bad = seed % 2
        if _run(promising(seed, are_kept=True), folder, logged=False)[1]:
            continue
        log, violated = _run(promising(seed), folder)
        if violated:
            yield Case(log, f"promise aside_{bad} of walker-{bad}", ("beliefs", "promises"), (0.5, 1.0), "apart")


def promising(seed: int, *, are_kept: bool = False) -> dict[str, Any]:
    """The scenario in which walkers promise to stay beside the cart's way, and both cross it, or else both stop there.

    The walker whose broken promise harms the cart crosses the way when the cart is there, the other one 2 m behind it.
    """
    chance, bad = np.random.default_rng(seed), seed % 2
    tree, time = _scenario(seed, None, {}), TIMES[bad]
    tree["regions"], tree["promises"] = {}, {}
    cart = tree["agents"]["cart"]["components"]
    cart["see"] = {"use": "perception.range", "with": GOOD}
    drive = cart.pop("drive")
    cart["filter"], cart["watch"] = {"use": "uncertainty.gaussian"}, {"use": "promises.monitor"}
    cart["drive"] = drive
    cart["safe"] = {"use": "control.barrier-filter", "with": {"margin": 0.1, "cooperative": False, "reach": 6.0}}
    for number in range(len(TIMES)):
        side, behind = (-1.0 if number else 1.0), (0.0 if number == bad else 2.0)
        place = START + time - behind + float(chance.uniform(-0.1, 0.1))
        walker, ends = tree["agents"][f"walker-{number}"], (ASIDE + 0.3 if are_kept else -3.0)
        walker["state"] = [round(place, 3), round(side * (time + float(chance.uniform(-0.1, 0.1))), 3)]
        walker["knowledge"] = {"goal": [round(place, 3), side * ends]}
        walker["components"] = {
            "see": {"use": "perception.self"},
            "drive": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
        }
        edges = sorted([side * ASIDE, side * 6.0])
        tree["regions"][f"side_{number}"] = {"box": [-9.0, 9.0, *edges]}
        tree["promises"][f"aside_{number}"] = {
            "of": f"walker-{number}",
            "formula": f"always inside(position, side_{number})",
            "to": "cart",
            "on_broken": "event",
        }
    return tree


def unplanted(folder: Path) -> Iterator[Case]:
    """Yield violations without a cause in beliefs, endlessly.

    Alternately, a walker is put in the way of the cart, and a walker with a bad sensor ignores its beliefs.
    """
    seed = 10_000
    while True:
        seed += 1
        number = seed // 2 % 2
        if seed % 2:
            tree = putting(seed)
        else:
            tree = _scenario(seed, number, {})
            components = tree["agents"][f"walker-{number}"]["components"]
            components["avoid"] = {"use": "control.go-to-goal", "with": {"speed": 1.0}}
            tree["agents"][f"walker-{number}"]["model"] = {
                "use": "single-integrator",
                "with": {"max_speed": 1.2, "process_noise": 0.1},
            }
        log, violated = _run(tree, folder)
        if violated:
            yield Case(log, None)


def explained(case: Case, seed: int = 0) -> Explanation:
    """Explain a case at one or two instants, with few futures."""
    return explain(
        case.log, case.specification, kinds=case.kinds, before=case.before, within=0.5, futures=16, seed=seed
    )


def is_right(case: Case, explanation: Explanation) -> bool:
    """Whether the first cause is the planted one, or no cause was found if there is none."""
    if case.cause is None:
        return not explanation.causes
    first = explanation.causes[0].candidate if explanation.causes else None
    return first is not None and first.text == case.cause
