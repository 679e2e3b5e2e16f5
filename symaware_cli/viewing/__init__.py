"""Visualisation of logs: replays in Rerun, plots with matplotlib, and MCAP files for Foxglove."""
