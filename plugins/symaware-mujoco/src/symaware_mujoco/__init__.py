"""A world of rigid bodies for SymAware, moved by MuJoCo."""
