"""Obstacle avoidance: changes the wanted motion so that it stays clear of measured obstacles. No I/O."""
