"""Sends a message of the dialect as a person has written it, to one vehicle, once.

Nothing checks what it does. So it is not sent while the vehicle is armed unless that is meant, and never
where a purpose-made command exists that looks at arming, mode, limits, fence or stored values: that one is
named instead.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Final

from gcs_server.errors import InvalidRequest, Refused
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.definitions import layout_of, payload_of
from gcs_server.mavlink.mailbox import Reply
from gcs_server.vehicle.services.port import VehiclePort

ACK_S: Final = 2.0
"""Wait for the acknowledgement of a command [s]."""
COMMANDS: Final = frozenset({"COMMAND_LONG", "COMMAND_INT"})
_SETPOINTS = "POST /vehicles/{v}/offboard/setpoint"
_STICKS = "WS /vehicles/{v}/manual_control/stream"
_UPLOAD = "POST /vehicles/{v}/mission/upload"
_PARAMETER = "PUT /vehicles/{v}/params/{name}"
_MODE = "POST /vehicles/{v}/mode"
_LINKS = "POST /links"
_FILES = "POST /vehicles/{v}/logs/{number}/download"
PURPOSE_MADE: Final[dict[str, str]] = {
    "SET_MODE": _MODE,
    "SET_POSITION_TARGET_LOCAL_NED": _SETPOINTS,
    "SET_POSITION_TARGET_GLOBAL_INT": _SETPOINTS,
    "SET_ATTITUDE_TARGET": _SETPOINTS,
    "SET_ACTUATOR_CONTROL_TARGET": _SETPOINTS,
    "MANUAL_CONTROL": _STICKS,
    "MANUAL_SETPOINT": _STICKS,
    "RC_CHANNELS_OVERRIDE": _STICKS,
    "PARAM_SET": _PARAMETER,
    "PARAM_EXT_SET": _PARAMETER,
    "MISSION_ITEM": _UPLOAD,
    "MISSION_ITEM_INT": _UPLOAD,
    "MISSION_COUNT": _UPLOAD,
    "MISSION_WRITE_PARTIAL_LIST": _UPLOAD,
    "MISSION_CLEAR_ALL": "DELETE /vehicles/{v}/mission",
    "MISSION_SET_CURRENT": "POST /vehicles/{v}/mission/start",
    "SET_HOME_POSITION": "POST /vehicles/{v}/home",
    "SET_GPS_GLOBAL_ORIGIN": "POST /vehicles/{v}/home",
    "SERIAL_CONTROL": "POST /vehicles/{v}/shell",
    "FILE_TRANSFER_PROTOCOL": _FILES,
    "LOG_REQUEST_LIST": "GET /vehicles/{v}/logs",
    "LOG_REQUEST_DATA": _FILES,
    "LOG_ERASE": "POST /vehicles/{v}/logs/erase",
    "GIMBAL_MANAGER_SET_ATTITUDE": "POST /vehicles/{v}/gimbal/angles",
    "GIMBAL_MANAGER_SET_PITCHYAW": "POST /vehicles/{v}/gimbal/angles",
    "GIMBAL_MANAGER_SET_MANUAL_CONTROL": "POST /vehicles/{v}/gimbal/rates",
    "HEARTBEAT": _LINKS,
    "SETUP_SIGNING": _LINKS,
    "CHANGE_OPERATOR_CONTROL": "POST /vehicles/{v}/control/take",
}
"""Messages that are refused, and the call that does it. HEARTBEAT: this server sends its own, by which the
vehicle knows a lost link; a signing key belongs to a link."""
PURPOSE_MADE_COMMANDS: Final[dict[int, str]] = {
    d.MAV_CMD_COMPONENT_ARM_DISARM: "POST /vehicles/{v}/arm",
    d.MAV_CMD_DO_SET_MODE: _MODE,
    d.MAV_CMD_DO_SET_STANDARD_MODE: _MODE,
    d.MAV_CMD_NAV_GUIDED_ENABLE: _MODE,
    d.MAV_CMD_NAV_TAKEOFF: "POST /vehicles/{v}/takeoff",
    d.MAV_CMD_NAV_LAND: "POST /vehicles/{v}/land",
    d.MAV_CMD_NAV_RETURN_TO_LAUNCH: "POST /vehicles/{v}/rtl",
    d.MAV_CMD_DO_REPOSITION: "POST /vehicles/{v}/goto",
    d.MAV_CMD_OVERRIDE_GOTO: "POST /vehicles/{v}/goto",
    d.MAV_CMD_DO_ORBIT: "POST /vehicles/{v}/orbit",
    d.MAV_CMD_DO_CHANGE_SPEED: "POST /vehicles/{v}/speed",
    d.MAV_CMD_DO_CHANGE_ALTITUDE: "POST /vehicles/{v}/altitude",
    d.MAV_CMD_DO_SET_HOME: "POST /vehicles/{v}/home",
    d.MAV_CMD_MISSION_START: "POST /vehicles/{v}/mission/start",
    d.MAV_CMD_DO_SET_MISSION_CURRENT: "POST /vehicles/{v}/mission/start",
    d.MAV_CMD_DO_PAUSE_CONTINUE: "POST /vehicles/{v}/hold",
    d.MAV_CMD_DO_FLIGHTTERMINATION: "POST /vehicles/{v}/kill",
    d.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: "POST /vehicles/{v}/restart",
    d.MAV_CMD_PREFLIGHT_STORAGE: _PARAMETER,
    d.MAV_CMD_DO_SET_PARAMETER: _PARAMETER,
    d.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: "POST /vehicles/{v}/gimbal/take",
    d.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: "POST /vehicles/{v}/gimbal/angles",
    d.MAV_CMD_DO_SET_ROI_LOCATION: "POST /vehicles/{v}/gimbal/roi",
    d.MAV_CMD_DO_SET_ROI_NONE: "POST /vehicles/{v}/gimbal/roi/clear",
}
"""Commands that are refused, and the call that does it."""


class RawMessages:
    """Sends single messages to one vehicle."""

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle

    async def send(
        self, name: str, fields: Mapping[str, object], *, while_armed: bool = False
    ) -> tuple[bool, int | None]:
        """Sends a message once.

        Args:
            name: name of the message.
            fields: its fields; `target_system` is the vehicle, `target_component` the autopilot if not given.
            while_armed: whether it is also sent while the vehicle is armed.

        Returns:
            Whether an acknowledgement was awaited, which only commands have, and its MAV_RESULT; None: none
            came.

        Raises:
            InvalidRequest: there is no such message, or a field is wrong.
            Refused: a purpose-made command does it, the vehicle is armed, or no link can send it.
            Disconnected: the vehicle was lost.
        """
        vehicle, layout = self._vehicle, layout_of(name)
        payload = payload_of(name, self._addressed(layout.fields, fields))
        command = fields.get("command") if name in COMMANDS else None
        call = PURPOSE_MADE.get(name)
        if call is None and isinstance(command, int):
            call = PURPOSE_MADE_COMMANDS.get(command)
        if call is not None:
            raise Refused(
                f"{name} is not sent as it is, because a command of its own does this and looks at what it "
                "may not do.",
                remedy=f"Use {call}.",
            )
        vehicle.require("raw_messages")
        if vehicle.flight_state.armed and not while_armed:
            raise Refused(
                f"Vehicle {vehicle.id} is armed, and a message acts at once, unchecked.",
                remedy="Send it with while_armed if that is meant.",
            )
        if not isinstance(command, int):
            self._transmit(layout.msg_id, payload)
            return False, None

        def answers(message: Reply) -> bool:
            return message.command == command and message.get_srcSystem() == vehicle.identity.system_id

        with vehicle.mailbox.expect(d.MAVLINK_MSG_ID_COMMAND_ACK, matches=answers) as waiter:
            self._transmit(layout.msg_id, payload)
            try:
                async with asyncio.timeout(ACK_S):
                    return True, int((await waiter.next()).result)
            except TimeoutError:
                return True, None

    def _addressed(self, names: tuple[str, ...], fields: Mapping[str, object]) -> dict[str, object]:
        """The fields with their receiver.

        Raises:
            InvalidRequest: the receiver is another vehicle, or all.
        """
        identity = self._vehicle.identity
        values = dict(fields)
        if (
            "target_system" in names
            and values.setdefault("target_system", identity.system_id) != identity.system_id
        ):
            raise InvalidRequest(
                "fields.target_system",
                f"The message is for vehicle {self._vehicle.id}, whose system id is {identity.system_id}.",
                remedy="Leave target_system out.",
            )
        if "target_component" in names:
            values.setdefault("target_component", identity.component_id)
        return values

    def _transmit(self, msg_id: int, payload: bytes) -> None:
        if not self._vehicle.send_payload(msg_id, payload):
            raise Refused("No link of the vehicle can send the message now.", remedy="Try again.")
