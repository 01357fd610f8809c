"""Flies recorded faults on the simulated PX4, all in one simulation without a real-time clock.

Each vehicle takes off to 10 m and holds, or stays on the ground, as in its recording. The fault occurs at the
same time after boot, caused by the same parameters, commands, drivers, or changes of the simulated world.
The result has the same values as the recordings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.autopilot.announcer import Event, StatusText
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.frames import euler_of, rotation_matrix, wrap_pi
from vehicle_sim.geodesy import to_global, to_local
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import frame_v2
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import V1_16
from vehicle_sim.sensors.suite import Driver

from .fault_recordings import (
    EVENTS,
    TIMES_S,
    FaultFlight,
    Scenario,
    compared_text,
    is_compared,
    record_change,
)

FloatArray = NDArray[np.float64]

ARM_AT_S = 6.0
HEIGHT_M = 10.0
RETURN_TO_LAUNCH, TAKEOFF, DO_SET_MODE, DO_REPOSITION, ARM_DISARM = 20, 22, 176, 192, 400
"""Numbers of MAVLink commands."""
OUTBOUND_AT_S, OUTBOUND_M = 18.0, 60.0
"""Time and length of the flight to the north before a return to launch."""
RECORD_EVERY_STEPS = 5
OFFBOARD, POSITION = 6, 3
"""PX4's main modes."""
MODE_AFTER_S = 1.0
"""Time from the start of a stream of setpoints or sticks to the switch to the mode that uses it."""
MODE_FOR_MESSAGE = {"SET_POSITION_TARGET_LOCAL_NED": OFFBOARD, "MANUAL_CONTROL": POSITION}
NAN = math.nan
STATION_IDS = 255, 190
"""System and component id of the ground station."""


class _ScenarioPlayer:
    """Sends one vehicle the messages of its scenario and causes the faults."""

    def __init__(self, sim: SimulatedFleet, row: int, scenario: Scenario) -> None:
        self.sim, self.row, self.scenario = sim, row, scenario
        self._sequence = 0
        self._scheduled_calls: list[tuple[float, Callable[[], None]]] = []
        if scenario.flies:
            self._schedule(ARM_AT_S, self._command, ARM_DISARM, 1)
            altitude_m = sim.simulation.origin.alt_amsl_m + HEIGHT_M
            self._schedule(ARM_AT_S + 0.5, self._command, TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, altitude_m)
        if any(entry["fields"].get("command") == RETURN_TO_LAUNCH for entry in scenario.stimulus):
            self._schedule(OUTBOUND_AT_S, self._fly_north)
        for entry in scenario.stimulus:
            self._schedule_stimulus(entry)
        for second in range(int(scenario.after_boot_s + scenario.ends_s) + 1):
            heartbeat = {"type": 6, "autopilot": 8, "mavlink_version": 3}  # a ground station
            self._schedule(float(second), self._send, "HEARTBEAT", heartbeat)
        self._scheduled_calls.sort(key=lambda each: each[0], reverse=True)

    def _schedule(self, time_s: float, call: Callable[..., None], *arguments: Any) -> None:
        self._scheduled_calls.append((time_s, lambda: call(*arguments)))

    def _fly_north(self) -> None:
        """Flies 60 m north: the recorded vehicle returned to launch from there."""
        home = self.sim.simulation.origin
        lat, lon = to_global(np.asarray(OUTBOUND_M), np.asarray(0.0), home.lat_deg, home.lon_deg)
        self._command(DO_REPOSITION, -1.0, 1.0, 0.0, NAN, float(lat), float(lon), home.alt_amsl_m + HEIGHT_M)

    def _schedule_stimulus(self, entry: dict[str, Any]) -> None:
        name, fields = entry["message"], entry["fields"]
        at_s = self.scenario.after_boot_s + entry["t_s"]
        if "streamed_hz" in entry:
            every_s = 1.0 / entry["streamed_hz"]
            for k in range(int((self.scenario.after_boot_s + self.scenario.ends_s - at_s) / every_s)):
                self._schedule(at_s + k * every_s, self._send, name, {"coordinate_frame": 1} | fields)
            self._schedule(at_s + MODE_AFTER_S, self._command, DO_SET_MODE, 1, MODE_FOR_MESSAGE[name])
        elif name == "PARAM_SET":
            self._schedule(at_s, self.sim.set_parameter, self.row, fields["param_id"], fields["value"])
        elif name == "driver":
            self._schedule(at_s, self._control_driver, fields["command"])
        elif name == "model fault":
            self._schedule(at_s, self._set_world_faults, fields)
        else:
            self._schedule(at_s, self._send, name, fields)

    def tick(self) -> None:
        """Executes the calls that are due."""
        while self._scheduled_calls and self._scheduled_calls[-1][0] <= self.sim.time_s + 1e-9:
            self._scheduled_calls.pop()[1]()

    def _command(self, number: int, *parameters: float) -> None:
        fields = {f"param{n + 1}": value for n, value in enumerate(parameters)}
        self._send("COMMAND_LONG", {"command": number} | fields)

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        values = {key: NAN if value is None else value for key, value in fields.items()}
        if name == "SET_POSITION_TARGET_LOCAL_NED":
            values["coordinate_frame"] = 1  # MAV_FRAME_LOCAL_NED
        elif name == "MANUAL_CONTROL":
            values.pop("coordinate_frame", None)
        if name == "MANUAL_CONTROL":
            values["target"] = self.row + 1
        elif name != "HEARTBEAT":
            values |= {"target_system": self.row + 1, "target_component": 1}
        layout, payload = pack(name, **values)
        self._sequence = (self._sequence + 1) & 0xFF
        self.sim.feed(self.row, "gcs", frame_v2(layout, payload, self._sequence, *STATION_IDS))

    def _control_driver(self, command: str) -> None:
        """Stops or starts a sensor's driver, as a console command does."""
        driver, action = command.split()
        self.sim.simulation.set_driver(self.row, Driver(driver), action != "stop")

    def _set_world_faults(self, fields: dict[str, float]) -> None:
        """Sets the faults of the simulated world; faults not in `fields` are cleared."""
        simulation, i = self.sim.simulation, self.row
        faults = simulation.sensor_faults
        faults.clear(i)
        value_of = fields.get
        faults.gps_offset_ned_m[i] = value_of("gps_n", 0.0), value_of("gps_e", 0.0), 0.0
        faults.gps_offset_ned_m_s[i] = value_of("gps_vn", 0.0), value_of("gps_ve", 0.0), 0.0
        for driver in Driver:
            faults.stuck[driver][i] = bool(value_of(f"{driver.name.lower()}_stuck", 0))
        gyro, accel = (
            np.array([value_of(f"{kind}_{axis}", 0.0) for axis in "xyz"]) for kind in ("gyr", "acc")
        )
        faults.set_imu_offset(i, gyro, accel)
        simulation.set_wind(np.array([value_of("wind_n", 0.0), value_of("wind_e", 0.0), 0.0]), i)
        if "mot_off" in fields:
            simulation.motor_health[i, int(fields["mot_off"]) - 1] = 0.0


