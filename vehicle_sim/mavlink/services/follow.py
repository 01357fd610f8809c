"""Passes FOLLOW_TARGET to the flight task; the message has no target system id, so every vehicle uses it."""

from __future__ import annotations

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link


class FollowService:
    """Receives the position of a target from any ground station or beacon."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.handlers = {"FOLLOW_TARGET": self.target}

    def target(self, link: Link, m: Message) -> None:
        """Stores the target's position and velocity."""
        velocity = (m.vel[0], m.vel[1], m.vel[2])
        self._context.autopilot.navigator.follow.receive(m.lat / 1e7, m.lon / 1e7, m.alt, velocity)
