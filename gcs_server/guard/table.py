"""What becomes of each message and command of a program. A message that is not in the table is not passed; a
command that is not in it needs control, like a message sent by hand (`GET /guards/table`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.priority import FORCE
from gcs_server.ros2 import program_topics
from gcs_server.vehicle.px4.modes import BY_CUSTOM_MODE, Mode
from gcs_server.vehicle.services.ftp_codec import Opcode

Way = Literal["read", "command", "input", "sensor", "part", "setpoint", "kept", "refused"]
"""read: passed to the vehicle, also from a program that only reads. command: needs control as the row of
`control/commands.py` says, is passed and journaled. input: the same, for messages that are sent many times a
second; the journal has one line for many. sensor: passed without control, because a vehicle that flies by a
program's estimates needs them whoever commands it, but not from a program that only reads. part: belongs to a
command that was admitted, needs control, and has no line of its own. setpoint: becomes a setpoint of this
server's stream. kept: used by the guard, not passed. refused: neither."""


@dataclass(frozen=True, slots=True)
class Rule:
    """What becomes of one message or command."""

    way: Way
    row: str = ""
    """Row of `control/commands.py` whose requirements apply."""
    why: str = ""
    """Why it is refused or not passed."""


READ, SETPOINT = Rule("read"), Rule("setpoint")
UNCHECKED = "mavlink/send"
"""Row of everything that this server does not understand."""
NOT_PASSED = Rule("refused", why="a guard does not pass this message")
_SIMULATION = Rule("refused", why="it replaces the vehicle's sensors")
_KEYS = Rule("refused", why="a signing key belongs to a link of this server")
_SENSOR = Rule("sensor")
_PART_OF_UPLOAD = Rule("part", "mission/upload")
MESSAGES: Final[dict[str, Rule]] = {
    "HEARTBEAT": Rule("kept", why="this server sends its own, by which the vehicle knows a lost link"),
    "SYSTEM_TIME": Rule("kept", why="the vehicle's time comes from its GPS or from this server's link"),
    "COMMAND_ACK": Rule("kept", why="the vehicle commands no program"),
    "STATUSTEXT": Rule("kept", why="it is shown on the page"),
    "TIMESYNC": Rule("read", why="requests only: answers to the vehicle are this server's"),
    "PING": READ,
    "PARAM_REQUEST_READ": READ,
    "PARAM_REQUEST_LIST": READ,
    "PARAM_SET": Rule("command", "param"),
    "PARAM_EXT_REQUEST_READ": READ,
    "PARAM_EXT_REQUEST_LIST": READ,
    "PARAM_EXT_SET": Rule("command", "param"),
    "MISSION_REQUEST_LIST": READ,
    "MISSION_REQUEST": READ,
    "MISSION_REQUEST_INT": READ,
    "MISSION_ACK": READ,
    "MISSION_COUNT": Rule("command", "mission/upload"),
    "MISSION_WRITE_PARTIAL_LIST": Rule("command", "mission/upload"),
    "MISSION_ITEM": _PART_OF_UPLOAD,
    "MISSION_ITEM_INT": _PART_OF_UPLOAD,
    "MISSION_CLEAR_ALL": Rule("command", "mission/clear"),
    "MISSION_SET_CURRENT": Rule("command", "mission/start"),
    "SET_MODE": Rule("command", "mode"),
    "SET_HOME_POSITION": Rule("command", "home"),
    "SET_GPS_GLOBAL_ORIGIN": Rule("command", "home"),
    "FILE_TRANSFER_PROTOCOL": Rule("read", why="writing and removing need control"),
    "LOG_REQUEST_LIST": READ,
    "LOG_REQUEST_DATA": READ,
    "LOG_REQUEST_END": READ,
    "LOG_ERASE": Rule("command", "logs/erase"),
    "LOGGING_ACK": Rule("part", "logs/stream"),
    "REQUEST_EVENT": READ,
    "SERIAL_CONTROL": Rule("input", "shell"),
    "GIMBAL_MANAGER_SET_ATTITUDE": Rule("input", "gimbal/angles"),
    "GIMBAL_MANAGER_SET_PITCHYAW": Rule("input", "gimbal/angles"),
    "GIMBAL_MANAGER_SET_MANUAL_CONTROL": Rule("input", "gimbal/rates"),
    "SET_POSITION_TARGET_LOCAL_NED": SETPOINT,
    "SET_POSITION_TARGET_GLOBAL_INT": SETPOINT,
    "SET_ATTITUDE_TARGET": SETPOINT,
    "SET_ACTUATOR_CONTROL_TARGET": Rule("refused", why="PX4 does not fly it"),
    "VISION_POSITION_ESTIMATE": _SENSOR,
    "VISION_SPEED_ESTIMATE": _SENSOR,
    "ATT_POS_MOCAP": _SENSOR,
    "ODOMETRY": _SENSOR,
    "OPTICAL_FLOW": _SENSOR,
    "OPTICAL_FLOW_RAD": _SENSOR,
    "DISTANCE_SENSOR": _SENSOR,
    "OBSTACLE_DISTANCE": _SENSOR,
    "LANDING_TARGET": _SENSOR,
    "ADSB_VEHICLE": _SENSOR,
    "GPS_RTCM_DATA": _SENSOR,
    "FOLLOW_TARGET": _SENSOR,
    "MANUAL_CONTROL": Rule("input", "manual_control", "PX4's own failsafe acts if they stop"),
    "RC_CHANNELS_OVERRIDE": Rule("refused", why="it replaces the pilot's transmitter"),
    "HIL_SENSOR": _SIMULATION,
    "HIL_GPS": _SIMULATION,
    "HIL_STATE_QUATERNION": _SIMULATION,
    "GPS_INPUT": _SIMULATION,
    "SETUP_SIGNING": _KEYS,
}
"""By name of the message."""
_CAMERA = Rule("command", "camera/picture")
_INTERVAL = Rule("kept", why="the guard sends at the rates that each program asks; faster ones are asked for")
COMMANDS: Final[dict[int, Rule]] = {
    d.MAV_CMD_REQUEST_MESSAGE: READ,
    d.MAV_CMD_SET_MESSAGE_INTERVAL: _INTERVAL,
    d.MAV_CMD_GET_MESSAGE_INTERVAL: READ,
    d.MAV_CMD_REQUEST_PROTOCOL_VERSION: READ,
    d.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: READ,
    d.MAV_CMD_GET_HOME_POSITION: READ,
    d.MAV_CMD_REQUEST_FLIGHT_INFORMATION: READ,
    d.MAV_CMD_RUN_PREARM_CHECKS: READ,
    d.MAV_CMD_REQUEST_CAMERA_INFORMATION: READ,
    d.MAV_CMD_REQUEST_CAMERA_SETTINGS: READ,
    d.MAV_CMD_REQUEST_STORAGE_INFORMATION: READ,
    d.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS: READ,
    d.MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION: READ,
    d.MAV_CMD_REQUEST_VIDEO_STREAM_STATUS: READ,
    d.MAV_CMD_DO_AUTOTUNE_ENABLE: Rule("command", "autotune/start"),
    d.MAV_CMD_COMPONENT_ARM_DISARM: Rule("command", "arm"),
    d.MAV_CMD_DO_SET_MODE: Rule("command", "mode"),
    d.MAV_CMD_NAV_TAKEOFF: Rule("command", "takeoff"),
    d.MAV_CMD_NAV_LAND: Rule("command", "land_now"),
    d.MAV_CMD_NAV_RETURN_TO_LAUNCH: Rule("command", "rtl"),
    d.MAV_CMD_DO_REPOSITION: Rule("command", "goto"),
    d.MAV_CMD_OVERRIDE_GOTO: Rule("command", "goto"),
    d.MAV_CMD_DO_ORBIT: Rule("command", "orbit"),
    d.MAV_CMD_DO_CHANGE_SPEED: Rule("command", "speed"),
    d.MAV_CMD_DO_CHANGE_ALTITUDE: Rule("command", "altitude"),
    d.MAV_CMD_DO_SET_HOME: Rule("command", "home"),
    d.MAV_CMD_MISSION_START: Rule("command", "mission/start"),
    d.MAV_CMD_DO_SET_MISSION_CURRENT: Rule("command", "mission/start"),
    d.MAV_CMD_DO_PAUSE_CONTINUE: Rule("command", "mode"),
    d.MAV_CMD_DO_FLIGHTTERMINATION: Rule("command", "kill"),
    d.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: Rule("command", "restart"),
    d.MAV_CMD_PREFLIGHT_STORAGE: Rule("command", "param"),
    d.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: Rule("command", "gimbal/take"),
    d.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: Rule("command", "gimbal/angles"),
    d.MAV_CMD_DO_MOUNT_CONTROL: Rule("command", "gimbal/angles"),
    d.MAV_CMD_DO_SET_ROI_LOCATION: Rule("command", "gimbal/roi"),
    d.MAV_CMD_DO_SET_ROI: Rule("command", "gimbal/roi"),
    d.MAV_CMD_DO_SET_ROI_NONE: Rule("command", "gimbal/roi/clear"),
    d.MAV_CMD_IMAGE_START_CAPTURE: _CAMERA,
    d.MAV_CMD_IMAGE_STOP_CAPTURE: _CAMERA,
    d.MAV_CMD_VIDEO_START_CAPTURE: _CAMERA,
    d.MAV_CMD_VIDEO_STOP_CAPTURE: _CAMERA,
    d.MAV_CMD_SET_CAMERA_MODE: _CAMERA,
    d.MAV_CMD_DO_DIGICAM_CONTROL: _CAMERA,
    d.MAV_CMD_LOGGING_START: Rule("command", "logs/stream"),
    d.MAV_CMD_LOGGING_STOP: Rule("command", "logs/stop_stream"),
    d.MAV_CMD_DO_SET_STANDARD_MODE: Rule("refused", why="PX4's own modes are set by MAV_CMD_DO_SET_MODE"),
    d.MAV_CMD_NAV_GUIDED_ENABLE: Rule("refused", why="Offboard is set by MAV_CMD_DO_SET_MODE"),
}
"""By MAV_CMD; any other command needs control, and is passed."""
TOPICS: Final[dict[program_topics.Way, Rule]] = {
    "mode": Rule("kept", why="chooses the setpoint; the server sends its own"),
    "setpoint": SETPOINT,
    "command": Rule("command", why="as the same MAV_CMD"),
    "read": READ,
    "sensor": _SENSOR,
}
"""By what becomes of a ROS 2 topic of a program; any other topic is refused."""
OTHER_COMMANDS = Rule("command", UNCHECKED)
MODE_OF: Final[dict[str, str]] = {
    "takeoff": "takeoff",
    "land_now": "land",
    "rtl": "rtl",
    "hold": "hold",
    "goto": "hold",
    "orbit": "orbit",
    "mission/start": "mission",
}
"""The mode that PX4 enters by the command of a row."""
NO_OPERATION = 0
FTP_READING = frozenset(
    {
        NO_OPERATION,
        Opcode.TERMINATE_SESSION,
        Opcode.RESET_SESSIONS,
        Opcode.LIST_DIRECTORY,
        Opcode.OPEN_FILE_RO,
        Opcode.READ_FILE,
        Opcode.CALC_FILE_CRC32,
        Opcode.BURST_READ_FILE,
    }
)
FTP_WRITING = Rule("input", "files/put")
FTP_OPCODE_OFFSET = 3 + 3
"""Of the opcode in the payload of FILE_TRANSFER_PROTOCOL: after network, system, component, and the sequence
number and session of the packet."""