class _FlightRecorder:
    """Records one vehicle's flight, by the names in the recordings."""

    def __init__(self, sim: SimulatedFleet, row: int, scenario: Scenario) -> None:
        self._sim, self._row = sim, row
        self._fault_at_s, self._ends_s = scenario.after_boot_s, scenario.ends_s
        self._previous_flags: dict[str, int] = {}
        self.moments_s: dict[str, float] = {}
        self.errors_at: dict[float, dict[str, float]] = {}
        self._origin_m = np.zeros(3)
        self._start_m = np.zeros(3)
        sim.autopilots[row].announcer.add_listener(self._record_message)

    def _record_message(self, item: StatusText | Event) -> None:
        t_s = self._sim.time_s - self._fault_at_s
        if not 0.0 <= t_s <= self._ends_s:
            return
        if isinstance(item, Event):
            if item.name in EVENTS:
                self.moments_s.setdefault("event:" + item.name, t_s)
        elif is_compared(item.text):
            self.moments_s.setdefault("text:" + compared_text(item.text), t_s)

    def sample(self) -> None:
        """Records changed flags, and the errors at the times of comparison."""
        t_s = self._sim.time_s - self._fault_at_s
        flags = self._flags()
        if t_s >= 0.0:
            for name, value in flags.items():
                if value != self._previous_flags.get(name, value):
                    change = f"{name}+" if name.endswith("_counter") else f"{name}={value}"
                    record_change(self.moments_s, change, t_s)
        else:
            self._record_start()
        self._previous_flags = flags
        for time_s in TIMES_S:
            if time_s not in self.errors_at and t_s >= time_s:
                self.errors_at[time_s] = self._errors()

    def _flags(self) -> dict[str, int]:
        simulation, i = self._sim.simulation, self._row
        fusion, estimate, autopilot = simulation.fusion, simulation.estimate, self._sim.autopilots[i]
        commander, detector = autopilot.commander, autopilot.land_detector
        values_by_flag = {
            "cs_inertial_dead_reckoning": fusion.dead_reckoning,
            "fs_bad_acc_vertical": fusion.bad_acc_vertical,
            "xy_valid": estimate.valid_position, "z_valid": estimate.valid_altitude,
        }  # fmt: skip
        for name in (
            "gnss_pos", "gnss_vel", "gps_hgt", "baro_hgt", "baro_fault", "fake_hgt", "valid_fake_pos", "mag",
            "mag_3d", "mag_aligned_in_flight", "mag_heading_consistent", "mag_field_disturbed",
            "vehicle_at_rest", "in_air",
        ):  # fmt: skip
            values_by_flag["cs_" + name] = getattr(fusion, name)
        for name in (
            "heading_reset_counter", "xy_reset_counter", "z_reset_counter", "heading_good_for_control",
        ):  # fmt: skip
            values_by_flag[name] = getattr(fusion, name)
        return {name: int(values[i]) for name, values in values_by_flag.items()} | {
            "nav_state": int(commander.active), "arming_state": 2 if commander.armed else 1,
            "failsafe": int(commander.in_failsafe), "landed": int(detector.landed),
            "ground_contact": int(detector.ground_contact),
            "battery_warning": commander.checks.battery_warning,
        }  # fmt: skip

    def _record_start(self) -> None:
        """Records the origin of the estimator's local frame and the vehicle's position, both in the world."""
        simulation, i = self._sim.simulation, self._row
        estimate, home = simulation.estimate, simulation.origin
        north, east = to_local(
            np.asarray(home.lat_deg), np.asarray(home.lon_deg),
            estimate.origin_lat_deg[i], estimate.origin_lon_deg[i],
        )  # fmt: skip
        down = float(estimate.origin_alt_amsl_m[i]) - home.alt_amsl_m
        self._origin_m = np.array([float(north), float(east), down])
        self._start_m = simulation.truth.position_ned_m[i].copy()

    def _errors(self) -> dict[str, float]:
        simulation, i = self._sim.simulation, self._row
        truth, estimate = simulation.truth, simulation.estimate
        error = estimate.position_ned_m[i] - truth.position_ned_m[i] - self._origin_m
        displacement = truth.position_ned_m[i] - self._start_m
        yaw = euler_of(estimate.q_ned_frd[i : i + 1])[0, 2] - euler_of(truth.q_ned_frd[i : i + 1])[0, 2]
        tilt = math.acos(max(-1.0, min(1.0, float(rotation_matrix(truth.q_ned_frd[i : i + 1])[0, 2, 2]))))
        return {
            "horizontal_error": math.hypot(error[0], error[1]),
            "height_error_down": float(error[2]),
            "true_displacement": math.hypot(displacement[0], displacement[1]),
            "true_height_above_ground": -float(truth.position_ned_m[i, 2]),
            "true_speed": math.hypot(*truth.velocity_ned_m_s[i, :2]),
            "yaw_error_deg": abs(math.degrees(float(wrap_pi(np.array(yaw))))),
            "tilt_deg": math.degrees(tilt),
            "eph": float(estimate.horizontal_accuracy_m[i]),
            "epv": float(estimate.vertical_accuracy_m[i]),
        }


