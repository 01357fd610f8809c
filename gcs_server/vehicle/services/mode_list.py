"""Names of the external modes that other programs have registered with PX4, received over MAVLink.

PX4 sends the list of its modes (AVAILABLE_MODES) on request. The server requests it when the list changes,
and when the vehicle enters an external mode that this server has not registered.
"""

from __future__ import annotations

from typing import Final

from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.px4.modes import BY_CUSTOM_MODE, MODES
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Request

ATTEMPTS: Final = 4
ATTEMPT_EVERY_S: Final = 2.0
"""Period of requests [s]. PX4 sends 25 messages within a second; a slow or lossy link may lose some."""
EXTERNAL: Final = frozenset(mode.name for mode in MODES if mode.name.startswith("external_"))
_modes = d.MAVLink_available_modes_message.unpacker


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
            self._start_requesting()

    def take(self, payload: bytes) -> None:
        """Handles AVAILABLE_MODES, one entry of the list."""
        custom_mode, properties, _, _, _, text = _modes.unpack(payload)
        mode = BY_CUSTOM_MODE.get(custom_mode)
        if mode is None:
            return
        if properties & d.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE:
            self._vehicle.mode_names.selectable.discard(mode.name)
        else:
            self._vehicle.mode_names.selectable.add(mode.name)
        if mode.name not in EXTERNAL:
            return
        self._missing.discard(mode.name)
        decoded = text.split(b"\0", 1)[0].decode("utf-8", "replace")
        name = "".join(each for each in decoded if each.isprintable()).strip()
        is_registered = name and not properties & d.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
        names = self._vehicle.mode_names.announced
        if is_registered:
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
        identity = self._vehicle.identity
        request = Request(
            d.MAV_CMD_REQUEST_MESSAGE, (float(d.MAVLINK_MSG_ID_AVAILABLE_MODES), 0, 0, 0, 0, 0, 0)
        )
        self._vehicle.send(request.message(identity.system_id, identity.component_id, 0, False))

    def _start_requesting(self) -> None:
        self._missing, self._attempts, self._next_s = set(EXTERNAL), 0, 0.0
