"""Flies recorded stimuli on the simulated PX4 by MAVLink, in simulated time, all flights in one simulation.

Each vehicle is first brought to the initial state of its recording, then it receives the same messages at the
same times. Sensors have no noise: drift caused by GPS noise is not part of the response.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vehicle_sim import frames
from vehicle_sim.autopilot.offboard import PUBLISH_EVERY_S
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import V1_16
from vehicle_sim.simulation import SimulationOrigin

from .flight_recordings import Recording
from .ros2_recordings import INTERNAL

FloatArray = NDArray[np.float64]
Script = Generator[None, None, None]

OFFBOARD, HOLD, ORBIT = 0x60000, 0x3040000, 0x1030000
"""Values of custom_mode."""
TAKEOFF, DO_ORBIT, DO_SET_MODE, DO_CHANGE_SPEED, DO_REPOSITION, ARM_DISARM = 22, 34, 176, 178, 192, 400
"""Numbers of MAVLink commands."""
POSITION_AND_YAW_MASK = 2552
BEFORE_START_S = -0.05
"""Time in a recording just before the first message of the stimulus."""
RECORD_EVERY_STEPS = 2
TIMEOUT_S = 150.0
HOVER_THRUST_SETTLING_S = 25.5
"""Time that the hover thrust estimate needs after the climb to settle, as it had in the recordings."""
OVERLAP_S = {"rate_yaw_pulse": 0.05, "att_pitch_m10_yaw_30": 0.3}
USUAL_OVERLAP_S = 0.45
"""Time for which both controllers were active after a change of the kind of setpoint. PX4 publishes the
active controllers twice a second, and no message shows the phase: it is estimated from each recording."""
NAN = math.nan
STATION_IDS = 255, 190
"""System and component id of the ground station."""
HOVER_LIMITS, HOVER_LIMITS_NOISY = (0.05, 0.3), (0.3, 1.5)
"""Limits of a hover on each axis: speed [m/s], distance from the goal [m]. With noise the estimate drifts."""
ORBIT_BEFORE_HOLD = (-20.0, 5.0, 1.0)
"""Radius, speed and yaw behaviour of the orbit before `orbit_to_hold` switches to Hold."""
STEADY_ORBIT_M = 21.05
"""The radius of that orbit in steady state."""
CENTRE_M = {"orbit_r10_v3": (0.01, -0.49)}
"""Centre of a commanded orbit in the local frame of its recording (north, east), calculated from the recorded
headings. The origin of that frame has the GPS error of the moment when it was set."""
CRUISE_SPEED_M_S = {"reposition_50m_then_stop": 8.0}
"""Cruise speed remaining from the previous flight [m/s]."""


@dataclass(frozen=True, slots=True)
class Replay:
    """The motion of the simulated vehicle; the columns have the recordings' names."""

    t_s: FloatArray
    columns: dict[str, FloatArray]


class CannotStart(Exception):
    """The initial state of a recording was not reached."""


