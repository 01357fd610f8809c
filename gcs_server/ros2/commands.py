"""Converts MAVLink commands to VehicleCommand, and PX4's VehicleCommandAck to COMMAND_ACK.

Over ROS 2 the server sends its commands from component 192 instead of 190. PX4 publishes to ROS 2 also the
acknowledgements of commands that it received over MAVLink. The component id distinguishes these: if this
server sent the command over MAVLink, the acknowledgement also arrives over MAVLink and is ignored here.
"""

from __future__ import annotations

import math
from typing import Any, Final

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame, full_payload
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.mavlink.tables import LAYOUTS
from gcs_server.ros2.message_types import Values
from gcs_server.vehicle.px4.modes import BY_NAME

MAVLINK_COMPONENT: Final = d.MAV_COMP_ID_MISSIONPLANNER
"""Component id of the server's commands over MAVLink, 190."""
ROS2_COMPONENT: Final = 192
"""Component id of the server's commands over ROS 2."""
MODE_OF_COMMAND: Final = {
    d.MAV_CMD_NAV_TAKEOFF: "takeoff",
    d.MAV_CMD_DO_REPOSITION: "hold",
    d.MAV_CMD_DO_ORBIT: "orbit",
    d.MAV_CMD_MISSION_START: "mission",
}
"""Mode to which a command switches."""
_COMMAND_LONG = LAYOUTS[d.MAVLINK_MSG_ID_COMMAND_LONG]
_COMMAND_INT = LAYOUTS[d.MAVLINK_MSG_ID_COMMAND_INT]


def requested_message(frame: Frame) -> int | None:
    """The message that a frame requests (MAV_CMD_REQUEST_MESSAGE); None for all other frames."""
    if frame.msg_id != d.MAVLINK_MSG_ID_COMMAND_LONG:
        return None
    fields = dict(zip(_COMMAND_LONG.fields, _COMMAND_LONG.unpacker.unpack(full_payload(frame)), strict=True))
    return int(fields["param1"]) if fields["command"] == d.MAV_CMD_REQUEST_MESSAGE else None


def command_fields(frame: Frame) -> dict[str, Any] | None:
    """The fields of a VehicleCommand for a COMMAND_LONG or COMMAND_INT frame; None for other messages.

    Args:
        frame: a frame from this server or from another ground station.
    """
    layout = {_COMMAND_LONG.msg_id: _COMMAND_LONG, _COMMAND_INT.msg_id: _COMMAND_INT}.get(frame.msg_id)
    if layout is None:
        return None
    fields = dict(zip(layout.fields, layout.unpacker.unpack(full_payload(frame)), strict=True))
    if layout is _COMMAND_INT:
        fields |= {"param5": _degrees(fields["x"]), "param6": _degrees(fields["y"]), "param7": fields["z"]}
    component = frame.component_id
    return {
        **{f"param{n}": fields[f"param{n}"] for n in range(1, 8)},
        "command": fields["command"],
        "target_system": fields["target_system"],
        "target_component": fields["target_component"],
        "source_system": frame.system_id,
        "source_component": ROS2_COMPONENT if component == MAVLINK_COMPONENT else component,
        "confirmation": fields.get("confirmation", 0),
        "from_external": True,
    }


def mode_of_command(fields: Values, current_nav_state: int) -> int | None:
    """`nav_state` of the mode that a command selects, or in which it arms; None: no mode. If PX4 refuses the
    command, the requirements of this mode may explain the refusal.

    Args:
        fields: the fields of the VehicleCommand.
        current_nav_state: the vehicle's current mode.
    """
    command = fields["command"]
    if command == d.MAV_CMD_COMPONENT_ARM_DISARM:
        return current_nav_state if fields["param1"] == 1.0 else None
    if command == d.MAV_CMD_DO_SET_MODE:
        main, sub = fields["param2"], fields["param3"]
        matching = (mode for mode in BY_NAME.values() if (mode.main, mode.sub) == (main, sub))
        return next((mode.nav_state for mode in matching), None)
    name = MODE_OF_COMMAND.get(command)
    return None if name is None else BY_NAME[name].nav_state


def _degrees(scaled: int) -> float:
    """Converts 1e-7 degrees to degrees; NaN for the largest value, as in PX4."""
    return math.nan if scaled == 2**31 - 1 else scaled * 1e-7


def command_ack(values: Values, own_system_id: int) -> MAVLink_message | None:
    """The COMMAND_ACK of a VehicleCommandAck. None if the target's component id does not fit MAVLink, or if
    this server sent the command over MAVLink."""
    target = (values["target_system"], values["target_component"])
    if target[1] > 255 or target == (own_system_id, MAVLINK_COMPONENT):
        return None
    component = MAVLINK_COMPONENT if target == (own_system_id, ROS2_COMPONENT) else target[1]
    return d.MAVLink_command_ack_message(
        min(values["command"], 65_535),
        values["result"],
        values["result_param1"],
        values["result_param2"],
        target[0],
        component,
    )
