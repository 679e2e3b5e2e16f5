"""The JSON schema of sweeps that editors use."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from checkout import CHECKOUT
from sweeping import symaware

from symaware_cli.language.source_parser import load
from symaware_cli.studies.sweep_schema import sweep_schema

TOP = CHECKOUT
BAD = Path(__file__).parent / "bad"
SHIPPED = sorted([*TOP.glob("sweeps/*.yaml"), *TOP.glob("plugins/*/sweeps/*.yaml")])

#: Faults that a schema cannot detect: the order of numbers, sums over several keys, and references to the scenario.
BEYOND = {
    "claim-about-nothing",
    "claim-beside-a-rule",
    "claim-of-too-few-runs",
    "design-without-a-distribution",
    "drawn-and-listed",
    "drawn-seed",
    "drawn-value-of-nothing",
    "end-that-the-scenario-refuses",
    "logarithm-of-zero",
    "negative-deviation",
    "option-that-the-scenario-refuses",
    "rule-over-a-latin-hypercube",
    "rule-over-a-sobol-sequence",
    "uniform-in-the-wrong-order",
    "weights-that-do-not-fit",
}


def validator() -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(sweep_schema()[0])


def document(path: Path) -> dict[str, Any]:
    return load(path, path.name).data


def test_the_schema_is_valid_and_the_shipped_copy_is_up_to_date() -> None:
    schema = validator().schema
    jsonschema.Draft202012Validator.check_schema(schema)
    written = (TOP / "schemas" / "sweep.schema.json").read_text(encoding="utf-8")
    assert json.loads(written) == sweep_schema(built_in_only=True)[0]
    assert symaware("schema", "--sweep", "--built-in") == written


def test_the_examples_in_the_documentation_fit_the_schema(tmp_path: Path) -> None:
    found = [
        block
        for path in sorted((TOP / "docs").glob("*.md"))
        for block in re.findall(r"```yaml\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)
        if "symaware-sweep:" in block
    ]
    assert len(found) >= 2
    for block in found:
        (tmp_path / "shown.yaml").write_text(block)
        validator().validate(document(tmp_path / "shown.yaml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_sweep_fits_the_schema(path: Path) -> None:
    validator().validate(document(path))


@pytest.mark.parametrize("path", sorted(BAD.glob("*.yaml")), ids=lambda path: path.stem)
def test_documents_invalid_by_themselves_do_not_fit_the_schema(path: Path) -> None:
    assert validator().is_valid(document(path)) == (path.stem in BEYOND)
