"""Calibrations: requested sides, texts, and the resulting parameters of the simulated sensors."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.estimator_restart import restart_estimator
from vehicle_sim.commands.calibration import CalibrationCommands
from vehicle_sim.commands.command import ACCEPTED, TEMPORARILY_REJECTED, Command
from vehicle_sim.commands.sides import Rest, RestDetector, Side, offset_and_scale
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.frames import GRAVITY_M_S2
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import frame_v2
from vehicle_sim.parameters import Parameters

STEP_S = 0.004
PREFLIGHT_CALIBRATION, FIXED_MAG_CAL_YAW = 241, 42006
OFFSET = np.array([0.3, -0.2, 0.5])
SCALE = np.array([1.02, 0.97, 1.01])
HARD_IRON = np.array([0.12, -0.08, 0.05])
FIELD_LEVEL_GAUSS, FIELD_DOWN_GAUSS = 0.22, 0.43


def accel_at_rest(side: Side, offset: float = 0.0) -> tuple[float, float, float]:
    reading = [offset, offset, offset]
    reading[side.axis] += side.sign * GRAVITY_M_S2
    return reading[0], reading[1], reading[2]


class TurnedVehicle:
    """A fake vehicle that the test turns: sensors, parameters, status texts, time."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.acks: list[int] = []
        self.parameters = Parameters()
        self.side = Side.DOWN
        self.now_s = 0.0
        self._timers: list[tuple[float, Any]] = []
        self._random = np.random.default_rng(5)
        announcer = SimpleNamespace(
            text=lambda severity, text: self.texts.append(text),
        )
        self.sensors = SimpleNamespace(
            accel_frd_m_s2=np.zeros((1, 3)), gyro_frd_rad_s=np.zeros((1, 3)), mag_frd_gauss=np.zeros((1, 3))
        )
        self.turning_rad_s = 0.0
        """Rate at which the vehicle is turned about the vertical."""
        self.autopilot: Any = SimpleNamespace(
            announcer=announcer, commander=SimpleNamespace(armed=False, calibrating=False)
        )
        self.view: Any = SimpleNamespace(
            row=0, simulation=self, parameters=self.parameters,
            parameter=lambda name: float(self.parameters.get(name)),
        )  # fmt: skip
        self.dt_s = STEP_S
        self.calibration = CalibrationCommands(self, lambda names: None)

    @property
    def time_s(self) -> float:
        return self.now_s

    def call_soon(self, action: Any) -> None:
        self.call_later(0.0, action)

    def call_later(self, seconds: float, action: Any) -> None:
        self._timers.append((self.now_s + seconds, action))

    def acknowledge(self, command: Command, result: int, *, progress: int = 0) -> None:
        self.acks.append(result)

    def axis_parameters(self, pattern: str) -> list[float]:
        return [float(self.parameters.get(pattern.format(axis))) for axis in "XYZ"]

    def command(self, *parameters: float) -> int | None:
        numbers = (*parameters, *(0.0,) * 7)[:7]
        return self.calibration.calibrate(Command(PREFLIGHT_CALIBRATION, *numbers, (255, 190), "gcs"))

    def step(self) -> None:
        """One sample of sensors with noise; the current calibration parameters are applied."""
        self.now_s += STEP_S
        raw = np.array(accel_at_rest(self.side)) + self._random.normal(0.0, 0.1, 3)
        scale = np.array(self.axis_parameters("CAL_ACC0_{}SCALE"))
        self.sensors.accel_frd_m_s2[0] = (raw - self.axis_parameters("CAL_ACC0_{}OFF")) * scale
        gyro_rad_s = self._random.normal(0.0, 0.01, 3)
        self.sensors.gyro_frd_rad_s[0] = gyro_rad_s - self.axis_parameters("CAL_GYRO0_{}OFF")
        raw = self.field() + HARD_IRON + self._random.normal(0.0, 0.005, 3)
        self.sensors.mag_frd_gauss[0] = raw - self.axis_parameters("CAL_MAG0_{}OFF")
        due = [action for at_s, action in self._timers if at_s <= self.now_s]
        self._timers = [(at_s, action) for at_s, action in self._timers if at_s > self.now_s]
        for action in due:
            action()

    def field(self) -> Any:
        """The magnetic field of the earth in the body frame, for the current side and rotation."""
        angle = self.turning_rad_s * self.now_s
        horizontal_gauss = FIELD_LEVEL_GAUSS * np.array([math.cos(angle), math.sin(angle)])
        return np.insert(horizontal_gauss, self.side.axis, -self.side.sign * FIELD_DOWN_GAUSS)

    def run_until_text(self, text: str, timeout_s: float = 12.0) -> None:
        text_count, begin_s = len(self.texts), self.now_s
        while not any(text in each for each in self.texts[text_count:]):
            assert self.now_s - begin_s < timeout_s, f"not received: {text}; last {self.texts[-3:]}"
            self.step()


