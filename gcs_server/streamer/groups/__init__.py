"""Several vehicles that start together, are checked together and are stopped in one call."""
