"""Compares the messages of the simulator in a dialogue with those of PX4, field by field.

Rules, in addition to the tolerances below:
- Messages with the same name and key are compared in their order; the key is a command, text, parameter or
event.
- `rules.py` lists the differences caused by the recording and not by the vehicle, each with its bound.
- An arming report must have the content of a report that was valid during the dialogue.
- Each recorded state message (such as HEARTBEAT) must equal a message that the simulator sent during the
dialogue.
- The recording sampled mode, arming and landed state at 1 Hz after the dialogue: each value that the
simulator had in the last second is accepted.
"""

from __future__ import annotations

import difflib
import math
import re
import struct
from dataclasses import dataclass
from typing import Any

from tests.contract import rules
from tests.contract.driver import DialogueResult
from tests.contract.recordings import STATE_MESSAGES, TELEMETRY, Dialogue, python_value
from tests.contract.replay_vehicle import Received
from vehicle_sim.autopilot.announcer import EVENTS

EVENT_NAMES = {event_id: name for name, (event_id, _) in EVENTS.items()}
ARMING_SUMMARY_ID, HEALTH_SUMMARY_ID = 27825120, 18691879
"""Ids of the first and the last event of an arming report."""

NOT_COMPARED: dict[str, frozenset[str]] = {
    "*": frozenset({"time_usec", "time_boot_ms", "event_time_boot_ms", "timestamp", "time_unix_usec"}),
    "EVENT": frozenset({"sequence"}),
    "STATUSTEXT": frozenset({"id", "chunk_seq"}),
    "TIMESYNC": frozenset({"tc1", "ts1", "target_system", "target_component"}),
    "LINK_NODE_STATUS": frozenset(
        {"tx_rate", "rx_rate", "messages_sent", "messages_received", "messages_lost", "rx_buf", "tx_buf"}
    ),
    "FLIGHT_INFORMATION": frozenset({"flight_uuid", "arming_time_utc", "takeoff_time_utc"}),
    "GIMBAL_MANAGER_INFORMATION": frozenset({"roll_min", "roll_max"}),
    "CURRENT_EVENT_SEQUENCE": frozenset({"sequence"}),
    "RESPONSE_EVENT_ERROR": frozenset({"sequence_oldest_available"}),
    "LOG_ENTRY": frozenset({"time_utc", "size"}),
    "GPS_RAW_INT": frozenset({"cog"}),
    "STORAGE_INFORMATION": frozenset({"total_capacity", "used_capacity", "available_capacity"}),
}
"""Clocks, counters, the disk of the recording machine, fields that PX4 leaves uninitialised (gimbal roll
limits, the targets of its TIMESYNC), and the course over ground of a vehicle at rest, which is noise."""
HEADING_RAD = 0.08
"""Tolerance of the heading, which drifts at rest."""
HEADING_DEG = math.ceil(math.degrees(HEADING_RAD))  # VFR_HUD has whole degrees
HEADING_CDEG = round(100.0 * math.degrees(HEADING_RAD))

