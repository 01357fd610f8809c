"""The last step, and the only one that knows MAVLink: packs a setpoint and hands the message to the
sender."""
