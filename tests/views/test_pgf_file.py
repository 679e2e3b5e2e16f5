"""A figure is written as PGF without a TeX engine, with its words as LaTeX prints them."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from symaware_cli.log import LogError
from symaware_cli.views.plotting.figure_style import settle, styled
from symaware_cli.views.plotting.pgf_file import save_pgf


def written(folder: Path, words: str) -> str:
    with styled():
        figure = Figure(figsize=(3.5, 2.0), layout="constrained")
        axes = figure.add_subplot()
        axes.plot([-1.0, 1.0], [0.0, 1.0], rasterized=True)
        axes.barh(0.5, 1.0, hatch="///")
        axes.set_title(words)
        settle(figure)
        save_pgf(figure, folder / "figure.pgf")
    return (folder / "figure.pgf").read_text()


def test_it_is_a_picture_of_the_size_of_the_figure_and_needs_no_engine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert not any(map(shutil.which, ("xelatex", "lualatex", "pdflatex")))
    text = written(tmp_path, "risk")
    assert "\\pgfpathrectangle{\\pgfpointorigin}{\\pgfqpoint{3.500000in}{2.000000in}}%" in text
    assert text.count("\\begin{pgfpicture}") == text.count("\\end{pgfpicture}") == 1
    assert text.count("\\begin{pgfscope}") == text.count("\\end{pgfscope}") > 4
    assert text == written(tmp_path, "risk")
    assert list(tmp_path.iterdir()) == [tmp_path / "figure.pgf"]


@pytest.mark.parametrize(
    ("words", "printed"),
    [
        ("time_to_goal", r"time\_to\_goal"),
        ("50 % of $x & {y} #1", r"50 \% of \$x \& \{y\} \#1"),
        (r"a\b ~ ^ < >", r"a\textbackslash{}b \textasciitilde{} \textasciicircum{} \textless{} \textgreater{}"),
        (
            "● 2 × −inf ≤ ∞",
            r"\textbullet{} 2 \ensuremath{\times} \ensuremath{-}inf \ensuremath{\le} \ensuremath{\infty}",
        ),
    ],
)
def test_words_are_printed_as_they_are(words: str, printed: str, tmp_path: Path) -> None:
    assert f"{printed}}}}}%\n" in written(tmp_path, words)


def test_words_have_the_font_of_the_document(tmp_path: Path) -> None:
    text = written(tmp_path, "risk")
    assert "\\fontfamily{\\familydefault}\\fontsize{11.000000}{13.200000}" in text
    assert "DejaVu" not in text


def test_a_picture_of_pixels_cannot_be_written(tmp_path: Path) -> None:
    figure = Figure()
    figure.add_subplot().imshow(np.eye(2))
    with pytest.raises(LogError, match=r"which \.pgf cannot hold; write a \.pdf"):
        save_pgf(figure, tmp_path / "figure.pgf")