class _StimulusPlayer:
    """The ground station of one vehicle: prepares it and sends it the stimulus of one recording."""

    def __init__(
        self, sim: SimulatedFleet, row: int, recording: Recording, hover_limits: tuple[float, float]
    ) -> None:
        self.sim = sim
        self.row = row
        self.recording = recording
        self._hover_limits = hover_limits
        self.began_s = NAN
        self._sequence = 0
        self._heartbeat_s = 0.0
        self._parser = FrameParser()
        self.script = self._fly()

    # --- sending ---------------------------------------------------------------------------------------

    def send(self, name: str, fields: dict[str, Any]) -> None:
        values = {key: NAN if value is None else value for key, value in fields.items()}
        values.pop("description", None)
        if name != "HEARTBEAT":
            values |= {"target_system": self.sim.nodes[self.row].system_id, "target_component": 1}
        layout, payload = pack(name, **values)
        self._sequence = (self._sequence + 1) & 0xFF
        self.sim.feed(self.row, "gcs", frame_v2(layout, payload, self._sequence, *STATION_IDS))

    def send_stimulus(self, name: str, fields: dict[str, Any]) -> None:
        """Sends one message of the stimulus: by MAVLink, or by the simulator's internal interface."""
        if name in INTERNAL:
            getattr(self.sim.autopilots[self.row].offboard, name)(**fields)
        else:
            self.send(name, self._with_local_centre(name, fields))

    def command(self, number: int, *parameters: float) -> None:
        self.send(
            "COMMAND_LONG", {"command": number} | {f"param{n + 1}": v for n, v in enumerate(parameters)}
        )

    def reposition(self, north_m: float, east_m: float, alt_m: float, yaw_rad: float) -> None:
        lat_deg, lon_deg = self._lat_lon(north_m, east_m)
        self.send(
            "COMMAND_INT",
            {"command": DO_REPOSITION, "param1": -1.0, "param2": 1.0, "param4": yaw_rad,
             "x": round(lat_deg * 1e7), "y": round(lon_deg * 1e7),
             "z": self.sim.simulation.origin.alt_amsl_m + alt_m},
        )  # fmt: skip

    def _lat_lon(self, north_m: float, east_m: float) -> tuple[float, float]:
        home = self.sim.simulation.origin
        lat = home.lat_deg + math.degrees(north_m / 6371000.0)
        return lat, home.lon_deg + math.degrees(east_m / 6371000.0 / math.cos(math.radians(home.lat_deg)))

    # --- state -----------------------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        return self.sim.time_s

    @property
    def position(self) -> FloatArray:
        return self.sim.simulation.estimate.position_ned_m[self.row]

    @property
    def mode(self) -> int:
        return self.sim.autopilots[self.row].commander.custom_mode()

    def _is_hovering(self, goal: Sequence[float]) -> bool:
        max_speed_m_s, radius_m = self._hover_limits
        speed = float(np.abs(self.sim.simulation.estimate.velocity_ned_m_s[self.row]).max())
        return speed < max_speed_m_s and float(np.abs(self.position - np.asarray(goal)).max()) < radius_m

    # --- waiting ---------------------------------------------------------------------------------------

    def tick(self) -> None:
        """Called once per simulation step."""
        if self.now_s >= self._heartbeat_s:
            self.send("HEARTBEAT", {"type": 6, "autopilot": 8, "mavlink_version": 3})  # a ground station
            self._heartbeat_s += 1.0
        if self.script is not None and next(self.script, self) is self:  # the script has ended
            self.script = None

    def _wait(self, seconds: float) -> Script:
        end_s = self.now_s + seconds - 1e-6
        while self.now_s < end_s:
            yield

    def _wait_until(
        self, condition: Callable[[], bool], what: str, on_step: Callable[[], None] | None = None
    ) -> Script:
        start_s = self.now_s
        while not condition():
            if self.now_s - start_s > TIMEOUT_S:
                raise CannotStart(
                    f"{self.recording.name}: {what}, at {self.position.round(2)} in {self.mode:#x}"
                )
            if on_step is not None:
                on_step()
            yield

    # --- flying ----------------------------------------------------------------------------------------

    def _fly(self) -> Script:
        yield from self._prepare()
        yield from self._upload(self.recording.mission)
        self.began_s = start_s = self.now_s
        for at_s, name, fields in self.recording.messages():
            while self.now_s - start_s < at_s - 1e-6:
                yield
            self.send_stimulus(name, fields)

    def _with_local_centre(self, name: str, fields: dict[str, Any]) -> dict[str, Any]:
        """The fields of a command; an orbit's centre is at the same local position as in the recording."""
        centre = CENTRE_M.get(self.recording.name)
        if centre is None or name != "COMMAND_INT":
            return fields
        lat_deg, lon_deg = self._lat_lon(*centre)
        return fields | {"x": round(lat_deg * 1e7), "y": round(lon_deg * 1e7)}

    def _prepare(self) -> Script:
        recording, autopilot = self.recording, self.sim.autopilots[self.row]
        yield from self._wait(3.0)
        yield from self._wait_until(
            lambda: autopilot.commander.report.armable(autopilot.commander.intended), "arming"
        )
        if not recording.at("armed", BEFORE_START_S):
            yield from self._wait(8.0)
            return
        names = ("x", "y", "z", "sx", "sy", "sz", "syaw")
        column = {name: recording.at(name, BEFORE_START_S) for name in names}
        height_m = -column["sz"]
        self.command(ARM_DISARM, 1)
        yield from self._wait(0.1)
        self.command(
            TAKEOFF, -1, 0, 0, NAN, NAN, NAN, self.sim.simulation.origin.alt_amsl_m + max(2.5, height_m)
        )
        yield from self._wait_until(lambda: self.mode == HOLD, "take-off")
        mode = int(recording.at("custom_mode", BEFORE_START_S))
        if mode == OFFBOARD:
            yield from self._hold_by_setpoints(height_m, column["syaw"])
        elif mode == ORBIT:
            yield from self._orbit(height_m)
        else:
            goal = (column["x"], column["y"], -height_m)
            self.reposition(goal[0], goal[1], height_m, column["syaw"])
            yield from self._wait(2.0)
            yield from self._wait_until(lambda: self._is_hovering(goal), f"arriving at {goal}")
            yield from self._wait(10.0)
            if recording.name in CRUISE_SPEED_M_S:
                self.command(DO_CHANGE_SPEED, 1, CRUISE_SPEED_M_S[recording.name], -1)
                yield from self._wait(0.1)

    def _hold_by_setpoints(self, height_m: float, yaw_rad: float) -> Script:
        fields = {"coordinate_frame": 1, "type_mask": POSITION_AND_YAW_MASK, "x": 0.0, "y": 0.0,
                  "z": -height_m, "yaw": yaw_rad}  # fmt: skip
        due_s = self.now_s

        def stream() -> None:
            nonlocal due_s
            if self.now_s >= due_s:
                self.send("SET_POSITION_TARGET_LOCAL_NED", fields)
                due_s += 1.0 / 30.0

        begin_s = self.now_s + 0.5
        yield from self._wait_until(lambda: self.now_s > begin_s, "streaming", stream)
        self.command(DO_SET_MODE, 1, 6)
        offboard_since_s = self.now_s
        end_s = self.now_s + 3.0
        goal = (0.0, 0.0, -height_m)
        yield from self._wait_until(lambda: self.now_s > end_s and self._is_hovering(goal), "holding", stream)
        phase_s = self.recording.control_change_s % PUBLISH_EVERY_S
        if math.isnan(phase_s):
            phase_s = OVERLAP_S.get(self.recording.name, USUAL_OVERLAP_S)
        settled_s = self.now_s + HOVER_THRUST_SETTLING_S - offboard_since_s
        # The change to Offboard published the controllers; from then on they are published at every period.
        end_s = offboard_since_s + math.ceil(settled_s / PUBLISH_EVERY_S) * PUBLISH_EVERY_S - phase_s
        yield from self._wait_until(lambda: self.now_s > end_s, "holding", stream)

    def _orbit(self, height_m: float) -> Script:
        radius_m, speed_m_s, behaviour = ORBIT_BEFORE_HOLD
        self.reposition(0.0, 0.0, height_m, self.recording.at("syaw", BEFORE_START_S))
        yield from self._wait(6.0)
        before_start = self.recording.t_s < 0.0
        columns = {name: self.recording.columns[name][before_start] for name in ("x", "y", "vx", "vy")}
        speeds_m_s = np.hypot(columns["vx"], columns["vy"])
        # The velocity is tangential to the circle, the centre lies to its left.
        centre_n = float(np.mean(columns["x"] + STEADY_ORBIT_M * columns["vy"] / speeds_m_s))
        centre_e = float(np.mean(columns["y"] - STEADY_ORBIT_M * columns["vx"] / speeds_m_s))
        lat_deg, lon_deg = self._lat_lon(centre_n, centre_e)
        self.send(
            "COMMAND_INT",
            {"command": DO_ORBIT, "param1": radius_m, "param2": speed_m_s, "param3": behaviour, "param4": NAN,
             "x": round(lat_deg * 1e7), "y": round(lon_deg * 1e7),
             "z": self.sim.simulation.origin.alt_amsl_m + height_m},
        )  # fmt: skip
        yield from self._wait(30.0)
        goal_rad = math.atan2(self.recording.at("y", 0.0) - centre_e, self.recording.at("x", 0.0) - centre_n)

        def is_at_goal() -> bool:
            angle_rad = math.atan2(self.position[1] - centre_e, self.position[0] - centre_n)
            return abs(math.remainder(angle_rad - goal_rad, math.tau)) < 0.01

        yield from self._wait_until(is_at_goal, "orbiting to the start of the recording")

    def _upload(self, items: list[dict[str, Any]]) -> Script:
        if not items:
            return
        self.sim.drain(self.row, "gcs")
        self.send("MISSION_COUNT", {"count": len(items), "mission_type": 0})
        acknowledged: list[bool] = []

        def answer_requests() -> None:
            for message in self._parser.feed(self.sim.drain(self.row, "gcs")):
                if message.name in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                    self.send("MISSION_ITEM_INT", items[message.seq])
                elif message.name == "MISSION_ACK":
                    acknowledged.append(True)

        yield from self._wait_until(lambda: bool(acknowledged), "mission upload", answer_requests)


