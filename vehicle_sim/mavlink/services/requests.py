"""REQUEST_MESSAGE, message intervals, and the messages that are sent only on request."""

from __future__ import annotations

import math
from collections.abc import Callable

from vehicle_sim.autopilot.modes import Mode, listed_modes
from vehicle_sim.commands.command import ACCEPTED, DENIED, FAILED, Command
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import BY_NAME, LAYOUTS
from vehicle_sim.mavlink.link import FIXED_INTERVAL, Link
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.storage.metadata import GENERAL, general_crc

REQUEST_MESSAGE, SET_INTERVAL, GET_INTERVAL = 512, 511, 510
REQUEST_CAPABILITIES, REQUEST_PROTOCOL_VERSION, REQUEST_FLIGHT_INFORMATION = 520, 519, 528
REQUEST_CAMERA_INFORMATION, REQUEST_STORAGE_INFORMATION = 521, 525
STORAGE_READY, STORAGE_SIZE_MIB = 2, 32_768.0
"""Status and size of the simulated SD card, which stays empty."""
MAG_CAL_SUCCESS = 4
NOT_USER_SELECTABLE = 2
"""MAV_MODE_PROPERTY."""
ODID_SERIAL_NUMBER, ODID_MULTIROTOR = 1, 2
CAPABILITIES = 321791
UID = 0x4954_414C_4449_4E4F
"""Uid that every PX4 build for Linux reports; all simulated vehicles have this uid."""
MIN_INTERVAL_US = 4000
EMPTY_STREAM_INTERVALS_US = {BY_NAME["DEBUG_VECT"].id: 100_000}
"""Interval, by message id, of streams that PX4 configures but that have no data in simulation."""
EMPTY_STREAMS = frozenset(
    BY_NAME[name].id
    for name in (
        "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE2", "SCALED_PRESSURE3", "GPS2_RAW",
        "HIL_ACTUATOR_CONTROLS", "RC_CHANNELS", "MANUAL_CONTROL", "OPTICAL_FLOW_RAD",
        "NAMED_VALUE_FLOAT", "DEBUG", "DEBUG_VECT", "DEBUG_FLOAT_ARRAY", "NAV_CONTROLLER_OUTPUT",
        "CAMERA_TRIGGER", "CAMERA_IMAGE_CAPTURED", "ADSB_VEHICLE", "UTM_GLOBAL_POSITION",
        "COLLISION", "WIND_COV", "ESC_INFO", "ESC_STATUS", "RAW_RPM", "EFI_STATUS", "GPS_RTCM_DATA",
        "SMART_BATTERY_INFO", "ATT_POS_MOCAP",
    )
)  # fmt: skip
"""Streams for which PX4 accepts an interval but has no data in simulation."""
NOT_ON_REQUEST = frozenset(
    {"GPS_RAW_INT", "LOCAL_POSITION_NED", "MISSION_CURRENT", "TIME_ESTIMATE_TO_TARGET"}
)
"""Messages that PX4 streams but refuses on request, because no newer sample exists at that time."""


