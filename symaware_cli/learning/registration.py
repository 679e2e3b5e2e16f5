"""Registers the environment of Gymnasium; called when Gymnasium is imported."""

from __future__ import annotations


def register() -> None:
    """Register `symaware/Scenario-v0`; the name space is that of the entry point."""
    from gymnasium.envs.registration import register

    register("Scenario-v0", "symaware_cli.learning.environments:single_env")
