"""What Python users call: load a scenario, run it or step it, and look at what came of it (docs/python.md).

Nothing is imported here, so that whoever needs one part pays for one part.
"""
