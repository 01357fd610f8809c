"""Detection of a landing: the detector, the height above ground, and whole landings."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.unit.vehicle_sim.sim_station import GCS_AND_API_LINKS, LAND_MODE, NAN, OFFBOARD_MODE, Station
from vehicle_sim.autopilot.land_detector import DetectorInputs, LandDetector, LandingThresholds
from vehicle_sim.autopilot.path import Path
from vehicle_sim.estimator.terrain import VALID_FOR_S, VALID_FROM_GROUND_S, Terrain
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import V1_16

pytestmark = pytest.mark.flight

ARM, TAKEOFF_COMMAND, SET_MODE, LAND_COMMAND = 400, 22, 176, 21
THRESHOLDS = LandingThresholds(0.25, 1.5, math.radians(20.0), 1.0, 0.12, 0.08)
FLYING = DetectorInputs(
    armed=True, thrust=0.49, hover_thrust=0.49, hover_thrust_known=True, velocity_ned_m_s=(0.0, 0.0, 0.0),
    down_by_position_m_s=0.0, vertical_known=True, rates_frd_rad_s=(0.0, 0.0, 0.0), height_above_ground_m=0.5,
    climb_rate_controlled=True, setpoint_down_m_s=0.7,
)  # fmt: skip
LANDED = FLYING._replace(thrust=0.12)
TICK_S = 0.02


class DetectorRun:
    """A land detector with a fake clock."""

    def __init__(self) -> None:
        self.detector = LandDetector()
        self.now_s = 0.0

    def feed(self, motion: DetectorInputs, duration_s: float = TICK_S) -> LandDetector:
        for _ in range(round(duration_s / TICK_S)):
            self.now_s += TICK_S
            self.detector.update(self.now_s, motion, THRESHOLDS)
        return self.detector

    def until_landed(self, motion: DetectorInputs, timeout_s: float = 10.0) -> float:
        start_s = self.now_s
        while not self.feed(motion).landed and self.now_s - start_s < timeout_s:
            pass
        return self.now_s - start_s


def detector_in_flight() -> DetectorRun:
    detector_run = DetectorRun()
    detector = detector_run.feed(FLYING)
    assert [detector.ground_contact, detector.maybe_landed, detector.landed] == [False] * 3
    return detector_run


def test_a_landing_takes_three_equal_stages_and_three_times_as_long_without_a_range() -> None:
    assert detector_in_flight().until_landed(LANDED) == pytest.approx(1.0, abs=0.1)
    without_range = LANDED._replace(height_above_ground_m=NAN)
    assert detector_in_flight().until_landed(without_range) == pytest.approx(3.0, abs=0.1)
    always_without_range = DetectorRun()
    always_without_range.feed(FLYING._replace(height_above_ground_m=NAN))
    assert always_without_range.until_landed(without_range) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    "change",
    [
        {"setpoint_down_m_s": NAN},
        {"setpoint_down_m_s": 0.2},
        {"height_above_ground_m": 1.5},
        {"thrust": 0.36},
        {"velocity_ned_m_s": (0.0, 0.0, 0.3), "down_by_position_m_s": 0.3},
        {"velocity_ned_m_s": (1.2, 1.2, 0.0)},
        {"rates_frd_rad_s": (0.3, 0.3, 0.0)},
    ],
)
def test_each_condition_alone_prevents_a_landing(change: dict[str, object]) -> None:
    detector_run = detector_in_flight()
    assert detector_run.until_landed(LANDED._replace(**change), 5.0) == pytest.approx(5.0, abs=0.1)
    assert not detector_run.detector.landed


def test_the_low_thrust_limit_is_higher_with_an_estimated_hover_thrust() -> None:
    low_thrust = FLYING._replace(thrust=0.3)
    assert detector_in_flight().feed(low_thrust, 1.0).ground_contact
    assert not detector_in_flight().feed(low_thrust._replace(hover_thrust_known=False), 1.0).ground_contact


def test_a_landing_without_climb_rate_control_needs_no_descent_setpoint() -> None:
    uncontrolled_climb = FLYING._replace(thrust=0.08, climb_rate_controlled=False, setpoint_down_m_s=NAN)
    assert detector_in_flight().until_landed(uncontrolled_climb) == pytest.approx(1.0, abs=0.1)
    assert not detector_in_flight().feed(uncontrolled_climb._replace(thrust=0.12), 5.0).landed


def test_a_landing_without_a_valid_height_is_detected_after_eight_seconds_of_low_thrust() -> None:
    assert detector_in_flight().until_landed(LANDED._replace(vertical_known=False), 20.0) == pytest.approx(
        8.7, abs=0.1
    )


def test_thrust_ends_the_landed_state_at_once_and_disarming_starts_it_after_one_stage() -> None:
    detector_run = detector_in_flight()
    detector_run.until_landed(LANDED)
    assert not detector_run.feed(FLYING).landed
    assert detector_run.until_landed(FLYING._replace(armed=False)) == pytest.approx(0.36, abs=0.05)


# --- the height above ground ---------------------------------------------------------------------------


class TerrainEstimate:
    """The terrain estimate of one vehicle; the test sets the measured range and the vehicle's down
    coordinate."""

    def __init__(self, min_range_m: float = 0.1) -> None:
        self.terrain = Terrain(1, 0.04)
        self.terrain.configure(0, Parameters({"EKF2_MIN_RNG": min_range_m}))

    def feed(
        self, range_m: float, *, in_air: bool = True, down_m: float = 0.0, duration_s: float = 0.04
    ) -> float:
        height = NAN
        for _ in range(round(duration_s / 0.04)):
            height = float(
                self.terrain.update(np.array([range_m]), np.ones(1), np.array([in_air]), np.array([down_m]))[
                    0
                ]
            )
        return height


def test_the_height_on_the_ground_is_the_shortest_range_of_the_sensor() -> None:
    for min_range_m in (0.1, 0.01):
        assert TerrainEstimate(min_range_m).feed(0.0, in_air=False) == pytest.approx(min_range_m)


def test_the_height_is_unknown_just_above_the_ground_and_known_again_higher_up() -> None:
    estimate = TerrainEstimate()
    estimate.feed(0.0, in_air=False)
    assert estimate.feed(0.02, down_m=-0.05) == pytest.approx(0.15)
    assert math.isnan(estimate.feed(0.03, down_m=-0.05, duration_s=VALID_FROM_GROUND_S))
    assert estimate.feed(0.3, down_m=-0.3) == pytest.approx(0.3)
    assert estimate.feed(0.05, down_m=-0.05) == pytest.approx(0.05)
    assert math.isnan(estimate.feed(0.0, duration_s=VALID_FOR_S + 0.04))


def test_the_height_follows_the_range_with_a_short_delay() -> None:
    estimate = TerrainEstimate()
    height = estimate.feed(5.0)
    for k in range(100):
        height = estimate.feed(5.0 - 0.028 * (k + 1), down_m=-5.0 + 0.028 * (k + 1))
    assert height - 2.2 == pytest.approx(0.7 * 0.13, abs=0.03)  # 0.7 m/s, delayed by 0.13 s


def test_unused_ranges_have_no_effect() -> None:
    estimate = TerrainEstimate()
    estimate.terrain.configure(0, Parameters({"EKF2_RNG_CTRL": 0}))
    assert math.isnan(estimate.feed(3.0, duration_s=1.0))


# --- flights -------------------------------------------------------------------------------------------


def hovering_station(alt_home_m: float) -> Station:
    station = Station(links=GCS_AND_API_LINKS, sensor_noise=False)
    station.run_until(lambda: station.can_be_armed, 10)
    station.command(ARM, 1)
    station.run(0.1)
    station.command(
        TAKEOFF_COMMAND, -1, 0, 0, NAN, NAN, NAN, station.sim.autopilots[0].home.alt_amsl_m + alt_home_m
    )
    station.run_until(lambda: station.height_m > alt_home_m - 0.3, 20)
    station.run(6)
    return station


def setpoint_sender(station: Station, type_mask: int, **fields: Any):
    return lambda: station.send(
        "SET_POSITION_TARGET_LOCAL_NED", via="api", target_system=1, target_component=1,
        coordinate_frame=1, type_mask=type_mask, **fields,
    )  # fmt: skip


def switch_to_offboard(station: Station, type_mask: int, **fields: float) -> None:
    send_setpoint = setpoint_sender(station, type_mask, **fields)
    station.run(0.5, send_setpoint)
    station.command(SET_MODE, 1, 6)
    station.run(0.2, send_setpoint)
    assert station.mode == OFFBOARD_MODE


@pytest.mark.story
def test_a_landing_is_detected_some_seconds_after_the_touch_down() -> None:
    """A real PX4 took 3.3 to 4.3 s, because near the ground the range is below the sensor's minimum."""
    station = hovering_station(5.0)
    assert station.newest_messages["ALTITUDE"].bottom_clearance == pytest.approx(5.0, abs=0.3)
    station.command(LAND_COMMAND, 0, 0, 0, NAN, NAN, NAN, 0)
    truth = station.sim.simulation.truth
    station.run_until(lambda: truth.position_ned_m[0, 2] > -0.5, 20)
    assert station.mode == LAND_MODE
    station.run_until(lambda: truth.position_ned_m[0, 2] > -0.4, 5)
    assert truth.velocity_ned_m_s[0, 2] == pytest.approx(0.33, abs=0.05), "no slow descent below one metre"
    station.run_until(lambda: truth.position_ned_m[0, 2] > -0.001, 20)
    touch_down_s = station.now_s
    station.run_until(lambda: "Landing detected\t" in station.status_texts(), 10)
    assert 2.8 < station.now_s - touch_down_s < 4.4
    station.run(2.5)
    assert station.newest_messages["ALTITUDE"].bottom_clearance == pytest.approx(0.01)


