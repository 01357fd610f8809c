"""The estimator with sensor faults: dead reckoning, gates, and resets as in PX4."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tests.bench import fault_recordings, faults
from vehicle_sim.autopilot.checks import SensorWatch
from vehicle_sim.autopilot.path import Path
from vehicle_sim.control.setpoints import ControlLevel
from vehicle_sim.estimator.barometer import Barometer
from vehicle_sim.estimator.fusion import blank_fusion
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.parameters import Parameters
from vehicle_sim.sensors.suite import Driver
from vehicle_sim.simulation import Simulation

pytestmark = pytest.mark.story

HOVER_HEIGHT_M = 10.0
SETTLING_S = 8.0


def hovering_simulation(count=1, seed=1):
    sim = Simulation(count, seed=seed, start_ned_m=np.zeros((count, 3)))
    sim.setpoints.armed[:] = True
    sim.setpoints.level[:] = ControlLevel.TRAJECTORY
    sim.setpoints.position_ned_m[:] = (0.0, 0.0, -HOVER_HEIGHT_M)
    sim.setpoints.yaw_ned_rad[:] = 0.0
    run_simulation(sim, 1.0)
    sim.setpoints.in_air[:] = True
    run_simulation(sim, SETTLING_S)
    return sim


def run_simulation(sim, seconds):
    for _ in range(round(seconds / sim.dt_s)):
        sim.step()


def set_parameter(sim, row, name, value):
    sim.parameters[row].set(name, value)
    sim.reload_parameters(row)


NO_FIX, FEW_SATELLITES, NO_GPS_DATA, HEALTHY = range(4)


def test_an_estimate_without_gps_reports_its_drift_and_is_invalid_after_five_seconds():
    sim = hovering_simulation(4)
    set_parameter(sim, NO_FIX, "SIM_GPS_USED", 3)
    set_parameter(sim, FEW_SATELLITES, "SIM_GPS_USED", 4)
    sim.set_driver(NO_GPS_DATA, Driver.GPS, False)
    run_simulation(sim, 1.4)
    assert sim.fusion.dead_reckoning.tolist() == [True, True, True, False]
    assert sim.sensors.gps_fix_type.tolist()[:2] == [0, 3], "four satellites give a fix that is refused"
    run_simulation(sim, 3.4)
    assert sim.estimate.valid_position.all(), "invalid before 5 s"
    assert sim.fusion.gps_hgt.tolist() == [True, True, False, True]
    run_simulation(sim, 0.5)
    assert sim.estimate.valid_position.tolist() == [False, False, False, True]
    assert ((sim.estimate.horizontal_accuracy_m > 1.2) == (True, True, True, False)).all()
    assert sim.fusion.gnss_pos.all(), "the fusion stopped less than two seconds later"
    run_simulation(sim, 2.1)
    assert sim.fusion.gnss_pos.tolist() == [False, False, False, True]
    assert sim.estimate.valid_altitude.all(), "the barometer did not keep the altitude valid"
    resets = sim.fusion.xy_reset_counter.copy()
    set_parameter(sim, NO_FIX, "SIM_GPS_USED", 10)
    run_simulation(sim, 0.9)
    assert not sim.estimate.valid_position[NO_FIX]
    run_simulation(sim, 0.5)
    assert sim.estimate.valid_position[NO_FIX]
    assert (sim.fusion.xy_reset_counter - resets).tolist() == [1, 0, 0, 0]
    assert np.abs(sim.estimate.position_ned_m[NO_FIX] - sim.truth.position_ned_m[NO_FIX])[:2].max() < 1.5


FIX_AT_S = 3.0


def test_a_first_fix_after_boot_is_used_after_one_second_and_aligns_the_heading_again():
    sim = SimulatedFleet(2, links=(), seed=1)
    fusion, texts = sim.simulation.fusion, []
    sim.autopilots[0].announcer.add_listener(lambda item: texts.append(getattr(item, "text", "")))
    sim.set_parameter(0, "SIM_GPS_USED", 3)
    sim.step(FIX_AT_S)
    assert "Preflight: GPS fix too low" in "".join(texts)
    assert fusion.gnss_pos.tolist() == [False, True], "a healthy boot waits for EKF2_REQ_GPS_H only"
    assert fusion.heading_reset_counter.tolist() == [0, 0]
    sim.set_parameter(0, "SIM_GPS_USED", 10)
    sim.step(1.0)
    assert not fusion.gnss_pos[0], "used before a second without failures"
    sim.step(0.4)
    assert fusion.gnss_pos[0]
    assert fusion.heading_reset_counter.tolist() == [1, 0]


SMALL_BARO_STEP, LARGE_BARO_STEP, MAG_OFFSET_Y, MAG_OFFSET_X = range(4)


def test_gates_accept_small_steps_and_reject_large_steps():
    sim = hovering_simulation(4)
    set_parameter(sim, SMALL_BARO_STEP, "SIM_BARO_OFF_P", 120.0)
    set_parameter(sim, LARGE_BARO_STEP, "SIM_BARO_OFF_P", 1200.0)
    set_parameter(sim, MAG_OFFSET_Y, "SIM_MAG_OFFSET_Y", 0.4)
    set_parameter(sim, MAG_OFFSET_X, "SIM_MAG_OFFSET_X", 0.4)
    heading = sim.estimate.heading_rad.copy()
    run_simulation(sim, 0.5)
    assert sim.fusion.mag_heading_consistent.tolist() == [True, True, False, True]
    assert sim.fusion.mag_field_disturbed.tolist() == [False, False, False, True]
    assert sim.fusion.mag_3d.tolist() == [True, True, False, False]
    run_simulation(sim, 4.0)
    error_down_m = sim.estimate.position_ned_m[:, 2] - sim.truth.position_ned_m[:, 2]
    assert 1.0 < error_down_m[SMALL_BARO_STEP] < 4.0
    assert abs(error_down_m[LARGE_BARO_STEP]) < 1.5
    assert not sim.fusion.baro_fault.any()
    run_simulation(sim, 1.0)
    assert sim.fusion.baro_fault.tolist() == [False, True, False, False]
    run_simulation(sim, 2.0)
    assert sim.fusion.mag.tolist() == [True, True, False, False]
    turn_rad = np.abs(sim.estimate.heading_rad - heading)
    assert turn_rad.max() < math.radians(15.0), "a rejected compass turned the heading"


def test_a_gps_offset_an_accelerometer_offset_and_a_stuck_compass_have_the_effects_of_px4():
    sim = hovering_simulation(3)
    sim.set_gps_offset(0, np.array([30.0, 0.0, 0.0]))
    sim.sensor_faults.set_imu_offset(1, np.zeros(3), np.array([0.0, 0.0, 4.0]))
    sim.sensor_faults.stuck[Driver.MAG][2] = True
    resets_before = sim.fusion.resets.copy()
    run_simulation(sim, 6.0)
    assert sim.fusion.z_reset_counter[1] > resets_before[3, 1]
    assert not sim.sensors.mag_stale.any(), "stale too early: 1000 equal values, 3 per sample, take 6.7 s"
    run_simulation(sim, 1.0)
    assert sim.sensors.mag_stale.tolist() == [False, False, True]
    assert sim.fusion.mag[2]
    run_simulation(sim, 6.0)
    assert not sim.fusion.mag[2]
    assert sim.fusion.xy_reset_counter[0] == resets_before[2, 0]
    assert abs(sim.estimate.position_ned_m[0, 0] - sim.truth.position_ned_m[0, 0]) < 2.0
    assert sim.estimate.horizontal_accuracy_m[0] > 0.5
    run_simulation(sim, 2.0)
    assert sim.fusion.xy_reset_counter[0] == resets_before[2, 0] + 1


def test_a_reset_shifts_the_outputs_and_the_filter_by_the_same_step():
    """PX4's recorded outputs were wrong by 0.9 to 1.5 m/s after resets due to an accelerometer offset."""
    sim = hovering_simulation(3)
    run_simulation(sim, 15.0)
    sim.sensor_faults.imu_offset[:, 5] = 2.0
    filtered = sim._estimator.kalman.velocity
    resets_before, lags = sim.fusion.vz_reset_counter.copy(), []
    for _ in range(round(5.0 / sim.dt_s)):
        sim.step()
        reset = sim.fusion.vz_reset_counter > resets_before
        if reset.any():
            run_simulation(sim, 2.0 * sim.dt_s)
            lags += (sim.estimate.velocity_ned_m_s - filtered)[reset, 2].tolist()
        resets_before = sim.fusion.vz_reset_counter.copy()
    assert len(lags) >= 3
    assert min(lags) > 0.9
    run_simulation(sim, 1.0)
    lag = np.abs(sim.estimate.velocity_ned_m_s - filtered)[:, 2]
    assert lag.max() < 0.7 * min(lags), "the output does not follow the filter"


