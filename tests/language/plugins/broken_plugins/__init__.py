"""Packages that fail in every way a plugin can."""
