"""Refuses a setpoint before it is taken: combinations of axes, missing estimates, targets out of bounds."""
