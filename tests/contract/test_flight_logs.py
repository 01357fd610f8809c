"""Logged flights of a real PX4: the simulated vehicle sends the same messages.

The log contains the messages of the ground station; the tests send them again at the same times on a fake
clock. They compare the number of each message, and the changes of mode, texts, events, target position and
gimbal.
"""

import gzip
import itertools
import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from gcs_server.replay.records import TIME_BYTES
from tests.unit.vehicle_sim.sim_station import EVENT_NAMES, GCS_AND_API_LINKS, Station
from vehicle_sim.mavlink.framing import FrameParser
from vehicle_sim.px4_version import V1_16

FLIGHTS = {
    "flight-takeoff-reposition-orbit-gimbal-rtl": ("gcs", {}),
    "mission-pause-resume": ("gcs", {}),
    "failsafe-datalink-rtl": ("gcs", {"NAV_DLL_ACT": 2}),
    "offboard-api": ("api", {}),
}
"""Logs that contain all messages to the vehicle: the logged link, and the parameters that were set before the
flight."""
AUTOPILOT, API_CLIENT = 1, 245
READY_S = 5.0
"""After this time both estimators are ready; the simulated estimator is ready earlier than PX4's."""
MIN_COUNT, COUNT_TOLERANCE = 10, 0.1
ALTITUDE_TOLERANCE_M = 1.5
NOT_STREAMED = {"PARAM_VALUE", "STATUSTEXT", "EVENT", "COMMAND_ACK", "COMMAND_LONG", "AVAILABLE_MODES"}

Received = list[tuple[float, str, dict[str, Any]]]
"""Seconds since the log began, message name and fields of each message."""
Sent = list[tuple[float, tuple[int, int], str, dict[str, Any]]]
"""Seconds since the log began, sender, message name and fields of each message."""


def read_log(path: Path) -> tuple[Received, Sent, float]:
    """The vehicle's messages, the messages sent to it, and the vehicle's time since boot when the log began
    [s]."""
    raw = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    messages: Received = []
    sent: Sent = []
    offset, began_us, boot_s = 0, 0, None
    while offset + TIME_BYTES < len(raw):
        time_us = int.from_bytes(raw[offset : offset + TIME_BYTES], "big")
        began_us = began_us or time_us
        offset += TIME_BYTES
        assert raw[offset] == 0xFD
        size = 12 + raw[offset + 1]
        for message in FrameParser().feed(raw[offset : offset + size]):
            time_s, fields = (time_us - began_us) / 1e6, dict(message.values)
            if message.component_id != AUTOPILOT:
                sent.append((time_s, message.sender, message.name, fields))
                continue
            messages.append((time_s, message.name, fields))
            if boot_s is None and message.name == "ATTITUDE":
                boot_s = fields["time_boot_ms"] / 1e3 - time_s
        offset += size
    assert boot_s is not None
    return messages, sent, boot_s


def replay(sent: Sent, boot_s: float, end_s: float, link: str, parameters: dict[str, float]) -> Received:
    """Replays the sent messages; returns the simulated vehicle's messages on `link`."""
    station = Station(heartbeats=False, parameters=parameters, links=GCS_AND_API_LINKS, px4=V1_16)
    for time_s, sender, name, fields in sent:
        station.run(max(0.0, boot_s + time_s - station.now_s))
        if fields.get("target_system"):
            fields = {**fields, "target_system": station.system_id}
        station.send(name, via="api" if sender[0] == API_CLIENT else "gcs", sender=sender, **fields)
    station.run(boot_s + end_s - station.now_s)
    return [(time_s - boot_s, m.name, dict(m.values)) for time_s, via, m in station.log if via == link]


def changed_values(
    received: Received, name: str, value_of: Any, until_s: float, lasting_s: float = 0.0
) -> list[Any]:
    """The values that `value_of` returns for a message's fields, each time the value changes for at least
    `lasting_s`."""
    values = [
        (time_s, value_of(fields))
        for time_s, n, fields in received
        if n == name and READY_S < time_s < until_s
    ]
    runs = itertools.groupby((row for row in values if row[1] is not None), key=lambda row: row[1])
    spans = [(value, [time_s for time_s, _ in run]) for value, run in runs]
    kept = [value for value, times_s in spans if times_s[-1] - times_s[0] >= lasting_s]
    return [value for value, _ in itertools.groupby(kept)]


