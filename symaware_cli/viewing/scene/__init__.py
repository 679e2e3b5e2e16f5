"""From a log to marks: what is to be seen, one kind of thing in each module."""
