"""AVAILABLE_MODES_MONITOR: notifies ground stations of changes to the list of modes."""

from __future__ import annotations

from vehicle_sim.mavlink.context import Context

INTERVAL_S = 3.33
"""PX4 streams the message at 0.3 Hz after the list of modes has changed once."""
SEQ_MODULUS = 256


class ModesMonitor:
    """Sends AVAILABLE_MODES_MONITOR at the first change, and then periodically."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._external = context.autopilot.commander.external
        self._started = False
        self._external.on_mode_list_change = self._start

    def _start(self) -> None:
        if not self._started:
            self._started = True
            self._send()

    def _send(self) -> None:
        self._context.broadcast("AVAILABLE_MODES_MONITOR", seq=self._external.mode_list_seq % SEQ_MODULUS)
        self._context.call_later(INTERVAL_S, self._send)