def row_of_command(command: int, params: tuple[float, ...]) -> tuple[Rule, Mode | None]:
    """The rule of a command with its parameters, and the mode that it enters; None: it enters none.

    Args:
        command: MAV_CMD.
        params: the seven parameters.
    """
    rule = COMMANDS.get(command, OTHER_COMMANDS)
    if command == d.MAV_CMD_COMPONENT_ARM_DISARM:
        row = "arm" if params[0] >= 0.5 else "kill" if params[1] == FORCE else "disarm"
        return Rule("command", row), None
    if command == d.MAV_CMD_DO_PAUSE_CONTINUE:
        return Rule("command", "hold" if params[0] == 0 else "mission/start"), None
    if command == d.MAV_CMD_DO_SET_MODE:
        return row_of_mode(int(params[1]) << 16 | int(params[2]) << 24)
    return rule, mode_of_row(rule.row)


def row_of_mode(custom_mode: int) -> tuple[Rule, Mode | None]:
    """The rule of a change to a mode of PX4, and the mode; None: PX4 has no such mode."""
    mode = BY_CUSTOM_MODE.get(custom_mode)
    rows = {"hold": "hold", "land": "land_now", "rtl": "rtl", "offboard": "offboard/start"}
    return Rule("command", rows.get("" if mode is None else mode.name, "mode")), mode


def mode_of_row(row: str) -> Mode | None:
    """The mode that PX4 enters by the command of a row; None: none."""
    name = MODE_OF.get(row)
    return next((mode for mode in BY_CUSTOM_MODE.values() if mode.name == name), None)


def as_json() -> dict[str, list[dict[str, Any]]]:
    """The tables for people and for the API."""
    commands = {d.enums["MAV_CMD"][number].name: rule for number, rule in COMMANDS.items()}
    topics = {topic: TOPICS[way] for topic, way in program_topics.WAYS.items()}
    topics |= {topic: Rule("refused", why=why) for topic, why in program_topics.REFUSED.items()}
    return {
        kind: [
            {"name": name, "way": rule.way, "row": rule.row or None, "why": rule.why or None}
            for name, rule in table.items()
        ]
        for kind, table in (("messages", MESSAGES), ("commands", commands), ("topics", topics))
    }
