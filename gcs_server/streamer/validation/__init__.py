"""Checks a setpoint before it is accepted: combinations of axes, missing estimates, targets out of bounds."""
