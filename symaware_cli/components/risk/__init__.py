"""Risk estimators that ship with SymAware."""
