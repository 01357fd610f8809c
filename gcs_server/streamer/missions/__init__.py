"""Offboard missions: the runner of `missions/runner` on the server's vehicles and setpoint streams."""
