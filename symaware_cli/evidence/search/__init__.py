"""Methods that search for a violation; each is a plugin."""
