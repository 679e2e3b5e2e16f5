"""Plots of logs with matplotlib: figures for papers and for quick inspection."""
