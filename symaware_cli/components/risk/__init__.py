"""Built-in risk estimators."""
