"""Fuzzing: runs SymAware on thousands of generated inputs, and keeps those that fail.

`.ci/fuzz` runs it. A *target* (in `targets/`) generates cases from random numbers and runs them; `worker` is the
process that does so, with bounded memory and time; `campaign` distributes cases, and can be stopped and continued;
`state` is its progress and findings. Cases that were found and fixed are kept in `tests/corpus/<target>/`, which the
tests run.
"""