@pytest.mark.parametrize("side", Side)
def test_each_side_is_recognised_after_a_rest(side: Side) -> None:
    detector = RestDetector(1.3)
    events = [detector.feed(accel_at_rest(side, 0.3), STEP_S) for _ in range(round(5.0 / STEP_S))]
    began_s, still_s = events.index(Rest.BEGAN) * STEP_S, events.index(Rest.STILL) * STEP_S
    assert began_s == pytest.approx(2.36, abs=0.3), "as in the recording"
    assert still_s - began_s == pytest.approx(1.31, abs=0.05)
    assert detector.side is side


def test_motion_ends_a_rest_and_a_tilted_vehicle_has_no_side() -> None:
    detector = RestDetector(1.3)
    for _ in range(round(3.0 / STEP_S)):
        detector.feed(accel_at_rest(Side.DOWN), STEP_S)
    assert Rest.BROKEN in [detector.feed((4.0, 0.0, -9.8), STEP_S) for _ in range(50)]
    component_m_s2 = GRAVITY_M_S2 / math.sqrt(2.0)
    while detector.feed((component_m_s2, 0.0, -component_m_s2), STEP_S) is not Rest.STILL:
        pass
    assert detector.side is None


def test_offset_and_scale_are_computed_from_six_sides() -> None:
    readings = {side: np.array(accel_at_rest(side)) / SCALE + OFFSET for side in Side}
    result = offset_and_scale(readings)
    assert result is not None
    assert result[0] == pytest.approx(OFFSET)
    assert result[1] == pytest.approx(SCALE)
    assert offset_and_scale(dict.fromkeys(Side, np.zeros(3))) is None, (
        "a sensor that always measures zero was calibrated"
    )


def test_an_accelerometer_is_calibrated_on_all_sides() -> None:
    vehicle = TurnedVehicle()
    for axis, offset, scale in zip("XYZ", OFFSET.tolist(), SCALE.tolist(), strict=True):
        # These parameters are the result of an earlier, wrong calibration.
        vehicle.parameters.set(f"CAL_ACC0_{axis}OFF", offset)
        vehicle.parameters.set(f"CAL_ACC0_{axis}SCALE", scale)
    assert vehicle.command(0, 0, 0, 0, 1) == ACCEPTED
    for side in (Side.DOWN, Side.LEFT, Side.UP, Side.RIGHT, Side.FRONT, Side.BACK):
        vehicle.side = side
        vehicle.run_until_text(f"{side.value} side done, rotate to a different side")
    vehicle.run_until_text("calibration done: accel")
    assert vehicle.axis_parameters("CAL_ACC0_{}OFF") == pytest.approx([0.0, 0.0, 0.0], abs=0.03)
    assert vehicle.axis_parameters("CAL_ACC0_{}SCALE") == pytest.approx([1.0, 1.0, 1.0], abs=0.005)
    assert [float(t.split("<")[1][:-1]) for t in vehicle.texts if "progress" in t] == [
        17,
        34,
        51,
        68,
        85,
        102,
    ]
    assert "[cal] pending: back front left right up" in vehicle.texts, "the first side, down, is not pending"


def test_a_calibration_fails_if_the_vehicle_is_not_turned() -> None:
    vehicle = TurnedVehicle()
    vehicle.command(0, 0, 0, 0, 1)
    vehicle.run_until_text("calibration failed: accel", 40)
    assert vehicle.texts.count("[cal] down side already completed") == 5
    assert "[cal] calibration failed: timeout: no motion" in vehicle.texts
    assert not vehicle.autopilot.commander.calibrating


def test_the_result_of_a_side_is_a_mean_and_is_sent_at_the_recorded_time() -> None:
    vehicle = TurnedVehicle()
    vehicle.command(0, 0, 0, 0, 1)
    vehicle.run_until_text("Hold still, measuring down side")
    assert vehicle.now_s == pytest.approx(3.87, abs=0.4)
    begin_s = vehicle.now_s
    vehicle.run_until_text("down side result")
    assert vehicle.now_s - begin_s == pytest.approx(3.0, abs=0.05)
    result = next(text for text in vehicle.texts if "result" in text)
    x, y, z = (float(word) for word in result.split("[")[2].rstrip("]").split())
    assert max(abs(x), abs(y), abs(z + GRAVITY_M_S2)) < 0.02, (
        "not a mean: the noise of one sample is 0.1 m/s²"
    )


def test_a_gyroscope_calibration_sets_the_offset_measured_at_rest() -> None:
    vehicle = TurnedVehicle()
    vehicle.parameters.set("CAL_GYRO0_YOFF", 0.4)
    vehicle.command(1)
    vehicle.run_until_text("calibration done: gyro", 3)
    assert vehicle.axis_parameters("CAL_GYRO0_{}OFF") == pytest.approx([0.0, 0.0, 0.0], abs=0.003)


@pytest.mark.story
def test_a_compass_calibration_fails_if_the_vehicle_is_not_turned() -> None:
    vehicle = TurnedVehicle()
    vehicle.command(0, 1)
    vehicle.run_until_text("Rotate vehicle", 5)
    vehicle.run_until_text("calibration failed: mag", 110)
    assert "Failed: This calibration requires rotation." in vehicle.texts


