"""Every verb rejects an identity.json with values of a wrong type, in a sentence that names the file."""

import json
from pathlib import Path
from typing import Any

import pytest
from sweeping import symaware, tiny

WRONG: tuple[Any, ...] = (5, "text", None, True, [5], [[]], {"a": 5}, {"a": []}, [])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sweep")
    claim = "P(near) > 0.5 with confidence 0.9, sequential"
    symaware(
        "sweep", tiny(folder), "-o", folder / "out", "--runs", 2, "--jobs", 0, "--quiet", "--with", f"claim={claim}"
    )
    return folder / "out"


@pytest.mark.parametrize("name", ["cells", "specifications", "versions", "resolved"])
def test_each_value_of_a_wrong_type_is_rejected(name: str, made: Path) -> None:
    file = made / "identity.json"
    written = file.read_text()
    content = json.loads(written)
    try:
        for value in WRONG:
            if isinstance(value, dict) and name == "resolved":
                continue
            if value == [] and name == "specifications":
                continue  # another list of names, which `verify` detects
            file.write_text(json.dumps({**content, name: value}))
            for verb in (["verify", made, "--level", "arithmetic"], ["certify", made]):
                said = symaware(*verb, status=2)
                assert said.startswith(f"symaware: {file} is damaged: "), (value, said)
        for value in (
            {},
            [],
            {name: each for name, each in content.items() if name != "cells"},
            {**content, "more": 1},
        ):
            file.write_text(json.dumps(value))
            assert "is damaged" in symaware("verify", made, "--level", "arithmetic", status=2)
    finally:
        file.write_text(written)
