"""Reports mode changes that the commander refuses."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.autopilot.modes import MODES, NavState, event_number
from vehicle_sim.vehicle_view import VehicleView

REPORT_EVERY_S = 1.0
"""Minimum interval between two reports."""


class ModeRefusals:
    """Reports the refused mode changes of one vehicle."""

    def __init__(self, view: VehicleView, announcer: Announcer) -> None:
        self._view, self._announcer = view, announcer
        self._reported_at_s = -math.inf

    def report(self, mode: NavState) -> None:
        """Reports that a mode is not available; does nothing within REPORT_EVERY_S of the last report."""
        now_s = self._view.time_s
        if now_s - self._reported_at_s <= REPORT_EVERY_S:
            return
        self._reported_at_s = now_s
        self._announcer.announce(
            2, f"Switching to {MODES[mode].name} is currently not available",
            "commander_modeswitch_not_avail", "IB",
            MODES[mode].custom_mode, event_number(mode),
        )  # fmt: skip
