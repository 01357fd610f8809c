"""Resolves setpoints that no message carries (offsets, paths, followed vehicles) into ones that can be
sent."""