TOLERANCES: dict[str, float] = {
    "GPS_RAW_INT.lat": 400, "GPS_RAW_INT.lon": 400, "GPS_RAW_INT.alt": 4000, "GPS_RAW_INT.vel": 60,
    "GPS_RAW_INT.eph": 30, "GPS_RAW_INT.epv": 60, "GPS_RAW_INT.alt_ellipsoid": 4000,
    "GPS_RAW_INT.h_acc": 500, "GPS_RAW_INT.v_acc": 500, "GPS_RAW_INT.vel_acc": 200,
    "GLOBAL_POSITION_INT.lat": 200, "GLOBAL_POSITION_INT.lon": 200, "GLOBAL_POSITION_INT.alt": 2000,
    "GLOBAL_POSITION_INT.relative_alt": 800, "GLOBAL_POSITION_INT.vx": 15, "GLOBAL_POSITION_INT.vy": 15,
    "GLOBAL_POSITION_INT.vz": 15, "GLOBAL_POSITION_INT.hdg": HEADING_CDEG,
    "HOME_POSITION.latitude": 200, "HOME_POSITION.longitude": 200, "HOME_POSITION.altitude": 2000,
    "HOME_POSITION.x": 2.0, "HOME_POSITION.y": 2.0, "HOME_POSITION.z": 1.5, "HOME_POSITION.q": 0.15,
    "GPS_GLOBAL_ORIGIN.latitude": 200, "GPS_GLOBAL_ORIGIN.longitude": 200, "GPS_GLOBAL_ORIGIN.altitude": 3000,
    "HIGHRES_IMU.xacc": 0.6, "HIGHRES_IMU.yacc": 0.6, "HIGHRES_IMU.zacc": 0.6, "HIGHRES_IMU.xgyro": 0.05,
    "HIGHRES_IMU.ygyro": 0.05, "HIGHRES_IMU.zgyro": 0.05, "HIGHRES_IMU.xmag": 0.03, "HIGHRES_IMU.ymag": 0.03,
    "HIGHRES_IMU.zmag": 0.03, "HIGHRES_IMU.abs_pressure": 60, "HIGHRES_IMU.pressure_alt": 6,
    "HIGHRES_IMU.temperature": 2.0,
    "SCALED_IMU.xacc": 60, "SCALED_IMU.yacc": 60, "SCALED_IMU.zacc": 60, "SCALED_IMU.xgyro": 50,
    "SCALED_IMU.ygyro": 50, "SCALED_IMU.zgyro": 50, "SCALED_IMU.xmag": 80, "SCALED_IMU.ymag": 80,
    "SCALED_IMU.zmag": 80,
    "ATTITUDE.roll": 0.03, "ATTITUDE.pitch": 0.03, "ATTITUDE.yaw": HEADING_RAD, "ATTITUDE.rollspeed": 0.03,
    "ATTITUDE.pitchspeed": 0.03, "ATTITUDE.yawspeed": 0.03, "VFR_HUD.groundspeed": 0.15, "VFR_HUD.alt": 2.0,
    "VFR_HUD.climb": 0.15, "VFR_HUD.heading": HEADING_DEG, "ATTITUDE_TARGET.q": 0.08,
    "ATTITUDE_TARGET.body_roll_rate": 0.02, "ATTITUDE_TARGET.body_pitch_rate": 0.02,
    "ATTITUDE_TARGET.body_yaw_rate": 0.02, "ATTITUDE_TARGET.thrust": 0.002,
    "ALTITUDE.altitude_monotonic": 4, "ALTITUDE.altitude_amsl": 2, "ALTITUDE.altitude_local": 1.5,
    "ALTITUDE.altitude_relative": 1.0, "ALTITUDE.altitude_terrain": 1.5, "ALTITUDE.bottom_clearance": 1.0,
    "ESTIMATOR_STATUS.vel_ratio": 0.5, "ESTIMATOR_STATUS.pos_horiz_ratio": 0.5,
    "ESTIMATOR_STATUS.pos_vert_ratio": 0.5, "ESTIMATOR_STATUS.mag_ratio": 0.5,
    "ESTIMATOR_STATUS.hagl_ratio": 0.5, "ESTIMATOR_STATUS.pos_horiz_accuracy": 0.5,
    "ESTIMATOR_STATUS.pos_vert_accuracy": 0.5, "VIBRATION.vibration_x": 0.1, "VIBRATION.vibration_y": 0.1,
    "VIBRATION.vibration_z": 0.5, "MOUNT_ORIENTATION.yaw_absolute": 5.0, "MOUNT_ORIENTATION.roll": 1.5,
    "MOUNT_ORIENTATION.pitch": 1.5, "MOUNT_ORIENTATION.yaw": 1.5, "GIMBAL_DEVICE_ATTITUDE_STATUS.q": 0.05,
    "GIMBAL_DEVICE_ATTITUDE_STATUS.angular_velocity_x": 0.05,
    "GIMBAL_DEVICE_ATTITUDE_STATUS.angular_velocity_y": 0.05,
    "GIMBAL_DEVICE_ATTITUDE_STATUS.angular_velocity_z": 0.05, "BATTERY_STATUS.voltages": 300,
    "SYS_STATUS.voltage_battery": 300, "SYS_STATUS.load": 100, "SYS_STATUS.battery_remaining": 2,
    "BATTERY_STATUS.battery_remaining": 2,
    "ORBIT_EXECUTION_STATUS.radius": 1e-3, "ORBIT_EXECUTION_STATUS.x": 200, "ORBIT_EXECUTION_STATUS.y": 200,
    "ORBIT_EXECUTION_STATUS.z": 2.0,
}  # fmt: skip
"""Absolute tolerances in the unit of the field: noise of sensors and estimates, drift of home and heading,
battery charge."""

