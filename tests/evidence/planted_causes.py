"""Violations of which the cause is known: a bad sensor, messages that are lost or late, a fault, or none of these.

The first are kept only if the same seed without the cause has no violation. `benchmarks/explain.py` uses them as well.
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


class Case(NamedTuple):
    """A run with a violation.

    Attributes:
        log: Its log.
        cause: The planted cause, as its `Candidate.text`; None if none of the candidates is a cause.
        kinds: The kinds of candidates that are examined.
        before: How long before the violation they are made right [s].
    """

    log: Path
    cause: str | None
    kinds: tuple[str, ...] = ("beliefs",)
    before: tuple[float, ...] = (0.5, 1.0)


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
        # Both would meet the cart, if they did not avoid it: they cross its way, one from below, one from above.
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
    return log, any(each.verdict == "violated" for each in summary.specifications)


def planted(folder: Path) -> Iterator[Case]:
    """Violations by the bad sensor of one of two walkers, without end."""
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
    """Violations since the messages of the cart to one of two walkers, who see nobody, are lost or late, without end.

    Of all other messages, one in five is lost, which does no harm. Only messages are candidates: as a walker knows of
    the cart by these messages only, its wrong belief about the cart is an effect of them, and would be right as well.
    """
    seed = 20_000
    while True:
        seed += 1
        bad = f"walker-{seed % 2}"
        good = talking(seed, {})
        if _run(good, folder, logged=False)[1]:
            continue
        channel = {"loss": 0.95} if seed // 2 % 2 else {"delay": 2.5, "jitter": 0.5}
        link = {"sender": "cart", "receiver": bad, "channel": channel}
        log, violated = _run(talking(seed, {"links": [link]}), folder)
        if violated:
            yield Case(log, f"messages cart to {bad}", ("messages",), (1.5,))


def talking(seed: int, network: Mapping[str, Any]) -> dict[str, Any]:
    """The scenario in which agents see only themselves, and tell each other where they are."""
    tree = _scenario(seed, None, {"topology": {"use": "complete", "channel": {"loss": 0.2}, **network}})
    for agent in tree["agents"].values():
        others = {name: use for name, use in agent["components"].items() if name != "see"}
        talk = {"inbox": {"use": "communication.inbox"}, "tell": {"use": "communication.broadcast"}}
        agent["components"] = {"see": {"use": "perception.self"}, **others, **talk}
    return tree


def with_faults(folder: Path) -> Iterator[Case]:
    """Violations by a declared fault, which puts a walker in the way of the cart, without end."""
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


def unplanted(folder: Path) -> Iterator[Case]:
    """Violations without a cause in beliefs, without end.

    In turn, a walker is put in the way of the cart, and a walker with a bad sensor does not use what it sees.
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
    return explain(case.log, kinds=case.kinds, before=case.before, within=0.5, futures=16, seed=seed)


def is_right(case: Case, explanation: Explanation) -> bool:
    """Whether the first cause is the planted one, or no cause was found where there is none."""
    if case.cause is None:
        return not explanation.causes
    first = explanation.causes[0].candidate if explanation.causes else None
    return first is not None and first.text == case.cause
