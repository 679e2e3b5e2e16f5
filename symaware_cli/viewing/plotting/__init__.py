"""Plots of a log: figures for papers and for a quick look."""
