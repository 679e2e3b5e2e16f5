"""Converts logs to marks, with a module for each kind of content."""
