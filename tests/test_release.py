"""A release states one version everywhere, and says what it consists of and what it was built from."""

import hashlib
import json
import re
import runpy
from pathlib import Path
from typing import Any

import pytest
from checkout import CHECKOUT

import symaware_cli


@pytest.fixture(scope="module")
def release() -> dict[str, Any]:
    return runpy.run_path(str(CHECKOUT / ".ci" / "release.py"))


def test_the_checkout_states_the_version_that_is_installed(release: dict[str, Any]) -> None:
    assert release["version_of"](CHECKOUT) == symaware_cli.__version__
    release["check_version"](symaware_cli.__version__, [f"v{symaware_cli.__version__}", "nightly"])


def test_a_tag_of_another_version_is_refused(release: dict[str, Any]) -> None:
    with pytest.raises(Exception, match=r"tagged v9\.9\.9"):
        release["check_version"](symaware_cli.__version__, ["v9.9.9"])


def test_the_bill_of_materials_names_each_package_once(release: dict[str, Any]) -> None:
    packages = [
        {"name": "numpy", "version": "2.4.6", "license": "BSD-3-Clause"},
        {"name": "pip", "version": "26.0", "license": "MIT"},
        {"name": "symaware-cli", "version": "0.1.0", "license": "Apache-2.0"},
    ]
    bill = release["bill_of_materials"]("0.1.0", packages)
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.6")
    assert [each["purl"] for each in bill["components"]] == ["pkg:pypi/numpy@2.4.6"]
    assert bill["dependencies"][0]["dependsOn"] == ["pkg:pypi/numpy@2.4.6"]
    assert re.fullmatch(r"urn:uuid:[0-9a-f-]{36}", bill["serialNumber"])
    assert bill == release["bill_of_materials"]("0.1.0", packages)


def test_the_provenance_names_each_file_by_its_digest(release: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "symaware_cli-0.1.0.tar.gz"
    file.write_bytes(b"content")
    statement = release["provenance"]([file], "c" * 40)
    assert statement["subject"] == [{"name": file.name, "digest": {"sha256": hashlib.sha256(b"content").hexdigest()}}]
    assert "c" * 40 in json.dumps(statement["predicate"])
