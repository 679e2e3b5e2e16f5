"""Tests of plugins compute with the kernels of every processor: `symaware_cli` selects them before NumPy is there."""

import symaware_cli  # noqa: F401