class RequestService:
    """Handles requests for messages, commands for message intervals, and the deprecated request commands."""

    def __init__(self, context: Context, send_ping: Callable[[Link], None], files: VehicleFiles) -> None:
        self._context = context
        self._px4 = context.view.px4
        self._files = files
        self._send_ping = send_ping
        self._message_senders: dict[int, Callable[[Link, Command], bool]] = {
            BY_NAME["AUTOPILOT_VERSION"].id: self._autopilot_version,
            BY_NAME["PROTOCOL_VERSION"].id: self._protocol_version,
            BY_NAME["AVAILABLE_MODES"].id: self._available_modes,
            BY_NAME["FLIGHT_INFORMATION"].id: self._flight_information,
            BY_NAME["LINK_NODE_STATUS"].id: self._link_node_status,
            BY_NAME["COMPONENT_METADATA"].id: self._component_metadata,
            BY_NAME["COMPONENT_INFORMATION"].id: self._component_information,
            BY_NAME["TIMESYNC"].id: self._timesync,
            BY_NAME["MAG_CAL_REPORT"].id: self._mag_cal_report,
            BY_NAME["STORAGE_INFORMATION"].id: self._storage_information,
            BY_NAME["PING"].id: self._ping,
            BY_NAME["OPEN_DRONE_ID_BASIC_ID"].id: self._drone_id,
        }
        if self._px4.interval_on_request:
            self._message_senders[BY_NAME["MESSAGE_INTERVAL"].id] = self._message_interval
        self.commands: dict[int, Callable[[Command], int | None]] = {
            REQUEST_MESSAGE: self.request_message,
            SET_INTERVAL: self.set_interval,
            GET_INTERVAL: self.get_interval,
            REQUEST_CAPABILITIES: lambda c: self._send_message("AUTOPILOT_VERSION", c),
            REQUEST_PROTOCOL_VERSION: lambda c: self._send_message("PROTOCOL_VERSION", c),
            REQUEST_FLIGHT_INFORMATION: lambda c: self._send_message("FLIGHT_INFORMATION", c),
            REQUEST_CAMERA_INFORMATION: lambda c: None,
            REQUEST_STORAGE_INFORMATION: lambda c: self._send_message("STORAGE_INFORMATION", c),
        }

    def _link(self, command: Command) -> Link:
        return next(link for link in self._context.links if link.name == command.link)

    def _send_message(self, name: str, command: Command) -> int:
        self._message_senders[BY_NAME[name].id](self._link(command), command)
        return ACCEPTED

    def request_message(self, command: Command) -> int:
        """Handles REQUEST_MESSAGE: sends the message before the acknowledgement; denies a message that is
        unknown or has no data."""
        msg_id = int(command.p1) if math.isfinite(command.p1) else -1
        link = self._link(command)
        send_requested = self._message_senders.get(msg_id)
        if send_requested is not None:
            return ACCEPTED if send_requested(link, command) else DENIED
        layout = LAYOUTS.get(msg_id)
        if layout is None or layout.name in NOT_ON_REQUEST:
            return DENIED
        layout_and_payload = self._context.telemetry.payload(msg_id)
        if layout_and_payload is None:
            return DENIED
        link.send_payload(*layout_and_payload)
        return ACCEPTED

    def set_interval(self, command: Command) -> int:
        """Handles SET_MESSAGE_INTERVAL [µs]: negative stops the stream, 0 or NaN restores the default."""
        if command.p7 != 0.0 and math.isfinite(command.p7):
            return FAILED
        msg_id = int(command.p1) & 0xFFFF if math.isfinite(command.p1) else 0
        if msg_id == 0 and command.p1 != 0.0:
            return ACCEPTED
        layout = LAYOUTS.get(msg_id)
        streamable = {
            BY_NAME[name].id for name in ("TIMESYNC", "PING", "MISSION_CURRENT", "LINK_NODE_STATUS")
        }
        if layout is None or layout.name in FIXED_INTERVAL:
            return FAILED
        known = msg_id in self._context.telemetry.ids or msg_id in streamable or msg_id in EMPTY_STREAMS
        if not known:
            return FAILED
        link, now_us = self._link(command), self._context.view.time_boot_us()
        interval = command.p2
        if interval == 0.0 or math.isnan(interval):
            link.restore_interval(layout.name, now_us)
        elif not math.isfinite(interval) or interval < 0.0:
            link.set_interval(msg_id, 0, now_us)
        else:
            link.set_interval(msg_id, max(MIN_INTERVAL_US, int(interval)), now_us)
        return ACCEPTED

    def get_interval(self, command: Command) -> int:
        """Handles GET_MESSAGE_INTERVAL: sends MESSAGE_INTERVAL before the acknowledgement."""
        self._send_interval(self._link(command), command.p1)
        return ACCEPTED

    def _send_interval(self, link: Link, parameter: float) -> None:
        msg_id = int(parameter) if math.isfinite(parameter) else 0
        interval_us = link.interval_us(msg_id) or EMPTY_STREAM_INTERVALS_US.get(msg_id)
        if interval_us is None:
            interval_us = self._px4.not_streamed_interval_us
        link.send("MESSAGE_INTERVAL", message_id=msg_id & 0xFFFF, interval_us=interval_us)

    # --- messages on request ---------------------------------------------------------------------------

    def _message_interval(self, link: Link, command: Command) -> bool:
        self._send_interval(link, command.p2)
        return True

    def _autopilot_version(self, link: Link, command: Command) -> bool:
        link.send(
            "AUTOPILOT_VERSION",
            capabilities=CAPABILITIES,
            flight_sw_version=self._px4.release,
            middleware_sw_version=self._px4.release,
            os_sw_version=101854463,
            board_version=1,
            flight_custom_version=self._px4.custom_version,
            middleware_custom_version=self._px4.custom_version,
            uid=UID,
        )
        return True

    def _protocol_version(self, link: Link, command: Command) -> bool:
        link.send(
            "PROTOCOL_VERSION", version=200, min_version=100, max_version=self._px4.max_mavlink_version,
            library_version_hash=self._px4.mavlink_hash,
        )  # fmt: skip
        return True

    def _available_modes(self, link: Link, command: Command) -> bool:
        index = int(command.p2) if math.isfinite(command.p2) else 0
        all_modes = listed_modes(self._px4)
        modes = [(number, mode) for number, mode in enumerate(all_modes, 1) if index in (0, number)]
        for number, mode in modes:
            properties, name = self._properties_and_name(mode)
            link.send(
                "AVAILABLE_MODES", number_modes=len(all_modes), mode_index=number,
                standard_mode=mode.standard_mode, custom_mode=mode.custom_mode, properties=properties,
                mode_name=name,
            )  # fmt: skip
        return bool(modes)

    def _properties_and_name(self, mode: Mode) -> tuple[int, str]:
        """Properties and name of a mode; a registered external mode has the name of its registration, and a
        replaced mode cannot be selected."""
        external = self._context.autopilot.commander.external
        registered = external.mode(mode.state)
        if registered is not None:
            return 0, registered.name
        not_selectable = NOT_USER_SELECTABLE if external.is_replaced(mode.state) else 0
        return mode.properties | not_selectable, mode.listed_name

    def _flight_information(self, link: Link, command: Command) -> bool:
        link.send("FLIGHT_INFORMATION", time_boot_ms=self._context.view.time_boot_ms())
        return True

    def _timesync(self, link: Link, command: Command) -> bool:
        link.send("TIMESYNC", ts1=self._context.view.time_boot_us() * 1000)
        return True

    def _ping(self, link: Link, command: Command) -> bool:
        self._send_ping(link)
        return True

    def _drone_id(self, link: Link, command: Command) -> bool:
        """Sends the serial number, which on a simulated PX4 is the uid of the build."""
        link.send(
            "OPEN_DRONE_ID_BASIC_ID", id_type=ODID_SERIAL_NUMBER, ua_type=ODID_MULTIROTOR,
            uas_id=UID.to_bytes(20, "big"),
        )  # fmt: skip
        return True

    def _mag_cal_report(self, link: Link, command: Command) -> bool:
        link.send(
            "MAG_CAL_REPORT", cal_status=MAG_CAL_SUCCESS, diag_x=1.0, diag_y=1.0, diag_z=1.0,
            orientation_confidence=1.0, scale_factor=1.0,
        )  # fmt: skip
        return True

    def _storage_information(self, link: Link, command: Command) -> bool:
        link.send(
            "STORAGE_INFORMATION", time_boot_ms=self._context.view.time_boot_ms(), storage_id=1,
            storage_count=1, status=STORAGE_READY, total_capacity=STORAGE_SIZE_MIB,
            available_capacity=STORAGE_SIZE_MIB,
        )  # fmt: skip
        return True

    def _component_metadata(self, link: Link, command: Command) -> bool:
        link.send(
            "COMPONENT_METADATA", time_boot_ms=self._context.view.time_boot_ms(),
            file_crc=self._general_crc(), uri=f"mftp://{GENERAL}",
        )  # fmt: skip
        return True

    def _component_information(self, link: Link, command: Command) -> bool:
        link.send(
            "COMPONENT_INFORMATION", time_boot_ms=self._context.view.time_boot_ms(),
            general_metadata_file_crc=self._general_crc(), general_metadata_uri=f"mftp://{GENERAL}",
        )  # fmt: skip
        return True

    def _general_crc(self) -> int:
        return general_crc(self._files.read(GENERAL, 0, self._files.size(GENERAL)))

    def _link_node_status(self, link: Link, command: Command) -> bool:
        self.send_link_node_status(link)
        return True

    def send_link_node_status(self, link: Link) -> None:
        """Sends the link statistics; called at 1 Hz by default."""
        counts = link.parser.counts
        link.send(
            "LINK_NODE_STATUS",
            timestamp=self._context.view.time_boot_us(),
            tx_rate=link.tx_rate,
            rx_rate=link.rx_rate,
            rx_parse_err=min(65535, counts.bad_crc),
            messages_sent=link.sent_frames,
            messages_received=counts.frames,
            messages_lost=counts.lost,
        )


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
