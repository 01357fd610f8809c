"""Offboard missions: connects the runner of `missions/runner` to vehicles and their setpoint streams."""
