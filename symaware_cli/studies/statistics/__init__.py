"""Statistics of many runs: interval estimates, stopping rules, comparisons of variants, and designs of parameters.

Intervals at a fixed number of runs (`interval_estimate`) are valid for one look, at a number planned beforehand.
Confidence sequences (`confidence_sequence`) are valid at all looks simultaneously, so they may be watched, and a
stopping rule may depend on them.
"""
