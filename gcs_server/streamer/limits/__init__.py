"""Keeps each sent setpoint within the vehicle's and the operator's limits and inside the fence. No I/O."""
