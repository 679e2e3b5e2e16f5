"""Builds the one module of the package."""

import tempfile

import numpy
from Cython.Build import cythonize
from setuptools import Extension, setup

MODULE = Extension(
    "symaware_compiled",
    ["src/symaware_compiled.pyx"],
    include_dirs=[numpy.get_include()],
    define_macros=[("NPY_NO_DEPRECATED_API", "NPY_2_0_API_VERSION")],
    # No sum of a product may be rounded once instead of twice, or bits would differ from NumPy's.
    extra_compile_args=["-O3", "-ffp-contract=off"],
)

# What is written in C depends on the version of NumPy: none of another build may be left over.
with tempfile.TemporaryDirectory() as folder:
    setup(ext_modules=cythonize([MODULE], build_dir=folder))
