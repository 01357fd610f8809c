"""The camera protocol (version 2) of the vehicle's camera, a component with a separate heartbeat."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from vehicle_sim.autopilot.own_commands import OwnCommand
from vehicle_sim.commands.command import (
    ACCEPTED,
    DENIED,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
)
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import BY_NAME, Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.payload.camera import (
    CAPACITY_BYTES,
    FOCAL_LENGTH_MM,
    SENSOR_HEIGHT_MM,
    SENSOR_WIDTH_MM,
    Camera,
    CameraMode,
    Capture,
)
from vehicle_sim.payload.picture import HEIGHT, WIDTH

CAMERA_COMPONENT = 100
"""MAV_COMP_ID_CAMERA."""
MAV_TYPE_CAMERA, MAV_AUTOPILOT_INVALID, MAV_STATE_ACTIVE = 30, 8, 4
CAPTURE_IMAGE, HAS_MODES, HAS_IMAGE_SURVEY_MODE, HAS_BASIC_ZOOM = 2, 4, 32, 64
"""CAMERA_CAP_FLAGS; the camera records and streams no video."""
ZOOM_STEP, ZOOM_RANGE = 0, 2
"""CAMERA_ZOOM_TYPE."""
ZOOM_STEP_PERCENT = 10.0
STORAGE_READY, STORAGE_MICROSD, STORAGE_USAGE = 2, 3, 3
MIB = 1024.0**2
UNKNOWN_INT32 = 0x7FFFFFFF
VENDOR, MODEL = b"Simulated", b"Simulated camera"
FIRMWARE_VERSION = 1
REQUEST_MESSAGE, REQUEST_CAMERA_INFORMATION, REQUEST_CAMERA_SETTINGS = 512, 521, 522
REQUEST_STORAGE_INFORMATION, STORAGE_FORMAT, REQUEST_CAMERA_CAPTURE_STATUS = 525, 526, 527
RESET_CAMERA_SETTINGS, SET_CAMERA_MODE, SET_CAMERA_ZOOM = 529, 530, 531
IMAGE_START_CAPTURE, IMAGE_STOP_CAPTURE, REQUEST_CAMERA_IMAGE_CAPTURE = 2000, 2001, 2002
"""MAV_CMD."""


class CameraService:
    """Handles commands to component 100 or to all components, and sends the camera's messages."""

    def __init__(self, context: Context, camera: Camera) -> None:
        self._context, self._camera = context, camera
        self._last_capture_sequence = 0
        self._commands: dict[int, Callable[[Message | _AutopilotParameters, Link | None], int]] = {
            REQUEST_MESSAGE: lambda m, link: self._send_requested(m, link),
            REQUEST_CAMERA_INFORMATION: lambda m, link: self._send("CAMERA_INFORMATION", link),
            REQUEST_CAMERA_SETTINGS: lambda m, link: self._send("CAMERA_SETTINGS", link),
            REQUEST_STORAGE_INFORMATION: lambda m, link: self._send("STORAGE_INFORMATION", link),
            STORAGE_FORMAT: self._format_storage,
            REQUEST_CAMERA_CAPTURE_STATUS: lambda m, link: self._send("CAMERA_CAPTURE_STATUS", link),
            RESET_CAMERA_SETTINGS: self._reset_settings,
            SET_CAMERA_MODE: self._set_mode,
            SET_CAMERA_ZOOM: self._set_zoom,
            IMAGE_START_CAPTURE: self._start_capture,
            IMAGE_STOP_CAPTURE: self._stop_capture,
            REQUEST_CAMERA_IMAGE_CAPTURE: lambda m, link: self._resend_capture(m.param1, link),
        }
        self._messages: dict[str, Callable[[], dict[str, Any]]] = {
            "CAMERA_INFORMATION": self._information_fields,
            "CAMERA_SETTINGS": self._settings_fields,
            "STORAGE_INFORMATION": self._storage_fields,
            "CAMERA_CAPTURE_STATUS": self._capture_status_fields,
            "CAMERA_FOV_STATUS": self._field_of_view_fields,
        }
        self._message_names = {BY_NAME[name].id: name for name in self._messages}
        context.autopilot.own_commands.add_listener(self._run_autopilot_command)

    # --- received messages -----------------------------------------------------------------------------

    def receive(self, link: Link, m: Message) -> None:
        """Handles a message if it is a command to the camera."""
        if m.name not in ("COMMAND_LONG", "COMMAND_INT"):
            return
        values = m.values
        if values["target_system"] != self._context.system_id:
            return
        handler = self._commands.get(m.command)
        if values["target_component"] == CAMERA_COMPONENT:
            result = UNSUPPORTED if handler is None else handler(m, link)
        elif values["target_component"] == 0 and handler is not None and m.command != REQUEST_MESSAGE:
            result = handler(m, link)
        else:
            return
        link.send_from(
            CAMERA_COMPONENT, "COMMAND_ACK", command=m.command, result=result,
            target_system=m.system_id, target_component=m.component_id,
        )  # fmt: skip

    def is_only_recipient(self, m: Message) -> bool:
        """Whether a message is for the camera only, so that it is not forwarded."""
        values = m.values
        return (
            values.get("target_system") == self._context.system_id
            and values.get("target_component") == CAMERA_COMPONENT
        )

    def send_heartbeat(self, link: Link) -> None:
        """Sends the camera's heartbeat."""
        link.send_from(
            CAMERA_COMPONENT, "HEARTBEAT", type=MAV_TYPE_CAMERA, autopilot=MAV_AUTOPILOT_INVALID,
            system_status=MAV_STATE_ACTIVE, mavlink_version=3,
        )  # fmt: skip

    def step(self) -> None:
        """Takes the pictures that are due."""
        if self._camera.sequence_runs:
            capture = self._camera.step()
            if capture is not None:
                self._broadcast("CAMERA_IMAGE_CAPTURED", **self._captured_fields(capture))
                self._broadcast("CAMERA_CAPTURE_STATUS", **self._capture_status_fields())

    def _run_autopilot_command(self, command: OwnCommand) -> None:
        """Executes a camera command of the autopilot, for example from a mission."""
        handler = self._commands.get(command.number)
        if handler is not None and command.number != REQUEST_MESSAGE:
            handler(_AutopilotParameters(*command.parameters), None)

    # --- commands --------------------------------------------------------------------------------------

    def _send_requested(self, m: Message | _AutopilotParameters, link: Link | None) -> int:
        number = _to_int(m.param1)
        if number == BY_NAME["CAMERA_IMAGE_CAPTURED"].id:
            return self._resend_capture(m.param2, link)
        name = self._message_names.get(number)
        return DENIED if name is None else self._send(name, link)

    def _send(self, name: str, link: Link | None) -> int:
        if link is not None:
            link.send_from(CAMERA_COMPONENT, name, **self._messages[name]())
        return ACCEPTED

    def _resend_capture(self, index: float, link: Link | None) -> int:
        number = _to_int(index)
        if not 0 <= number < len(self._camera.captures) or link is None:
            return DENIED
        link.send_from(
            CAMERA_COMPONENT, "CAMERA_IMAGE_CAPTURED", **self._captured_fields(self._camera.captures[number])
        )
        return ACCEPTED

    def _start_capture(self, m: Message | _AutopilotParameters, link: Link | None) -> int:
        interval, count, sequence = m.param2, _to_int(m.param3), _to_int(m.param4)
        if count < 0 or (count != 1 and not (math.isfinite(interval) and interval > 0.0)):
            return DENIED
        if count == 1 and sequence > 0 and sequence == self._last_capture_sequence:
            return ACCEPTED
        if self._camera.sequence_runs or not self._camera.free_bytes:
            return TEMPORARILY_REJECTED
        self._last_capture_sequence = sequence if count == 1 else 0
        self._camera.start(interval if count != 1 else 0.0, count)
        return ACCEPTED

    def _stop_capture(self, m: Message | _AutopilotParameters, link: Link | None) -> int:
        self._camera.stop()
        self._broadcast("CAMERA_CAPTURE_STATUS", **self._capture_status_fields())
        return ACCEPTED

    def _set_mode(self, m: Message | _AutopilotParameters, link: Link | None) -> int:
        try:
            self._camera.mode = CameraMode(_to_int(m.param2))
        except ValueError:
            return UNSUPPORTED
        self._broadcast("CAMERA_SETTINGS", **self._settings_fields())
        return ACCEPTED

    def _set_zoom(self, m: Message | _AutopilotParameters, link: Link | None) -> int:
        zoom_type, value = _to_int(m.param1), m.param2
        if zoom_type not in (ZOOM_STEP, ZOOM_RANGE):
            return UNSUPPORTED
        if not math.isfinite(value) or (zoom_type == ZOOM_RANGE and not 0.0 <= value <= 100.0):
            return DENIED
        percent = value if zoom_type == ZOOM_RANGE else self._camera.zoom_percent + ZOOM_STEP_PERCENT * value
        self._camera.zoom_percent = max(0.0, min(100.0, percent))
        self._broadcast("CAMERA_SETTINGS", **self._settings_fields())
        return ACCEPTED

    def _format_storage(self, m: Message | _AutopilotParameters, link: Link | None) -> int:
        if _to_int(m.param2) != 1 or _to_int(m.param1) not in (0, 1):
            return DENIED
        if self._camera.sequence_runs:
            return TEMPORARILY_REJECTED
        self._camera.format_storage()
        self._broadcast("STORAGE_INFORMATION", **self._storage_fields())
        return ACCEPTED

    def _reset_settings(self, m: Message | _AutopilotParameters, link: Link | None) -> int:
        if _to_int(m.param1) != 1:
            return DENIED
        self._camera.reset_settings()
        self._broadcast("CAMERA_SETTINGS", **self._settings_fields())
        return ACCEPTED

    # --- sent messages ---------------------------------------------------------------------------------

    def _broadcast(self, name: str, /, **fields: Any) -> None:
        for link in self._context.links:
            link.send_from(CAMERA_COMPONENT, name, **fields)

    def _information_fields(self) -> dict[str, Any]:
        return {
            "time_boot_ms": self._context.view.time_boot_ms(),
            "vendor_name": list(VENDOR), "model_name": list(MODEL), "firmware_version": FIRMWARE_VERSION,
            "focal_length": FOCAL_LENGTH_MM, "sensor_size_h": SENSOR_WIDTH_MM,
            "sensor_size_v": SENSOR_HEIGHT_MM, "resolution_h": WIDTH, "resolution_v": HEIGHT,
            "flags": CAPTURE_IMAGE | HAS_MODES | HAS_IMAGE_SURVEY_MODE | HAS_BASIC_ZOOM,
            "gimbal_device_id": self._context.autopilot.gimbal.device_id,
        }  # fmt: skip

    def _settings_fields(self) -> dict[str, Any]:
        camera = self._camera
        return {
            "time_boot_ms": self._context.view.time_boot_ms(), "mode_id": int(camera.mode),
            "zoomLevel": camera.zoom_percent, "focusLevel": math.nan,
        }  # fmt: skip

    def _storage_fields(self) -> dict[str, Any]:
        camera = self._camera
        return {
            "time_boot_ms": self._context.view.time_boot_ms(), "storage_id": 1, "storage_count": 1,
            "status": STORAGE_READY, "type": STORAGE_MICROSD, "storage_usage": STORAGE_USAGE,
            "total_capacity": CAPACITY_BYTES / MIB, "used_capacity": camera.used_bytes / MIB,
            "available_capacity": camera.free_bytes / MIB,
        }  # fmt: skip

    def _capture_status_fields(self) -> dict[str, Any]:
        camera = self._camera
        return {
            "time_boot_ms": self._context.view.time_boot_ms(),
            "image_status": (2 if camera.interval_s > 0.0 else 1) if camera.sequence_runs else 0,
            "image_interval": camera.interval_s, "image_count": len(camera.captures),
            "available_capacity": camera.free_bytes / MIB,
        }  # fmt: skip

    def _field_of_view_fields(self) -> dict[str, Any]:
        camera = self._camera
        lat, lon, alt = _position_or_unknown(camera)
        return {
            "time_boot_ms": self._context.view.time_boot_ms(),
            "lat_camera": lat, "lon_camera": lon, "alt_camera": alt, "q": camera.orientation(),
            "lat_image": UNKNOWN_INT32, "lon_image": UNKNOWN_INT32, "alt_image": UNKNOWN_INT32,
            "hfov": math.degrees(camera.hfov_rad), "vfov": math.degrees(camera.vfov_rad),
        }  # fmt: skip

    def _captured_fields(self, capture: Capture) -> dict[str, Any]:
        position = capture.position
        return {
            "time_boot_ms": capture.time_boot_ms, "time_utc": capture.time_utc_us, "camera_id": 0,
            "lat": UNKNOWN_INT32 if position is None else round(position.lat_deg * 1e7),
            "lon": UNKNOWN_INT32 if position is None else round(position.lon_deg * 1e7),
            "alt": UNKNOWN_INT32 if position is None else round(position.alt_amsl_m * 1000),
            "relative_alt": round(capture.alt_home_m * 1000) if math.isfinite(capture.alt_home_m) else 0,
            "q": capture.q_ned_camera, "image_index": capture.index,
            "capture_result": 1 if capture.path else 0,
            # The autopilot's FTP server serves the files.
            "file_url": f"mftp://[;comp=1]{capture.path}" if capture.path else "",
        }  # fmt: skip


class _AutopilotParameters:
    """Parameters of a command from the autopilot itself."""

    def __init__(self, *parameters: float) -> None:
        self.param1, self.param2, self.param3, self.param4 = parameters[:4]


def _position_or_unknown(camera: Camera) -> tuple[int, int, int]:
    """Latitude, longitude [1e-7 deg], altitude AMSL [mm]."""
    position = camera.position()
    if position is None:
        return UNKNOWN_INT32, UNKNOWN_INT32, UNKNOWN_INT32
    return round(position.lat_deg * 1e7), round(position.lon_deg * 1e7), round(position.alt_amsl_m * 1000)


def _to_int(value: float) -> int:
    return int(value) if math.isfinite(value) else -1
