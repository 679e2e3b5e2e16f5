"""Search methods for violations; each is a plugin."""