@pytest.mark.parametrize(
    ("axis", "gauss", "fused_again", "heading_is_reset"),
    [("X", 0.2, True, True), ("Y", 0.2, True, False), ("X", 0.4, False, False), ("Y", 0.4, False, False)],
)
def test_the_fusion_of_a_compass_stops_and_starts_again_if_its_offset_is_small(
    axis, gauss, fused_again, heading_is_reset
):
    sim = hovering_simulation(3)
    for row in range(3):
        set_parameter(sim, row, f"SIM_MAG_OFFSET_{axis}", gauss)
    run_simulation(sim, 7.0)
    assert sim.fusion.mag.all()
    headings = sim.fusion.heading_reset_counter.copy()
    run_simulation(sim, 0.3)
    assert (sim.fusion.mag == fused_again).all()
    run_simulation(sim, 0.2)
    assert (sim.fusion.mag_aligned_in_flight == fused_again).all()
    assert (sim.fusion.heading_reset_counter - headings == heading_is_reset).all()
    run_simulation(sim, 15.0)
    assert (sim.fusion.mag == fused_again).all(), "the state changed again"


def test_a_barometer_is_fused_as_the_mean_of_its_samples():
    kalman = SimpleNamespace(
        position=np.zeros((1, 3)), variance=lambda _: np.zeros(1), fuse=lambda *fused: fusions.append(fused)
    )
    fusions, barometer = [], Barometer(1, kalman, blank_fusion(1))
    barometer.configure(0, Parameters())
    barometer.align(0, 0.0, 100.0)
    for alt_m in (101.0, 104.0):
        barometer.add(SimpleNamespace(baro_fresh=np.array([True]), baro_alt_amsl_m=np.array([alt_m])))
    barometer.fuse(0.1, 0.1, np.array([True]))
    ((_, innovation, _),) = fusions
    assert innovation == -2.5


