"""The last step, and the only one that knows MAVLink: from a setpoint to a message in the sender's hands."""
