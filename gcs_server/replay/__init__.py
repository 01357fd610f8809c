"""Recorded flights: reading them, knowing what is where in them, and playing them."""
