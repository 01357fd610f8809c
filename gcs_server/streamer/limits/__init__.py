"""Keeps what is sent inside the limits of the vehicle and the operator, and inside the fence. Pure."""
