"""Scenario files: reading, composing and validating them, and building simulations from them."""
