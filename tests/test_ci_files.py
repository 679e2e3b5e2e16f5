"""The files for continuous integration and containers are valid, and their commands are those that exist."""

import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from checkout import CHECKOUT
from typer.main import get_command

from symaware_cli.cli.application import all_commands, application

FILES = [*sorted((CHECKOUT / "ci").glob("*.yml")), CHECKOUT / ".pre-commit-hooks.yaml"]


def texts(content: Any) -> Iterator[tuple[str, str]]:
    """The texts in a document, each with the key that it is under."""
    if isinstance(content, dict):
        for key, each in content.items():
            yield from ((str(key), each),) if isinstance(each, str) else texts(each)
            if isinstance(each, list):
                yield from ((str(key), line) for line in each if isinstance(line, str))
    elif isinstance(content, list):
        for each in content:
            yield from texts(each)


def commands(file: Path) -> list[str]:
    """The commands of `symaware` in a file, without this word."""
    found = []
    for key, text in texts(yaml.safe_load(file.read_text(encoding="utf-8"))):
        if key == "arguments":
            found.append(text)
        elif key in ("run", "script", "before_script", "entry"):
            found += re.findall(r"(?m)^symaware (.*)$", text)
    return [text for text in found if not text.startswith("$")]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_each_command_exists_with_its_options(file: Path) -> None:
    found = commands(file)
    assert found or file.name == "action.yml"
    root = typer.Context(get_command(application), info_name="symaware")
    for text in found:
        verb, *words = shlex.split(text)
        command = all_commands()[verb]
        context = typer.Context(command, parent=root, info_name=verb)
        # Only names of options and the number of arguments: nothing is run.
        options, _, _ = command.make_parser(context).parse_args(list(words))
        for result in options.get("results") or options.get("results_to") or ():
            assert result.partition(":")[0] in ("junit", "sarif")


def test_the_examples_name_existing_scenarios() -> None:
    named = {name for file in FILES for text in commands(file) for name in re.findall(r"scenarios/\S+", text)}
    assert named
    assert all((CHECKOUT / name).is_file() for name in named)


def test_the_action_passes_its_inputs_as_variables_so_that_none_is_executed() -> None:
    action = yaml.safe_load((CHECKOUT / "ci" / "action.yml").read_text())
    assert action["runs"]["using"] == "composite"
    scripts = [step["run"] for step in action["runs"]["steps"] if "run" in step]
    assert scripts
    assert not [script for script in scripts if "${{" in script]


def test_the_hook_is_for_scenarios_and_not_for_their_bases() -> None:
    (hook,) = yaml.safe_load((CHECKOUT / ".pre-commit-hooks.yaml").read_text())
    assert {"id", "name", "entry", "language", "files"} <= hook.keys()
    for path in [*CHECKOUT.glob("scenarios/*.yaml"), *CHECKOUT.glob("plugins/*/scenarios/*.yaml")]:
        is_base = path.name.startswith("_")
        assert (re.search(hook["files"], path.relative_to(CHECKOUT).as_posix()) is None) == is_base


def test_the_containers_run_both_commands_of_the_readme() -> None:
    readme = (CHECKOUT / "README.md").read_text()
    first, second = re.findall(r"(?m)^```sh\n(python3 -m venv .*)\n```$", readme)
    docker = (CHECKOUT / "Dockerfile").read_text()
    assert f"\nRUN {first}\n" in docker
    container = json.loads((CHECKOUT / ".devcontainer" / "devcontainer.json").read_text())
    assert container["postCreateCommand"] == second
    stages = re.findall(r"(?m)^FROM (\S+) AS (\S+)$", docker)
    assert container["build"]["target"] in [name for _, name in stages]
    assert "/" not in stages[0][0], "the base image is named without a host"
