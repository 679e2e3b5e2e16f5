"""An example package of plugins for SymAware."""