@pytest.mark.story
def test_a_descent_setpoint_ends_in_a_landing_and_a_position_below_the_ground_does_not() -> None:
    """PX4 needs a controlled descent; with a position setpoint below the ground it stays armed."""
    station = hovering_station(3.0)
    send_position_below_ground = setpoint_sender(station, 0b110111111000, z=2.0)
    switch_to_offboard(station, 0b110111111000, z=2.0)
    station.run(15, send_position_below_ground)
    assert station.sim.simulation.truth.position_ned_m[0, 2] == pytest.approx(0.0, abs=0.01)
    assert station.armed
    assert "Landing detected\t" not in station.status_texts()
    station.run_until(
        lambda: "Landing detected\t" in station.status_texts(),
        10,
        setpoint_sender(station, 0b110111000111, vz=0.5),
    )
    assert "Landing detected\t" in station.status_texts()


PARTIAL_SETPOINTS = (
    (0b110111100111, {"vx": 1.0}),  # no vertical axis
    (0b110111111011, {"z": -5.0}),  # no horizontal axes
    (0b110111111010, {"x": 4.0, "z": -3.0}),  # north without east
    (0b110111110101, {"y": 4.0, "vx": 1.0, "vz": -1.0}),
)


@pytest.mark.story
def test_a_setpoint_with_an_uncontrolled_axis_stops_the_vehicle() -> None:
    """A real PX4 also stops; the target that it reports is velocity zero."""
    station = hovering_station(3.0)
    position_before = station.sim.simulation.truth.position_ned_m[0].copy()
    switch_to_offboard(station, 0b110111000111)
    for type_mask, fields in PARTIAL_SETPOINTS:
        station.run(3, setpoint_sender(station, type_mask, **fields))
        reported_target = station.newest_messages["POSITION_TARGET_LOCAL_NED"]
        assert (reported_target.vx, reported_target.vy, reported_target.vz) == (0.0, 0.0, 0.0)
        assert all(map(math.isnan, (reported_target.x, reported_target.y, reported_target.z)))
        assert station.sim.simulation.truth.position_ned_m[0] == pytest.approx(position_before, abs=0.3)
    assert station.mode == OFFBOARD_MODE


