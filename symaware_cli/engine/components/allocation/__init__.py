"""Components that distribute specifications which are offered while a run goes on."""