def fly(recordings: Sequence[Recording], *, noise: bool = False, seed: int = 0) -> dict[str, Replay]:
    """Flies all recordings in one simulation; returns the motion of each vehicle by the recording's name.

    Args:
        recordings: the recordings.
        noise: whether the sensors have noise.
        seed: seed of that noise.

    Raises:
        CannotStart: a vehicle did not reach the initial state of its recording.
    """
    count = len(recordings)
    supported = Parameters(px4=V1_16)
    stores = [
        Parameters(
            {name: value for name, value in recording.parameters.items() if name in supported}, px4=V1_16
        )
        for recording in recordings
    ]
    sim = SimulatedFleet(
        count, stores=stores, links=(("gcs", "gcs"),), origin=SimulationOrigin(), sensor_noise=noise,
        seed=seed, start_ned_m=np.zeros((count, 3)),
    )  # fmt: skip
    for row in range(count):
        _stop_streams(sim, row)
    hover_limits = HOVER_LIMITS_NOISY if noise else HOVER_LIMITS
    players = [_StimulusPlayer(sim, row, recording, hover_limits) for row, recording in enumerate(recordings)]
    log = _MotionLog(sim)
    step_s = sim.simulation.dt_s
    is_flying = True
    while is_flying:
        for player in players:
            player.tick()
        sim.step(step_s)
        if sim.simulation.steps % RECORD_EVERY_STEPS == 0:
            log.add_row()
        is_flying = any(
            math.isnan(player.began_s)
            or player.now_s - player.began_s < float(player.recording.t_s[-1]) + 0.1
            for player in players
        )
    return {player.recording.name: log.replay_of(player) for player in players}


