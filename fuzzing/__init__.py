"""Fuzzing: tries made-up input on SymAware by the thousand, and keeps what it stumbles over.

`.ci/fuzz` runs it. A *target* (in `targets/`) makes cases out of random numbers and tries them; `worker` is the process
in which that happens, with bounded memory and time; `campaign` hands out cases, can be stopped and goes on where it
was; `state` is what it remembers. What was found and mended goes into `tests/corpus/<target>/`, which the tests try
again.
"""
