"""The vehicle's own list of its modes, with the names of the external modes that other programs have
registered with PX4, received over MAVLink.

PX4 sends the list (AVAILABLE_MODES) on request. The server requests it when the list changes, when the
vehicle enters an external mode that this server has not registered, and when a client asks for the list.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from gcs_server.errors import Disconnected
from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.px4.modes import BY_CUSTOM_MODE, MODES
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Request

ATTEMPTS: Final = 4
ATTEMPT_EVERY_S: Final = 2.0
"""Period of requests [s]. PX4 sends 25 messages within a second; a slow or lossy link may lose some."""
READ_DEADLINE_S: Final = 4.0
READ_RESEND_S: Final = 0.4
SILENT_FOR_S: Final = 60.0
"""Time for which a vehicle that sent no entry is not asked again [s]: PX4 before v1.15 has no list."""
MAX_SINGLE_REQUESTS: Final = 8
"""With more entries missing, the whole list is requested."""
EXTERNAL: Final = frozenset(mode.name for mode in MODES if mode.name.startswith("external_"))
_modes = d.MAVLink_available_modes_message.unpacker


@dataclass(frozen=True, slots=True)
class AnnouncedMode:
    """One entry of the vehicle's list."""

    custom_mode: int
    name: str
    """The vehicle's name of the mode; may be empty."""
    selectable: bool
    """Whether the vehicle lets a person select the mode."""


class ModeList:
    """The list of one vehicle's modes.

    Args:
        vehicle: the vehicle; the names are set in its `mode_names`.
    """

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self._sequence: int | None = None
        """Number of changes of the list, as last reported."""
        self._missing: set[str] = set()
        """External modes whose entry is requested and has not arrived."""
        self._attempts, self._next_s = 0, 0.0
        self._entries: dict[int, AnnouncedMode] = {}
        """By index, from 1."""
        self._count: int | None = None
        """Number of entries of the list; None: no entry has arrived."""
        self._silent_until_s = float("-inf")

    @property
    def entries(self) -> tuple[AnnouncedMode, ...]:
        """The complete list in the vehicle's order; empty: unknown, or not complete."""
        if self._missing_entries() or self._count is None:
            return ()
        return tuple(self._entries[index] for index in sorted(self._entries))

    async def read(self) -> tuple[AnnouncedMode, ...]:
        """The list, for which the vehicle is asked unless it is known; empty: the vehicle sends none."""
        vehicle = self._vehicle
        start_s = vehicle.clock.monotonic_s()
        is_asked = vehicle.identity.commandable and not vehicle.status.link_lost
        if self.entries or not is_asked or start_s < self._silent_until_s:
            return self.entries
        with suppress(Disconnected), vehicle.mailbox.expect(d.MAVLINK_MSG_ID_AVAILABLE_MODES) as waiter:
            while not self.entries and vehicle.clock.monotonic_s() < start_s + READ_DEADLINE_S:
                missing = self._missing_entries()
                for index in missing if 0 < len(missing) <= MAX_SINGLE_REQUESTS else (0,):
                    self._request(index)
                with suppress(TimeoutError):
                    async with asyncio.timeout(READ_RESEND_S):
                        while not self.entries:
                            await waiter.next()
        if self._count is None:
            self._silent_until_s = vehicle.clock.monotonic_s() + SILENT_FOR_S
        return self.entries

    def _missing_entries(self) -> tuple[int, ...]:
        indices = range(1, (self._count or 0) + 1)
        return tuple(index for index in indices if index not in self._entries)

    def entered(self, before: FlightState, after: FlightState) -> None:
        """Requests the list if the vehicle has entered an external mode of another program."""
        mode = BY_CUSTOM_MODE.get(after.custom_mode)
        if (
            after.custom_mode == before.custom_mode
            or mode is None
            or not self._vehicle.identity.software.supported
        ):
            return
        if mode.name in EXTERNAL and mode.name not in self._vehicle.mode_names.external:
            self._start_requesting()

    def changed(self, payload: bytes) -> None:
        """Handles AVAILABLE_MODES_MONITOR: requests the list if it has changed."""
        previous_sequence, self._sequence = self._sequence, payload[0]
        if previous_sequence not in (None, self._sequence):
            self._entries, self._count, self._silent_until_s = {}, None, float("-inf")
            self._start_requesting()

    def take(self, payload: bytes) -> None:
        """Handles AVAILABLE_MODES, one entry of the list."""
        custom_mode, properties, count, index, _, text = _modes.unpack(payload)
        decoded = text.split(b"\0", 1)[0].decode("utf-8", "replace")
        name = "".join(each for each in decoded if each.isprintable()).strip()
        is_selectable = not properties & d.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
        if count != self._count:
            self._entries, self._count = {}, count
        if 1 <= index <= count:
            self._entries[index] = AnnouncedMode(custom_mode, name, is_selectable)
        mode = BY_CUSTOM_MODE.get(custom_mode)
        if mode is None:
            return
        if not is_selectable:
            self._vehicle.mode_names.selectable.discard(mode.name)
        else:
            self._vehicle.mode_names.selectable.add(mode.name)
        if mode.name not in EXTERNAL:
            return
        self._missing.discard(mode.name)
        names = self._vehicle.mode_names.announced
        if name and is_selectable:
            names[mode.name] = name
        else:
            names.pop(mode.name, None)

    def tick(self) -> None:
        """Requests the list again if entries are missing; called four times a second."""
        if not self._missing:
            return
        now_s = self._vehicle.clock.monotonic_s()
        if now_s < self._next_s or self._vehicle.status.link_lost:
            return
        if self._attempts >= ATTEMPTS:
            self._missing.clear()  # this vehicle sends no list
            return
        self._attempts, self._next_s = self._attempts + 1, now_s + ATTEMPT_EVERY_S
        self._request(0)

    def _request(self, index: int) -> None:
        """Requests one entry; with 0, the whole list."""
        identity = self._vehicle.identity
        params = (float(d.MAVLINK_MSG_ID_AVAILABLE_MODES), float(index), 0, 0, 0, 0, 0)
        request = Request(d.MAV_CMD_REQUEST_MESSAGE, params)
        self._vehicle.send(request.message(identity.system_id, identity.component_id, 0, False))

    def _start_requesting(self) -> None:
        self._missing, self._attempts, self._next_s = set(EXTERNAL), 0, 0.0