ECHO_TOLERANCE = {"x": 1.5, "y": 1.5, "z": 1.5, "vx": 0.8, "vy": 0.8, "vz": 0.8, "afx": 2.0, "afy": 2.0,
                  "afz": 3.2, "yaw": 0.15, "yaw_rate": 0.1, "q": 0.08, "body_roll_rate": 0.52,
                  "body_pitch_rate": 0.52, "body_yaw_rate": 0.3, "thrust": 0.08}  # fmt: skip
"""Tolerances of the controllers' setpoints while the vehicle drifted with its GPS [m, m/s, m/s², rad, rad/s].
The tolerance of afz is MPC_Z_VEL_P_ACC (4) times that of vz, the tolerance of the roll and pitch rates is
MC_ROLL_P (6.5) times that of q."""

Row = tuple[str, str, Any, Any]  # message, field, PX4's value, simulated value
RATE_TOLERANCE = 0.1  # as a part of the number of messages
THINNED_NUMBERS = (16, 32)
"""Numbers of messages that the recordings keep of a long series: the first twelve and the last four, twice if
the series was interrupted."""
CALIBRATED, CALIBRATION_TOLERANCE = ("CAL_", "SENS_BOARD_"), 0.3
"""Prefixes of parameters that a calibration measures, and their tolerance in the parameter's unit."""
FULL_TURN = {
    "MOUNT_ORIENTATION.yaw_absolute": 360.0, "VFR_HUD.heading": 360, "GLOBAL_POSITION_INT.hdg": 36000,
    "ATTITUDE.yaw": math.tau,
}  # fmt: skip
"""Values after which an angle wraps around."""
COUNTED_MESSAGES = ("TIMESYNC", "CURRENT_EVENT_SEQUENCE", "ORBIT_EXECUTION_STATUS", "MISSION_ITEM_REACHED")
"""Messages that are compared by their number and by the fields of the first one."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One row of the table."""

    dialogue: str
    message: str
    field: str
    px4: Any
    simulated: Any

    def __str__(self) -> str:
        return f"{self.dialogue} | {self.message} | {self.field} | {self.px4} | {self.simulated}"


def compare(
    dialogue: Dialogue, result: DialogueResult, hashes: rules.ParameterHashes | None = None
) -> list[Difference]:
    """All differences of one dialogue; `hashes`: the parameter hashes received earlier in the session."""
    name = dialogue["id"]
    for entry in dialogue["received"]:
        if "decoded" in entry:
            EVENT_NAMES.setdefault(entry["fields"]["id"], entry["decoded"]["name"])
    recorded = [
        Received(entry["dt_s"], entry["msg"], {k: python_value(v) for k, v in entry["fields"].items()})
        for entry in dialogue["received"]
        if "link" not in entry
    ]
    rows = [*_compare_reports(recorded, result), *_compare_states(recorded, result)]
    sim = [m for m in result.received if m.name not in STATE_MESSAGES and not _is_in_report(m)]
    real = [m for m in recorded if m.name not in STATE_MESSAGES and not _is_in_report(m)]
    if not _reads_parameters(dialogue):
        sim, real = (
            [m for m in side if m.name != "PARAM_VALUE" or m.values["param_id"] not in result.earlier_params]
            for side in (sim, real)
        )
    summary = dialogue.get("summary", {})
    thinned = "received_total" in dialogue or "kept" in summary or "messages_received" in summary
    sim = rules.first_and_last(sim, dialogue.get("note"))
    sim, real = rules.without_earlier_repeats(sim), rules.without_earlier_repeats(real)
    sim = rules.without_last_moment(sim, real, dialogue["window_s"])
    for kind in dict.fromkeys(m.name for m in (*real, *sim)):
        shortened = "received_total" in dialogue and sum(m.name == kind for m in recorded) in THINNED_NUMBERS
        rows += _compare_kind(
            kind, _whole_messages(real, kind), _whole_messages(sim, kind), thinned, shortened
        )
    rows = (hashes or rules.ParameterHashes()).without_hashes(rows)
    rows += _compare_end(dialogue, result)
    return [Difference(name, *row) for row in rows]


