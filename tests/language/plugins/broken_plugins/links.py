"""Topologies that fail."""

from __future__ import annotations

import numpy as np

from symaware_cli import Environment, Links, Topology


class Stray(Topology):
    """Links that lead to an agent that does not exist."""

    def links(self, now: int) -> Links:
        """From the first agent."""
        return Links.of(len(self.roster), np.array([0]), np.array([7]))


class Unlaid(Topology):
    """One that cannot even begin."""

    def initialise(self, environment: Environment, seed: int) -> None:
        """Fail."""
        super().initialise(environment, seed)
        raise IndexError("list index out of range")

    def links(self, now: int) -> Links:
        """Never comes to be asked for."""
        raise NotImplementedError


class ShortLived(Topology):
    """One that fails in the middle of a run."""

    changes = True

    def links(self, now: int) -> Links:
        """None, for half a second."""
        if now >= 500_000_000:
            raise RuntimeError("no more")
        return Links.of(len(self.roster), np.empty(0, int), np.empty(0, int))


class Baseless(Topology):
    """One that does not let its base initialise."""

    def initialise(self, environment: Environment, seed: int) -> None:
        """Nothing."""

    def links(self, now: int) -> Links:
        """None."""
        return Links.of(0, np.empty(0, int), np.empty(0, int))
