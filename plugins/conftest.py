"""Tests of plugins compute with the kernels of every processor: `symaware_cli` selects them before NumPy is there."""

import sys
from pathlib import Path

import symaware_cli  # noqa: F401

# Plugins' tests run commands within their process, as those of the core do: by `simulating`, which is among those.
sys.path.append(str(Path(__file__).parents[1] / "tests"))
