"""Passes FOLLOW_TARGET to the flight task. Every vehicle uses the message, which has no target system id."""

from __future__ import annotations

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link


class FollowService:
    """Receives the position of a target from any ground station or beacon."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.handlers = {"FOLLOW_TARGET": self.follow_target}

    def follow_target(self, link: Link, m: Message) -> None:
        """Stores the target's position and velocity."""
        velocity = (m.vel[0], m.vel[1], m.vel[2])
        self._context.autopilot.navigator.follow.receive(m.lat / 1e7, m.lon / 1e7, m.alt, velocity)
