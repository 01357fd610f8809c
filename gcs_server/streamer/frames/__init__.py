"""Converts setpoints that no message can carry (offsets, paths, followed vehicles) into setpoints that can
be sent.
"""
