"""Built-in dynamical models."""