def test_a_compass_calibration_on_all_sides_sets_the_hard_iron_offset() -> None:
    vehicle = TurnedVehicle()
    vehicle.parameters.set("CAL_MAG0_ZOFF", 0.3)  # the result of an earlier, wrong calibration
    vehicle.command(0, 1)
    for side in Side:
        vehicle.side, vehicle.turning_rad_s = side, 0.0
        vehicle.run_until_text("Rotate vehicle", 8)
        vehicle.turning_rad_s = 1.0
        vehicle.run_until_text(f"{side.value} side done, rotate to a different side", 20)
    vehicle.run_until_text("calibration done: mag")
    assert vehicle.axis_parameters("CAL_MAG0_{}OFF") == pytest.approx(HARD_IRON.tolist(), abs=0.01)


def ready_vehicle() -> SimulatedFleet:
    """A vehicle on the ground that can be armed."""
    sim = SimulatedFleet(seed=3)
    sim.step(3.0)
    return sim


def send_command(sim: SimulatedFleet, number: int, *parameters: float) -> None:
    fields = {f"param{n}": value for n, value in enumerate(parameters, 1)}
    layout, payload = pack("COMMAND_LONG", command=number, target_system=1, target_component=1, **fields)
    sim.feed(0, "gcs", frame_v2(layout, payload, 1, 255, 190))


def parameter_of(sim: SimulatedFleet, name: str) -> float:
    return float(sim.simulation.parameters[0].get(name))


def test_a_level_calibration_corrects_the_mounting_angle() -> None:
    sim = ready_vehicle()
    sim.simulation.parameters[0].set("SENS_BOARD_X_OFF", 3.0)
    restart_estimator(sim.simulation)
    sim.step(2.0)
    estimated_roll_deg = math.degrees(sim.autopilots[0].view.estimate.roll_rad)
    assert estimated_roll_deg == pytest.approx(-3.0, abs=0.7), "the parameter states a wrong mounting angle"
    send_command(sim, PREFLIGHT_CALIBRATION, 0, 0, 0, 0, 2)
    sim.step(1.5)
    assert parameter_of(sim, "SENS_BOARD_X_OFF") == pytest.approx(0.0, abs=0.7)
    assert not sim.autopilots[0].commander.calibrating


def test_a_barometer_calibration_sets_the_offset_from_gps_and_needs_a_fix() -> None:
    sim = ready_vehicle()
    sim.simulation.parameters[0].set("SIM_BARO_OFF_P", 300.0)
    send_command(sim, PREFLIGHT_CALIBRATION, 0, 0, 1)
    sim.step(3.2)
    assert parameter_of(sim, "CAL_BARO0_OFF") == pytest.approx(300.0, abs=8.0), (
        "the GPS error is 0.5 m; 12 Pa are 1 m"
    )
    sim.step(0.7)
    sim.simulation.parameters[0].set("SIM_GPS_USED", 0)
    sim.step(0.5)
    send_command(sim, PREFLIGHT_CALIBRATION, 0, 0, 1)
    sim.step(3.2)
    assert parameter_of(sim, "CAL_BARO0_OFF") == pytest.approx(300.0, abs=8.0)
    assert not sim.autopilots[0].commander.calibrating, "the calibration did not end"


def test_a_compass_calibration_with_a_known_heading_sets_the_offset() -> None:
    sim = ready_vehicle()
    for axis, gauss in zip("XYZ", HARD_IRON.tolist(), strict=True):
        sim.simulation.parameters[0].set(f"SIM_MAG_OFFSET_{axis}", gauss)
    sim.step(0.5)
    send_command(sim, FIXED_MAG_CAL_YAW, 0.0)
    sim.step(0.1)
    offsets_gauss = [parameter_of(sim, f"CAL_MAG0_{axis}OFF") for axis in "XYZ"]
    assert offsets_gauss == pytest.approx(HARD_IRON.tolist(), abs=0.06), "the error exceeds the noise"


def test_a_calibration_is_cancelled_at_once_or_after_the_measurement_of_the_current_side() -> None:
    vehicle = TurnedVehicle()
    vehicle.command(0, 1)
    assert vehicle.command(0, 0, 0, 0, 1) == TEMPORARILY_REJECTED, "a second calibration was started"
    assert vehicle.command() == TEMPORARILY_REJECTED
    assert (vehicle.acks, vehicle.texts[-1]) == ([ACCEPTED], "[cal] calibration cancelled")
    assert vehicle.command(0, 0, 0, 0, 1) == ACCEPTED
    vehicle.run_until_text("Hold still")
    assert vehicle.command() == TEMPORARILY_REJECTED
    assert vehicle.acks == [ACCEPTED]
    vehicle.run_until_text("calibration failed: accel")
    assert vehicle.acks == [ACCEPTED, ACCEPTED]
    assert vehicle.command(1) == ACCEPTED
