"""Dynamics that ship with SymAware."""
