"""The words by which a distribution is told from other values, apart from the models, which take long to import."""

#: The forms of a distribution, of which each has exactly one.
RANDOM = ("uniform", "normal", "lognormal", "loguniform", "exponential", "choice")

#: What may stand beside them.
MODIFIERS = ("weights", "constant", "least", "greatest")
