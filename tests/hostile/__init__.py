"""Somebody hostile beside a vehicle in Offboard: real processes, real bytes."""
