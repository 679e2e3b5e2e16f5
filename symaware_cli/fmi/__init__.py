"""Functional mock-up units (FMI 2 and 3, co-simulation) as models of agents.

Reasons: docs/decisions/0094-fmi.md
"""
