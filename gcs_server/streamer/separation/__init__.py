"""Keeps the vehicles of a group apart in flight, even if the event loop stalls. No I/O."""
