"""What is drawn in a replay: each module one kind of thing, from chunks of a log."""
