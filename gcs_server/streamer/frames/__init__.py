"""Turns a setpoint of any kind into one that is sent as it is: offsets, paths, followed vehicles."""