def _reads_parameters(dialogue: Dialogue) -> bool:
    return any(e["msg"].startswith("PARAM_REQUEST") for e in dialogue["send"]) and not any(
        e["msg"] == "PARAM_SET" for e in dialogue["send"]
    )


def _is_in_report(message: Received) -> bool:
    if message.name != "EVENT":
        return False
    event_id = message.values["id"]
    is_check = EVENT_NAMES.get(event_id, "").startswith("check_")
    return is_check or event_id in (ARMING_SUMMARY_ID, HEALTH_SUMMARY_ID)


def _whole_messages(messages: list[Received], kind: str) -> list[Received]:
    matching = [m for m in messages if m.name == kind]
    if kind == "STATUSTEXT":
        texts: dict[int, Received] = {}
        for m in matching:
            previous = texts.get(m.values["id"])
            text = (previous.values["text"] if previous else "") + _plain_value(m.values["text"])
            texts[m.values["id"]] = Received(m.dt_s, kind, {"severity": m.values["severity"], "text": text})
        return list(texts.values())
    if kind == "SERIAL_CONTROL" and matching:
        text = "".join(_serial_text(m.values) for m in matching)
        text = re.sub(r" timestamp: \d+ \([\d.]+ s", " timestamp: … (… s", text)
        return [Received(matching[0].dt_s, kind, {"text": text})]
    if kind == "FILE_TRANSFER_PROTOCOL":
        return [Received(m.dt_s, kind, _ftp_fields(m.values["payload"])) for m in matching]
    return matching


def _serial_text(values: dict[str, Any]) -> str:
    if "text" in values:
        return values["text"]
    return bytes(values["data"][: values["count"]]).decode("utf-8", "replace")


def _ftp_fields(payload: Any) -> dict[str, Any]:
    if isinstance(payload, dict):
        return payload
    raw = bytes(payload)
    seq, session, opcode, size, req, burst, padding, offset = struct.unpack("<HBBBBBBI", raw[:12])
    return {
        "seq_number": seq, "session": session, "opcode": opcode, "size": size, "req_opcode": req,
        "burst_complete": burst, "padding": padding, "offset": offset, "data_hex": raw[12 : 12 + size].hex(),
    }  # fmt: skip


def _key(message: Received) -> Any:
    v = message.values
    match message.name:
        case "COMMAND_ACK" | "COMMAND_LONG" | "COMMAND_INT":
            return v["command"]
        case "STATUSTEXT":
            text = re.sub(r"\[[-\d. ]+\]", "[…]", v["text"])  # measured values have noise
            text = rules.without_altitudes(text)
            return re.sub(r"[\d-]+/[\d_]+\.ulg", "….ulg", text)  # the file name is the time
        case "EVENT":
            return EVENT_NAMES.get(v["id"], v["id"])
        case "PARAM_VALUE":
            return v["param_id"]
        case "MISSION_ITEM_INT" | "MISSION_ITEM" | "MISSION_REQUEST_INT" | "MISSION_REQUEST":
            return v["seq"]
        case _:
            return ""


