"""A package that adds sections to scenarios."""