def _stop_streams(sim: SimulatedFleet, row: int) -> None:
    """Stops all streams: nothing reads them, and they take most of the computing time."""
    for context_link in sim.nodes[row].context.links:
        for msg_id in context_link.streamed_ids():
            context_link.set_interval(msg_id, 0, 0)


LOGGED = (
    "x", "y", "z", "vx", "vy", "vz", "qw", "qx", "qy", "qz", "p", "q", "r", "tqw", "tqx", "tqy", "tqz",
    "thrust", "sx", "sy", "sz", "svx", "svy", "svz", "sax", "say", "saz", "syaw",
    "m1_us", "m2_us", "m3_us", "m4_us", "armed", "custom_mode", "landed_state",
)  # fmt: skip


class _MotionLog:
    def __init__(self, sim: SimulatedFleet) -> None:
        self._sim = sim
        self._times: list[float] = []
        self._rows: list[list[FloatArray]] = []

    def add_row(self) -> None:
        simulation = self._sim.simulation
        estimate, target = simulation.estimate, simulation.target
        commanders = [autopilot.commander for autopilot in self._sim.autopilots]
        state = [(c.armed, c.custom_mode(), int(c.landed_state())) for c in commanders]
        self._times.append(simulation.time_s)
        self._rows.append(
            [
                array.copy()
                for array in (
                    estimate.position_ned_m, estimate.velocity_ned_m_s, estimate.q_ned_frd,
                    estimate.rates_frd_rad_s, target.q_ned_frd, target.thrust[:, None],
                    target.position_ned_m, target.velocity_ned_m_s, target.acceleration_ned_m_s2,
                    target.yaw_ned_rad[:, None], simulation.motors_us, np.array(state, dtype=float),
                )
            ]
        )  # fmt: skip

    def replay_of(self, player: _StimulusPlayer) -> Replay:
        t_s = np.array(self._times) - player.began_s
        in_recording = (t_s >= player.recording.t_s[0] - 0.1) & (t_s <= player.recording.t_s[-1] + 0.1)
        rows = [row for row, keep in zip(self._rows, in_recording, strict=True) if keep]
        table = np.array([np.concatenate([block[player.row] for block in row]) for row in rows])
        return Replay(t_s[in_recording], dict(zip(LOGGED, table.T, strict=True)))


def with_angles(columns: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """The same columns with roll, pitch and (unwrapped) yaw."""
    q = np.stack([columns[name] for name in ("qw", "qx", "qy", "qz")], axis=1)
    euler = frames.euler_of(q)
    yaw = euler[:, 2]
    finite = np.isfinite(yaw)
    yaw = np.interp(np.arange(len(yaw)), np.flatnonzero(finite), np.unwrap(yaw[finite]))
    return columns | {"roll": euler[:, 0], "pitch": euler[:, 1], "yaw": yaw}
