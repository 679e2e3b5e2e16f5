"""Transports: what carries frames between the processes of one run."""