def altitude_steps(altitudes_m: list[float]) -> list[float]:
    """Only altitudes that differ from the previous one by more than `ALTITUDE_TOLERANCE_M`."""
    steps_m = altitudes_m[:1]
    for altitude_m in altitudes_m:
        if abs(altitude_m - steps_m[-1]) > ALTITUDE_TOLERANCE_M:
            steps_m.append(altitude_m)
    return steps_m


def text_without_numbers(fields: dict[str, Any]) -> str | None:
    """A text without its numbers; None for a text that only a vehicle with an onboard log sends."""
    text = str(fields["text"])
    return None if "[logger]" in text else re.sub(r"\d+", "#", text)


def event_name(fields: dict[str, Any]) -> str | None:
    name = EVENT_NAMES.get(fields["id"], str(fields["id"]))
    return None if name.startswith("logger") else name


def disarming_time_s(received: Received) -> float:
    armed_s = [t for t, n, f in received if n == "HEARTBEAT" and f["base_mode"] & 128]
    return armed_s[-1] + 1.5


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_simulated_flight_sends_the_messages_of_the_logged_flight(
    recordings_folder: Path, name: str
) -> None:
    (path,) = (recordings_folder / "tlogs").glob(f"{name}.tlog*")
    real, sent, boot_s = read_log(path)
    end_s = real[-1][0]
    sim = replay(sent, boot_s, end_s, *FLIGHTS[name])

    message_counts = [Counter(n for t, n, _ in received if READY_S < t < end_s) for received in (real, sim)]
    different_counts = {
        n: (message_counts[0][n], message_counts[1][n])
        for n in message_counts[0] | message_counts[1]
        if n not in NOT_STREAMED
        and max(c[n] for c in message_counts) >= MIN_COUNT
        and abs(message_counts[0][n] - message_counts[1][n]) > COUNT_TOLERANCE * message_counts[0][n] + 2
    }
    assert not different_counts, "number of messages: PX4, simulator"

    until_s = [disarming_time_s(real), disarming_time_s(sim)]

    def changes_in_both(message: str, value_of: Any, lasting_s: float = 0.0) -> tuple[list[Any], list[Any]]:
        values = [
            changed_values(received, message, value_of, disarming_s, lasting_s)
            for received, disarming_s in zip((real, sim), until_s, strict=True)
        ]
        return values[0], values[1]

    for message, value_of in (
        ("HEARTBEAT", lambda f: (f["base_mode"] >> 7, hex(f["custom_mode"]), f["system_status"])),
        ("EXTENDED_SYS_STATE", lambda f: f["landed_state"]),
        ("STATUSTEXT", text_without_numbers),
        ("EVENT", event_name),
        ("OPEN_DRONE_ID_LOCATION", lambda f: f["status"]),
        ("MISSION_CURRENT", lambda f: f["seq"]),
        ("GIMBAL_MANAGER_STATUS", lambda f: f["flags"]),
    ):
        px4, simulated = changes_in_both(message, value_of)
        assert simulated == px4, message

    # Between attitude and position control PX4 controls velocity for 0.1 s; the simulator does not.
    px4, simulated = changes_in_both("POSITION_TARGET_LOCAL_NED", lambda f: f["type_mask"], lasting_s=0.3)
    assert simulated == px4, "controlled quantities"
    px4, simulated = changes_in_both("COMMAND_LONG", lambda f: f["command"])
    assert set(simulated) == set(px4), "commands to its own components"
    px4, simulated = (
        altitude_steps(values) for values in changes_in_both("POSITION_TARGET_GLOBAL_INT", lambda f: f["alt"])
    )
    assert simulated == [pytest.approx(altitude_m, abs=ALTITUDE_TOLERANCE_M) for altitude_m in px4], (
        "target positions"
    )
    px4, simulated = changes_in_both("TIME_ESTIMATE_TO_TARGET", lambda f: f["safe_return"])
    assert max(simulated, default=0) == pytest.approx(max(px4, default=0), abs=3), (
        "duration of the return [s]"
    )
