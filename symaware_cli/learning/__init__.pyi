# What other rooms use of this one.

# Nothing: environments are reached as `symaware_cli.env`, and the section by its entry point.
