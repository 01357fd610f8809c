"""Keeps the vehicles of a group apart in flight, whatever the event loop does. Pure."""
