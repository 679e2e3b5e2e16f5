"""Synthesis of strategies from GR(1) specifications over finite transition systems."""
