"""Components that ship with SymAware."""
