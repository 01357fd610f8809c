"""Hostile parties beside a vehicle in Offboard: real processes, real sockets."""
