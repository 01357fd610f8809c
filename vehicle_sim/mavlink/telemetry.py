"""Payloads of all telemetry messages, built from the vehicle's state.

A payload is built at most once per step and shared by all links. The builders are in `messages/`.
"""

from __future__ import annotations

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.mavlink.dialect import LAYOUTS, Layout
from vehicle_sim.mavlink.messages.gimbal import GimbalMessages
from vehicle_sim.mavlink.messages.message_group import Builder, MessageGroup
from vehicle_sim.mavlink.messages.motion import MotionMessages
from vehicle_sim.mavlink.messages.navigation import NavigationMessages
from vehicle_sim.mavlink.messages.sensors import SensorMessages
from vehicle_sim.mavlink.messages.state import StateMessages

MESSAGE_GROUPS: tuple[type[MessageGroup], ...] = (
    StateMessages,
    MotionMessages,
    SensorMessages,
    NavigationMessages,
    GimbalMessages,
)


class Telemetry:
    """Telemetry payloads of one vehicle."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._simulation = autopilot.view.simulation
        self._cache: dict[int, tuple[Layout, bytes] | None] = {}
        self._cached_step = -1
        self._builders: dict[int, Builder] = {}
        for group in MESSAGE_GROUPS:
            self._builders |= group(autopilot).builders()

    @property
    def ids(self) -> frozenset[int]:
        """Ids of the messages that can be built."""
        return frozenset(self._builders)

    def payload(self, msg_id: int) -> tuple[Layout, bytes] | None:
        """Layout and current payload of a message; None: no data."""
        step = self._simulation.steps
        if step != self._cached_step:
            self._cache.clear()
            self._cached_step = step
        elif msg_id in self._cache:
            return self._cache[msg_id]
        builder = self._builders.get(msg_id)
        payload = builder() if builder else None
        layout_and_payload = None if payload is None else (LAYOUTS[msg_id], payload)
        self._cache[msg_id] = layout_and_payload
        return layout_and_payload
