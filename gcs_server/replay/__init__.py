"""Recorded flights: reads, indexes and plays them."""
