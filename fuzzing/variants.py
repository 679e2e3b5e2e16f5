"""Promises about scenarios that are changed, or written otherwise, and that must give the same run."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random
from typing import Any

from fuzzing.composer import written
from fuzzing.subject import Skipped, Subject, Tree, same, same_logs, same_series

#: Keys that give a component turns at other times than those of the world, and keys that act between its steps.
_TIMED = frozenset({"period", "offset", "jitter", "trigger", "latency", "run_in"})
_BETWEEN_STEPS = ("faults", "topology", "present", "offer")


def by_workers(subject: Subject) -> None:
    """A component that computes in a worker process gives the same run."""
    tree = copy.deepcopy(subject.tree)
    subject.require_finished()
    components = [use for group in tree["agents"].values() for use in group["components"].values()]
    subject.chance.choice(components)["run_in"] = "process"
    tree["run"]["workers"] = 1
    import symaware_cli as sa

    path = subject.written(tree, "workers-scenario")
    try:
        result = subject.run(path, "worker")
    except sa.ScenarioError as error:
        raise Skipped("refused in a process") from error
    same("workers: status", subject.result.status, result.status)
    same_logs(subject, subject.log, Path(result.log_path), only_channels=True)


def permuted(subject: Subject) -> None:
    """The order of groups, specifications and regions in the file does not matter."""
    tree = copy.deepcopy(subject.tree)
    tree["agents"] = dict(reversed(tree["agents"].items()))
    tree["regions"] = dict(reversed(tree["regions"].items()))
    tree["environment"] = dict(reversed(tree["environment"].items()))
    result = subject.run(subject.written(tree, "permuted"), "permuted")
    same_logs(subject, subject.log, Path(result.log_path), only_channels=True)


def with_an_absent_agent(subject: Subject) -> None:
    """An agent that never enters changes nothing for others."""
    import symaware_cli as sa

    subject.require_finished()
    subject.without('"ring"', '"grid", ', '"tree"', '"random"', '"graph"', '"star"', '"line"')
    subject.without('"dropped"')  # whoever tells everybody tells it, too, in vain
    if subject.tree["environment"]["use"] == "pybullet" and subject.result.summary.contacts:
        raise Skipped("PyBullet's order of contacts depends on all bodies")
    tree = copy.deepcopy(subject.tree)
    tree["agents"]["zz"] = {"model": {"use": "single-integrator"}, "present": {"from": 1e6}}
    _same_for_others(subject, tree, "absent", ("world", "state", "risk", "requested_control"), sa)


def with_a_far_agent(subject: Subject) -> None:
    """An agent that is far away and that nobody hears of changes nothing for the motion of others."""
    import symaware_cli as sa

    subject.require_finished()
    subject.without(
        "omniscient", "communication", "topology", "allocation", "goals_reached", "agents >", "nearest", "offer"
    )
    subject.without('"*', "until", "stl", "mpc")
    tree = copy.deepcopy(subject.tree)
    tree["agents"]["zz"] = {"model": {"use": "single-integrator"}, "state": [1e6, 1e6]}
    _same_for_others(subject, tree, "far", ("world", "state"), sa)


def _same_for_others(subject: Subject, tree: Tree, name: str, fields: Sequence[str], sa: Any) -> None:
    try:
        result = subject.run(subject.written(tree, name), name)
    except sa.ScenarioError as error:
        raise Skipped("refused with another agent") from error
    one, other = sa.open_log(subject.log), sa.open_log(result.log_path)
    same(f"{name}: steps", subject.result.summary.steps, result.summary.steps)
    for group in subject.tree["agents"]:
        for field in fields:
            same_series(one, other, group, field, f"{name}: {field}")


def in_toml(subject: Subject) -> None:
    """The same document in TOML is the same scenario."""
    lines = [f"{key} = {_toml(value)}" for key, value in subject.tree.items()]
    path = subject.written({}, "toml").with_suffix(".toml")
    path.write_text("\n".join(lines) + "\n")
    result = subject.run(path, "toml")
    same_logs(subject, subject.log, Path(result.log_path), only_channels=True)


def _toml(value: Any) -> str:
    """A value as TOML, which has no null."""
    match value:
        case None:
            raise Skipped("has a null")
        case bool():
            return "true" if value else "false"
        case dict():
            return "{" + ", ".join(f"{json.dumps(key)} = {_toml(each)}" for key, each in value.items()) + "}"
        case list():
            return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)


def in_several_files(subject: Subject) -> None:
    """A scenario that is composed of files, parameters and changes is that of one file."""
    chance, tree = subject.chance, copy.deepcopy(subject.tree)
    places = [each for each in _leaves(tree) if each[-1] not in ("symaware", "name", "use") and each[0] != "parameters"]
    chance.shuffle(places)
    changes = []
    for place in [each for each in places if all(isinstance(key, str) for key in each)][:2]:
        # The file has another value, which is changed back.
        places.remove(place)
        holder = _holder(tree, place)
        changes.append(f"{'.'.join(map(str, place))}={json.dumps(holder[place[-1]])}")
        holder[place[-1]] = 12345
    for number, place in enumerate(places[:3]):
        holder, name = _holder(tree, place), f"part{number}"
        tree.setdefault("parameters", {})[name] = holder[place[-1]]
        holder[place[-1]] = f"${{parameters.{name}}}"
    base, rest = _divided(tree, chance)
    base["unknown"], rest["unknown"] = {"key": 1}, None
    path = subject.written({"extends": "base.yaml", **rest}, "several-files")
    path.with_name("base.yaml").write_bytes(written(base))
    result = subject.run(path, "several-files", changes=changes)
    same_logs(subject, subject.log, Path(result.log_path), only_channels=True)


def _leaves(value: Any, above: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The paths of all numbers and texts that are no references."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(inner, (*above, key))
    elif value is not None and "${" not in str(value):
        yield above


def _holder(tree: Tree, place: Sequence[str | int]) -> Any:
    """What holds the value at a path."""
    holder: Any = tree
    for key in place[:-1]:
        holder = holder[key]
    return holder


def _divided(tree: Tree, chance: Random) -> tuple[Tree, Tree]:
    """A base, and what extends it: of each mapping the base has the first keys, so that their order stays."""
    base: Tree = {}
    rest: Tree = {}
    first = chance.randrange(len(tree))
    for place, (key, value) in enumerate(tree.items()):
        if place == first and isinstance(value, dict) and value:
            base[key], rest[key] = _divided(value, chance)
        elif place < first or _has_null(value):
            base[key] = value  # a null in a file that extends another removes a key
        else:
            rest[key] = value
    return base, rest


def _has_null(value: Any) -> bool:
    if isinstance(value, dict | list):
        return any(map(_has_null, value.values() if isinstance(value, dict) else value))
    return value is None


def in_the_other_mode(subject: Subject) -> None:
    """If nothing happens between the steps of the world, both modes give the same run."""
    from symaware_cli.core import Component
    from symaware_cli.language import Catalogue

    subject.without(*(f'"{key}"' for key in _BETWEEN_STEPS))
    catalogue = Catalogue()
    for group in subject.tree["agents"].values():
        for use in group["components"].values():
            if _TIMED & use.keys():
                raise Skipped("has turns at other times")
            if catalogue.load("component", use["use"])._async_compute is not Component._async_compute:
                raise Skipped("waits within turns")
    tree = copy.deepcopy(subject.tree)
    mode = tree["run"].get("mode", "synchronous")
    tree["run"]["mode"] = "asynchronous" if mode == "synchronous" else "synchronous"
    result = subject.run(subject.written(tree, "other-mode"), "other-mode")
    same_logs(subject, subject.log, Path(result.log_path), only_channels=True)


def paced(subject: Subject) -> None:
    """A run that keeps pace with the wall clock writes the log of one that does not."""
    tree = copy.deepcopy(subject.tree)
    if tree["run"].pop("pace", None) is None:
        tree["run"]["pace"] = 1e6
    result = subject.run(subject.written(tree, "paced"), "paced")
    same_logs(subject, subject.log, Path(result.log_path), only_channels=True)
