"""Plugins with nothing wrong, for the scenarios that misuse them."""
