"""The risk of failing a specification."""
