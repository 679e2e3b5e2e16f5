"""Explanations of violations: which wrong belief, made true, would have prevented them.

Reasons: docs/decisions/0090-explanations.md
"""
