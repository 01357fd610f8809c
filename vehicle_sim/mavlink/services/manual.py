"""Passes MANUAL_CONTROL to the autopilot's stick input."""

from __future__ import annotations

from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link


class ManualService:
    """Accepts stick input from any ground station. MANUAL_CONTROL has a target system, but no component."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.handlers = {"MANUAL_CONTROL": self.manual_control}

    def manual_control(self, link: Link, m: Message) -> None:
        """Updates the stick input, and notifies the commander and its arming checks."""
        autopilot = self._context.autopilot
        if m.target == self._context.system_id and autopilot.sticks.receive(m.x, m.y, m.z, m.r):
            autopilot.commander.checks.manual_control_at_s = self._context.view.time_s
            autopilot.commander.on_stick_input()
