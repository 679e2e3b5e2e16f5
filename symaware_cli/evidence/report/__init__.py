"""The report of a log or a sweep as an HTML page."""
