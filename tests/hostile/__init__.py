"""Attacks by hostile clients and vehicles while another vehicle flies in Offboard: real processes and
sockets."""
