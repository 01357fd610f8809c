"""The simulated vehicle of a replay: its clock, its messages, and functions that bring it to a starting
state."""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.contract.recordings import TELEMETRY, python_value
from vehicle_sim.autopilot.announcer import Announcer, Event, StatusText
from vehicle_sim.autopilot.health import CheckResults, send_report
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.dialect import BY_NAME, pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.px4_version import V1_16, Px4Version
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.storage.metadata import built_in

RECORDINGS_FOLDER = Path(__file__).resolve().parents[3] / "shared" / "px4"
RECORDED_FILE_NAMES = {"all_events.json.xz": "events.json.xz"}
"""Names of the simulator's files, and their names in the recordings."""
TICK_S = 0.02
SETPOINT_PERIOD_S = 0.05
REARM_AFTER_S = 4.0
"""A vehicle that has been armed on the ground for this time is armed again before a dialogue: PX4 disarms
after 10 s, and the recording armed the vehicle shortly before each dialogue."""
HOLD_CUSTOM_MODE = 0x3040000
"""custom_mode of Hold."""
TAKEOFF, DO_SET_MODE, DO_REPOSITION, ARM_DISARM = 22, 176, 192, 400
FORCE_DISARM = 21196
"""param2 of ARM_DISARM that disarms also in flight."""
NAN = math.nan


@dataclass(frozen=True, slots=True)
class Received:
    """One message from the vehicle; `dt_s` since the dialogue's first message."""

    dt_s: float
    name: str
    values: dict[str, Any]


def _files_of_the_recorded_build(px4: Px4Version) -> dict[str, Callable[[], bytes]]:
    """The files that the recorded vehicle served below `etc`, if they are beside the checkout, otherwise the
    simulator's."""
    folder = RECORDINGS_FOLDER if px4 is V1_16 else RECORDINGS_FOLDER / f"v{px4.name}"
    return {
        path: recorded.read_bytes
        if (recorded := folder / RECORDED_FILE_NAMES.get(name, name)).is_file()
        else create
        for path, create in built_in(px4).items()
        if (name := path.rpartition("/")[2])
    }


