"""Expressions and formulas about a run, and the monitors that evaluate them."""
