"""The sections of reports that this package has."""
