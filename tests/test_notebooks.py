"""The notebooks of the documentation run, and print what is stored in them."""

import re
import runpy
from pathlib import Path
from typing import Any

import pytest
from checkout import CHECKOUT

FOLDER = CHECKOUT / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))

#: What differs from machine to machine and from run to run.
VOLATILE = (r"\b[\d.]+ m?s\b(?= of wall time)", r"wall time .*", r"0x[0-9a-f]+", r"\b\d+\.\d+\.\d+\b")


def texts(notebook: Any) -> list[list[str]]:
    """What each cell prints and returns, without what differs."""
    found = []
    for cell in notebook.cells:
        parts = [each.get("text") or each.get("data", {}).get("text/plain", "") for each in cell.get("outputs", ())]
        text = "".join(parts)
        for pattern in VOLATILE:
            text = re.sub(pattern, "~", text)
        found.append(text.splitlines())
    return found


def stored(path: Path) -> Any:
    import nbformat

    return nbformat.read(path, as_version=4)


def test_there_are_notebooks() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["first-scenario", "from-sweep-to-certificate"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_small_with_a_figure_and_without_places_of_a_machine(path: Path) -> None:
    notebook = stored(path)
    assert path.stat().st_size < 300_000
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert {output.output_type for output in outputs} <= {"stream", "execute_result", "display_data"}
    assert not any(output.get("name") == "stderr" for output in outputs)
    printed = "\n".join(line for lines in texts(notebook) for line in lines)
    assert not re.search(r"/(home|tmp|root|work|Users)/|wall time", printed)
    links = [each for cell in notebook.cells for each in re.findall(r"\]\(([^)#]+)[^)]*\)", cell.source)]
    missing = [each for each in links if "://" not in each and not (path.parent / each).exists()]
    assert (bool(links), missing) == (True, [])


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("default")  # of the packages that execute notebooks
def test_a_notebook_prints_what_is_stored(path: Path, tmp_path: Path) -> None:
    executed = runpy.run_path(str(FOLDER / "execute.py"))["executed"]
    assert texts(executed(path, tmp_path)) == texts(stored(path)), "python docs/notebooks/execute.py"