# --- the trajectory of a landing -----------------------------------------------------------------------


class DisplacedVehicle:
    """A vehicle that stays beside its trajectory; `down_m` is the down coordinate of its position
    setpoint."""

    def __init__(self, north_m: float) -> None:
        self.estimate = SimpleNamespace(
            position_ned_m=(north_m, 0.0, -20.0), velocity_ned_m_s=(0.0, 0.0, 0.0), yaw_ned_rad=0.0,
            height_above_ground_m=20.0,
        )  # fmt: skip
        counts, good = np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.bool_)
        self.simulation = SimpleNamespace(
            fusion=SimpleNamespace(
                resets=np.zeros((4, 1), dtype=np.int64), heading_reset_counter=counts,
                heading_good_for_control=good,
            )
        )  # fmt: skip
        self.row = self.parameter_changes = 0
        self.px4 = V1_16
        self.parameter = Parameters().finite_value

    def choice(self, name: str) -> int:
        return int(Parameters().get(name))

    def trajectory(self, position_ned_m: tuple[float, float, float], *_: object) -> None:
        self.down_m = position_ned_m[2]


@pytest.mark.parametrize(("beside_m", "fraction"), [(0.0, 1.0), (0.5, 0.75), (1.0, 0.5)])
def test_a_vehicle_away_from_its_trajectory_descends_more_slowly(beside_m: float, fraction: float) -> None:
    """MPC_XY_ERR_MAX is 2 m; a real PX4 at half a metre from its path descended at 3/4 of its speed."""
    vehicle = DisplacedVehicle(-beside_m)
    path = Path(vehicle, vehicle)  # type: ignore[arg-type]
    for axis, start_m in ((path.x, 0.0), (path.y, 0.0), (path.z, -20.0)):
        axis.reset(start_m)
    path.z.reset(-20.0, 1.5)
    for _ in range(20):
        path.descend()
    assert vehicle.down_m + 20.0 == pytest.approx(20 * TICK_S * 1.5 * fraction, rel=0.02)
