"""What agents are aware of, of themselves and of others, in columns; and what they know."""
