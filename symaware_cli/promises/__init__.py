"""Promises: specifications that agents announce to others, which monitor them and rely on them.

Reasons: docs/decisions/0099-promises.md
"""
