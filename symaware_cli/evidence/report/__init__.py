"""The report of a log or of a sweep as a page of HTML."""