class Vehicle:
    """One simulated vehicle, and the link of a ground station to it."""

    def __init__(
        self,
        system_id: int,
        parameters: dict[str, float],
        *,
        heartbeats: bool = True,
        log: bool = False,
        px4: Px4Version = V1_16,
    ) -> None:
        self.parameters = parameters
        self.heartbeats = heartbeats
        files = [VehicleFiles(None, _files_of_the_recorded_build(px4))]
        self.sim = SimulatedFleet(
            first_instance=system_id - 1, px4=px4, parameters=parameters, files=files, log=log
        )
        self.system_id = system_id
        self.autopilot = self.sim.autopilots[0]
        self.commander = self.autopilot.commander
        self.compared_ids = {
            layout.id for name, layout in BY_NAME.items() if name not in TELEMETRY - {"PING"}
        }
        self.log: list[tuple[float, str, str, dict[str, Any]]] = []
        self.newest_messages: dict[tuple[str, str], tuple[float, dict[str, Any]]] = {}
        self.reports: list[list[Received]] = []
        """Arming reports as the messages that the vehicle sends, the newest last."""
        self._published_report: CheckResults | None = None
        self.states: list[tuple[float, dict[str, Any]]] = []
        """Armed, mode and landed state, and the time of the change."""
        self.message_counts: dict[int, int] = {}
        self._omit_uncompared_streams()
        self._parsers = {name: FrameParser() for name in ("gcs", "api")}
        self._sequence = 0
        self._next_heartbeat_s = 0.0
        self.background_setpoint: dict[str, Any] | None = None
        """Fields of the setpoint that is streamed in addition to the dialogue's messages; None: no stream."""
        self._next_setpoint_s = 0.0

    @property
    def now_s(self) -> float:
        return self.sim.time_s

    @property
    def altitude_m(self) -> float:
        """Altitude above the local origin."""
        return -float(self.sim.simulation.truth.position_ned_m[0, 2])

    @property
    def speed_m_s(self) -> float:
        return math.sqrt(sum(v * v for v in self.sim.simulation.truth.velocity_ned_m_s[0].tolist()))

    def _omit_uncompared_streams(self) -> None:
        """Omits the streams that no dialogue compares, because their encoding takes most of the time."""
        telemetry = self.sim.nodes[0].context.telemetry
        encode = telemetry.payload
        telemetry.payload = lambda msg_id: encode(msg_id) if msg_id in self.compared_ids else None  # type: ignore[method-assign]

    def send(self, name: str, fields: dict[str, Any], link: str = "gcs", src: tuple[int, int] = (255, 190)):
        layout, payload = pack(name, **fields)
        self._sequence = (self._sequence + 1) & 0xFF
        self.sim.feed(0, link, frame_v2(layout, payload, self._sequence, *src))

    def command(self, number: int, *values: float) -> None:
        fields = {f"param{n + 1}": value for n, value in enumerate(values)}
        fields |= {"target_system": self.system_id, "target_component": 1, "command": number}
        self.send("COMMAND_LONG", fields)

    def set_parameter(self, name: str, value: float) -> None:
        """Sends PARAM_SET in the encoding of the parameter's type."""
        integer = self.sim.simulation.parameters[0].type_of(name) == "INT32"
        raw = struct.pack("<i", int(value)) if integer else struct.pack("<f", value)
        fields = {"target_system": self.system_id, "target_component": 1, "param_id": name,
                  "param_value": struct.unpack("<f", raw)[0], "param_type": 6 if integer else 9}  # fmt: skip
        self.send("PARAM_SET", fields)

    def run_to(self, end_s: float, tick_s: float = TICK_S) -> None:
        while self.now_s < end_s - 1e-6:
            if self.heartbeats and self.now_s >= self._next_heartbeat_s:
                self.send("HEARTBEAT", {"type": 6, "autopilot": 8, "mavlink_version": 3})
                self._next_heartbeat_s = self.now_s + 1.0
            if self.background_setpoint is not None and self.now_s >= self._next_setpoint_s:
                self.send("SET_POSITION_TARGET_LOCAL_NED", self.background_setpoint, "api")
                self._next_setpoint_s = self.now_s + SETPOINT_PERIOD_S
            self.sim.step(min(tick_s, max(end_s - self.now_s, 0.004)))
            self.collect()

    def run(self, seconds: float, on_tick: Callable[[], None] | None = None, tick_s: float = TICK_S) -> None:
        end_s = self.now_s + seconds
        if on_tick is None:
            self.run_to(end_s)
            return
        while self.now_s < end_s - 1e-6:
            on_tick()
            self.run_to(min(end_s, self.now_s + tick_s), min(tick_s, TICK_S))

    def run_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        end_s = self.now_s + timeout_s
        while not condition() and self.now_s < end_s:
            self.run(0.1)
        return condition()

    def collect(self) -> None:
        state = self.state()
        if not self.states or state != self.states[-1][1]:
            self.states.append((self.now_s, state))
        report = self.commander.report
        if report is not self._published_report and report != self._published_report:
            self._published_report = report
            self.reports.append(_report_messages(report))
        for link, parser in self._parsers.items():
            for frame in self.sim.frames(0, link):
                msg_id = frame[7] | frame[8] << 8 | frame[9] << 16
                if link == "gcs":
                    self.message_counts[msg_id] = self.message_counts.get(msg_id, 0) + 1
                if msg_id not in self.compared_ids:
                    continue
                for message in parser.feed(frame):
                    if (message.system_id, message.component_id) == (self.system_id, 1):
                        self._record(link, message.name, message.values)

    def _record(self, link: str, name: str, values: dict[str, Any]) -> None:
        self.log.append((self.now_s, link, name, values))
        self.newest_messages[link, name] = self.now_s, values

    def state(self) -> dict[str, Any]:
        commander = self.commander
        return {
            "armed": commander.armed,
            "custom_mode": commander.custom_mode(),
            "landed_state": int(commander.landed_state()),
        }

    def ready(self) -> bool:
        return self.commander.report.armable(self.commander.intended)

    # --- starting states -------------------------------------------------------------------------------

    def hover_in_hold(self) -> None:
        """Brings the vehicle from any state to Hold at 10 m above home."""
        if not self.commander.armed:
            self.run_until(self.ready, 15)
            self.command(DO_SET_MODE, 1, 4, 3)
            self.run(0.1)
            self.command(ARM_DISARM, 1)
            self.run(0.1)
            self.command(TAKEOFF, -1, 0, 0, NAN, NAN, NAN, self.autopilot.home.alt_amsl_m + 10)
            self.run_until(
                lambda: self.state()["custom_mode"] == HOLD_CUSTOM_MODE and self.altitude_m > 8.5, 40
            )
            self.run(3.0)
        elif self.state()["custom_mode"] != HOLD_CUSTOM_MODE:
            self.command(DO_SET_MODE, 1, 4, 3)
            self.run(0.4)
        self.run_until(lambda: self.speed_m_s < 1.0, 8)

    def hover_in_offboard(self) -> None:
        """Brings the vehicle to Offboard at 10 m, and then stops the stream of setpoints."""
        if not 6 < self.altitude_m < 16:
            self.hover_in_hold()
        self.stream_setpoints(True)
        self.run(0.6)
        self.command(DO_SET_MODE, 1, 6)
        self.run(1.0)
        self.stream_setpoints(False)

    def stream_setpoints(self, on: bool) -> None:
        """Starts or stops a 20 Hz stream of position setpoints 10 m above the local origin."""
        setpoint = {"target_system": self.system_id, "target_component": 1, "coordinate_frame": 1,
                    "type_mask": 2552, "z": -10.0}  # fmt: skip
        self.background_setpoint = setpoint if on else None

    def put_on_ground(self, armed: bool, custom_mode: int) -> None:
        """Brings the vehicle to the ground and into this arming state and mode."""
        armed_at_s = [at_s for at_s, _ in itertools.takewhile(lambda e: e[1]["armed"], reversed(self.states))]
        about_to_disarm = armed and bool(armed_at_s) and self.now_s - armed_at_s[-1] > REARM_AFTER_S
        if (
            self.commander.armed != armed
            or about_to_disarm
            or (armed and self.state()["custom_mode"] != custom_mode)
        ):
            self.command(ARM_DISARM, 0, FORCE_DISARM)
            self.run(0.1)
            self.run_until(lambda: self.commander.landed, 2)
        self.run_until(self.ready, 4)
        if armed and not self.commander.armed:
            self.command(DO_SET_MODE, 1, 4, 3)
            self.run(0.1)
            self.command(ARM_DISARM, 1)
            self.run(0.1)
        if self.state()["custom_mode"] != custom_mode:
            self.command(DO_SET_MODE, 1, custom_mode >> 16 & 0xFF, custom_mode >> 24)
            self.run(0.2)

    def upload(self, plan: list[dict[str, Any]], *, floats: bool = False) -> None:
        """Uploads a mission, fence or rally points; `floats`: as MISSION_ITEM with float coordinates."""
        mission_type = plan[0]["mission_type"]
        target = {"target_system": self.system_id, "target_component": 1, "mission_type": mission_type}
        self.send("MISSION_COUNT", {"count": len(plan), **target})
        for item in plan:
            fields = {key: python_value(value) for key, value in item.items() if key != "target_system"}
            if floats:
                frame = {6: 3, 5: 0}.get(fields["frame"], fields["frame"])
                fields |= {"x": fields["x"] / 1e7, "y": fields["y"] / 1e7, "frame": frame}
            self.send("MISSION_ITEM" if floats else "MISSION_ITEM_INT", fields | target)

    def go_to(self, lat_e7: int, lon_e7: int, alt_amsl_m: float) -> None:
        """Flies to a position and stops there."""
        self.send(
            "COMMAND_INT",
            {"target_system": self.system_id, "target_component": 1, "command": DO_REPOSITION, "param1": -1,
             "param2": 1, "param4": NAN, "x": lat_e7, "y": lon_e7, "z": alt_amsl_m},
        )  # fmt: skip
        self.run(1.5)
        self.run_until(lambda: self.speed_m_s < 0.3, 60)


def _report_messages(report: CheckResults) -> list[Received]:
    announcer, sent = Announcer(lambda: 0), list[Received]()

    def record(item: StatusText | Event) -> None:
        if isinstance(item, Event):
            values = {"id": item.id, "log_levels": item.log_levels, "arguments": item.arguments}
            sent.append(Received(0.0, "EVENT", values))

    announcer.add_listener(record)
    send_report(report, announcer)
    return sent
