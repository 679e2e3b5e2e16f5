"""Worlds that ship with SymAware."""