def _compare_kind(
    kind: str, recorded: list[Received], sim: list[Received], thinned: bool, shortened: bool = False
) -> list[Row]:
    rows: list[Row] = []
    if kind in TELEMETRY and not recorded:
        return rows
    if kind in COUNTED_MESSAGES or (len(recorded) > 8 and len({_key(m) for m in recorded}) == 1):
        if not thinned and abs(len(recorded) - len(sim)) > max(1, RATE_TOLERANCE * len(recorded)):
            rows.append((kind, "(number)", len(recorded), len(sim)))
        recorded, sim = recorded[:1], sim[:1]
    if kind in TELEMETRY and kind != "PING":
        recorded, sim = recorded[:1], sim[:1]  # requested and also streamed: the first is compared
    if thinned:
        recorded, sim = _distinct(recorded), _distinct(sim)
    if kind in ("STATUSTEXT", "EVENT") and not thinned:
        recorded, sim, counts = rules.compare_frequent(recorded, sim, _key)
        rows += [(kind, f"(number) {key}", real, simulated) for key, real, simulated in counts]
    real_keys, sim_keys = [_key(m) for m in recorded], [_key(m) for m in sim]
    missing: list[Received] = []
    extra: list[Received] = []
    matcher = difflib.SequenceMatcher(None, real_keys, sim_keys, autojunk=False)
    for operation, i0, i1, j0, j1 in matcher.get_opcodes():
        if operation == "equal":
            for real, replayed in zip(recorded[i0:i1], sim[j0:j1], strict=True):
                rows += _compare_fields(kind, real.values, replayed.values)
            continue
        missing += recorded[i0:i1]
        if not thinned or (kind in ("COMMAND_ACK", "STATUSTEXT") and not shortened):
            extra += sim[j0:j1]
    for real, replayed in rules.swapped_pairs(missing, extra, _key):
        rows += _compare_fields(kind, real.values, replayed.values)
    rows += [(kind, _row_name("missing", m), _key(m), "–") for m in missing]
    rows += [(kind, _row_name("extra", m), "–", _key(m)) for m in extra]
    return rows


def _row_name(what: str, message: Received) -> str:
    """A row's name: the message that is missing or additional."""
    return f"({what}) {str(_key(message)).strip()}".strip()


def _distinct(messages: list[Received]) -> list[Received]:
    """One message for each key, sorted by key: a thinned recording does not keep the number and the order."""
    return [m for _, m in sorted({str(_key(m)): m for m in messages}.items())]


def _plain_value(value: Any) -> Any:
    if isinstance(value, bytes | bytearray | tuple):
        value = list(value)
    return value.rstrip("\0") if isinstance(value, str) else value


def _compare_fields(kind: str, real: dict[str, Any], sim: dict[str, Any]) -> list[Row]:
    skipped = NOT_COMPARED["*"] | NOT_COMPARED.get(kind, frozenset())
    rows: list[Row] = []
    for name, value in real.items():
        if name in skipped or name not in sim or name == "int_value":
            continue
        a: Any = _plain_value(value)
        b: Any = _plain_value(sim[name])
        if kind == "LOG_DATA" and name == "data":
            a, b = list(bytes.fromhex(value)), b[: sim["count"]]
        if name == "arguments" and EVENT_NAMES.get(real["id"]) == "logger_open_file_time":
            continue  # the arguments are the time
        if kind == "STATUSTEXT" and name == "text":
            a, b = rules.altitudes_in(value), rules.altitudes_in(sim[name])
            if not same(a, b, rules.ALTITUDE_TOLERANCE_M):
                rows.append((kind, f"{_key_prefix(kind, real)}altitudes", a, b))
            continue  # the key contains the rest of the text
        if name == "arguments" and EVENT_NAMES.get(real["id"]) == rules.RETURN_EVENT:
            a, b = rules.return_altitudes(a), rules.return_altitudes(b)
            if not same(a, b, rules.ALTITUDE_TOLERANCE_M):
                rows.append((kind, f"{_key_prefix(kind, real)}{name}", a, b))
            continue
        if kind == "FILE_TRANSFER_PROTOCOL" and real["req_opcode"] == rules.FTP_LIST:
            if name == "data_hex":
                a, b = rules.listed_entries(real, a), rules.listed_entries(sim, b)
            elif name == "size" and real["offset"]:
                continue
        if name == "arguments" and real["id"] == HEALTH_SUMMARY_ID:
            a, b = _mask_health(a), _mask_health(b)
        if name == "param_value" and "int_value" in real:
            a = real["int_value"] & 0xFFFFFFFF
            b = struct.unpack("<I", struct.pack("<f", sim[name]))[0]
        turn = FULL_TURN.get(f"{kind}.{name}")
        if turn is not None:
            b = a + math.remainder(b - a, turn)
        if name == "param_value" and "int_value" not in real and str(real["param_id"]).startswith(CALIBRATED):
            a, b, tolerance = value, sim[name], CALIBRATION_TOLERANCE
        else:
            tolerance = TOLERANCES.get(f"{kind}.{name}")
        if not same(a, b, tolerance):
            rows.append((kind, f"{_key_prefix(kind, real)}{name}", a, b))
    return rows


