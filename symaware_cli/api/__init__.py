"""The Python API: load a scenario, run or step it, and read the results (docs/python.md).

Nothing is imported here, so that importing one module does not load the others.
"""