def fly(scenarios: Sequence[Scenario], *, seed: int = 0) -> list[FaultFlight]:
    """Flies faults in one simulation; returns the flight of each. Repeated scenarios have different noise.

    Args:
        scenarios: the faults; a scenario may occur several times.
        seed: seed of the sensor noise.
    """
    count = len(scenarios)
    stores = [Parameters(scenario.parameters, px4=V1_16) for scenario in scenarios]
    sim = SimulatedFleet(
        count, stores=stores, links=(("gcs", "gcs"),), seed=seed, start_ned_m=np.zeros((count, 3))
    )
    for node in sim.nodes:  # stops all streams, which nothing reads
        for link in node.context.links:
            for msg_id in link.streamed_ids():
                link.set_interval(msg_id, 0, 0)
    players = [_ScenarioPlayer(sim, row, scenario) for row, scenario in enumerate(scenarios)]
    recorders = [_FlightRecorder(sim, row, scenario) for row, scenario in enumerate(scenarios)]
    end_s = max(scenario.after_boot_s + scenario.ends_s for scenario in scenarios)
    while sim.time_s < end_s:
        for player in players:
            player.tick()
        sim.step(sim.simulation.dt_s)
        if sim.simulation.steps % RECORD_EVERY_STEPS == 0:
            for recorder, scenario in zip(recorders, scenarios, strict=True):
                if sim.time_s < scenario.after_boot_s + scenario.ends_s:
                    recorder.sample()
    return [FaultFlight(recorder.moments_s, recorder.errors_at) for recorder in recorders]
