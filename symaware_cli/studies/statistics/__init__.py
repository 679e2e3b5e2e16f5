"""What many runs show: interval estimates, stopping rules, comparisons of variants, and designs of parameters.

Intervals at a fixed number of runs (`interval_estimate`) hold for one look, at a number that was planned beforehand.
Confidence sequences (`confidence_sequence`) hold at all looks together, so they may be watched, and a stopping rule may
depend on them.
"""
