"""Obstacle avoidance: from measured distances and the motion that is wanted to one that is free. Pure."""
