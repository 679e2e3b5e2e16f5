"""From a log to eyes: replays in Rerun, plots, and logs for Foxglove."""
