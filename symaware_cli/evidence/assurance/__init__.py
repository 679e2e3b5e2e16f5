"""Assurance cases: goals, the arguments for them, and evidence that can be checked again.

Reasons: docs/decisions/0092-assurance-cases.md
"""
