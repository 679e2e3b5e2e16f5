"""Explanations of violations: the beliefs, messages and faults that caused them.

Reasons: docs/decisions/0090-explanations.md
"""
