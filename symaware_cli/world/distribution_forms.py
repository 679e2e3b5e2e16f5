"""The keys of a distribution in a scenario, in a module of their own because the models take long to import."""

#: The forms of a distribution, of which each has exactly one.
RANDOM = ("uniform", "normal", "lognormal", "loguniform", "exponential", "choice")

#: What may stand beside them.
MODIFIERS = ("weights", "constant", "least", "greatest")
