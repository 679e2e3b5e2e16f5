"""The sections of reports in this package."""
