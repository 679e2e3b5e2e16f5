"""Controllers that ship with SymAware."""
