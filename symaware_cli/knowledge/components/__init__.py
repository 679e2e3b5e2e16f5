"""Components that follow strategies over knowledge models."""