@pytest.mark.parametrize("name", ["baro", "mag"])
def test_a_stale_sensor_is_reported_once_and_again_after_it_has_recovered(name):
    texts = []
    announcer = SimpleNamespace(text=lambda _, text: texts.append(text), event=lambda *_: None)
    fresh = {f"{each}_fresh": np.array([True]) for each in ("baro", "mag")}
    sensors = SimpleNamespace(**fresh, baro_stale=np.array([False]), mag_stale=np.array([False]))
    fusion = SimpleNamespace(gnss_pos=np.array([False]))
    view = SimpleNamespace(time_s=0.0, row=0, simulation=SimpleNamespace(sensors=sensors, fusion=fusion))
    watch = SensorWatch(view, announcer)
    for stale in (True, True, False, True):
        view.time_s += 1.0
        getattr(sensors, f"{name}_fresh")[0], getattr(sensors, f"{name}_stale")[0] = not stale, stale
        watch.update(armed=True)
        assert not watch.timed_out(name), (
            "a sensor that repeats one value was counted as a sensor without data"
        )
    assert texts == [f"{name.upper()} #0 failed:  STALE!\t"] * 2


@pytest.mark.parametrize(
    ("counter", "change"), [(0, "velocity_ne"), (1, "velocity_d"), (2, "position_ne"), (3, "position_d")]
)
def test_a_trajectory_continues_from_a_reset_estimate(counter, change):
    resets = np.zeros((4, 1), dtype=np.int64)
    estimate = SimpleNamespace(
        position_ned_m=(30.0, 31.0, 32.0), velocity_ned_m_s=(1.0, 2.0, 3.0), yaw_ned_rad=0.0
    )
    fusion = SimpleNamespace(resets=resets, heading_reset_counter=np.zeros(1, dtype=np.int64))
    simulation = SimpleNamespace(fusion=fusion)
    path = Path(SimpleNamespace(simulation=simulation, row=0, estimate=estimate), SimpleNamespace())
    path.follow_resets()
    assert path.position_ned_m == (0.0, 0.0, 0.0)
    resets[counter] += 1
    path.follow_resets()
    velocity = path.x.velocity_m_s, path.y.velocity_m_s, path.z.velocity_m_s
    assert path.position_ned_m == {"position_ne": (30.0, 31.0, 0.0), "position_d": (0.0, 0.0, 32.0)}.get(
        change, (0.0, 0.0, 0.0)
    )
    assert velocity == {"velocity_ne": (1.0, 2.0, 0.0), "velocity_d": (0.0, 0.0, 3.0)}.get(
        change, (0.0, 0.0, 0.0)
    )


def test_the_same_seed_gives_the_same_estimate_under_a_fault():
    estimates = []
    for count in (1, 3):
        sim = Simulation(count, seed=5)
        for row in range(1, count):
            set_parameter(sim, row, "SIM_GPS_USED", 3)
        sim.setpoints.armed[:] = True
        run_simulation(sim, 8.0)
        set_parameter(sim, 0, "SIM_GPS_USED", 3)
        run_simulation(sim, 8.0)
        estimates.append(sim.estimate.q_ned_frd[0].tobytes() + sim.estimate.position_ned_m[0].tobytes())
    assert estimates[0] == estimates[1]


COMPARED_FAULTS = ("gps_lost_offboard_vel", "baro_stuck_hold", "mag_y_02_hold", "battery_empty_cmd")


@pytest.mark.flight
def test_flights_with_faults_match_the_recordings():
    for comparison in faults.compare_all([fault_recordings.load_reduced(name) for name in COMPARED_FAULTS]):
        assert not comparison.moments_outside, (comparison.name, comparison.moments_outside)
        # The direction of a drift is random, so a few values lie outside the range of PX4's two runs.
        assert len(comparison.errors_outside) <= 0.1 * comparison.number_count, (
            comparison.name,
            comparison.errors_outside,
        )


def test_the_reduced_recordings_match_the_full_recordings(reference_data):
    for name in COMPARED_FAULTS:
        assert fault_recordings.load_reduced(name) == fault_recordings.load(name)


def test_every_recorded_fault_can_be_read(reference_data):
    scenarios = [fault_recordings.load(name) for name in fault_recordings.names()]
    assert all(len(scenario.runs) == 2 for scenario in scenarios)
    parameters = Parameters()
    fields = [entry["fields"] for scenario in scenarios for entry in scenario.stimulus]
    assert all(each["param_id"] in parameters for each in fields if "param_id" in each)
