"""Worlds of physics engines."""
