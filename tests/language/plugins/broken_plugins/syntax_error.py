"""Cannot be compiled; written so that linters can read this file."""

compile("def watcher(:\n", __file__, "exec")