def _mask_health(arguments: list[int]) -> list[int]:
    """Arguments without the health component that PX4 reports as present intermittently (bit 10)."""
    return [value & ~0x04 if n == 2 else value for n, value in enumerate(arguments)]


def _key_prefix(kind: str, values: dict[str, Any]) -> str:
    key = _key(Received(0, kind, values))
    return f"[{key}]." if key != "" else ""


def same(a: Any, b: Any, tolerance: float | None = None) -> bool:
    """Whether two values are equal within the tolerance; lists element by element."""
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(same(x, y, tolerance) for x, y in zip(a, b, strict=True))
    if isinstance(a, int | float) and isinstance(b, int | float):
        if math.isnan(a) or math.isnan(b):
            return math.isnan(a) and math.isnan(b)
        if tolerance is not None:
            return abs(a - b) <= tolerance
        if isinstance(a, int) and isinstance(b, int):
            return a == b
        return a == b or abs(a - b) <= 2e-6 * max(abs(a), abs(b), 1e-3)
    return a == b


def _compare_reports(recorded: list[Received], result: DialogueResult) -> list[Row]:
    events = [m for m in recorded if _is_in_report(m)]
    ends = [n for n, m in enumerate(events) if m.values["id"] == HEALTH_SUMMARY_ID]
    if not ends or not any(m.values["id"] == ARMING_SUMMARY_ID for m in events[: ends[-1]]):
        return []
    first = max(n for n, m in enumerate(events[: ends[-1]]) if m.values["id"] == ARMING_SUMMARY_ID)
    real = events[first : ends[-1] + 1]
    rows_by_report = [_compare_kind("EVENT", real, sim, thinned=False) for sim in result.reports]
    return min(rows_by_report, key=len, default=[("EVENT", "(missing)", "arming report", "–")])


def _compare_states(recorded: list[Received], result: DialogueResult) -> list[Row]:
    rows: list[Row] = []
    for real in recorded:
        if real.name not in STATE_MESSAGES:
            continue
        sim = [m for m in (*result.received, *result.states_after) if m.name == real.name]
        if real.name in result.states_before:
            sim.insert(0, result.states_before[real.name])
        rows_by_message = [_compare_fields(real.name, real.values, m.values) for m in sim]
        if not rows_by_message:
            rows.append((real.name, "(missing)", real.values, "–"))
        elif all(rows_by_message):
            rows += min(rows_by_message, key=len)
    return rows


def _compare_end(dialogue: Dialogue, result: DialogueResult) -> list[Row]:
    rows: list[Row] = []
    for name in ("armed", "custom_mode", "landed_state"):
        real = dialogue["state_after"].get(name)
        sim = list(dict.fromkeys(state[name] for state in result.states))
        if real is not None and real not in sim:
            rows.append(("(state after)", name, real, sim))
    for name, real in dialogue.get("echo_at_end", {}).items():
        sim = result.echoed_fields.get(name.upper(), {})
        for field, value in (real or {}).items():
            if name == "local_position_ned" or field.startswith("time"):
                continue
            if not same(python_value(value), _plain_value(sim.get(field)), ECHO_TOLERANCE.get(field)):
                rows.append((f"(echo) {name.upper()}", field, value, _plain_value(sim.get(field))))
    return rows
