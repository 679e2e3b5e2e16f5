"""Cannot be imported, because what it imports is too old."""

raise ImportError("needs version 3 of something")
