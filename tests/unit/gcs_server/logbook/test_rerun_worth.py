"""What docs/flights.md says of reruns and identified aircraft, beside recordings of a real PX4 and simulated
flights: `python -m tests.bench what_if` prints the table."""

import numpy as np
import pytest

from tests.bench import what_if
from tests.bench.fault_recordings import FAULTS
from tests.bench.flight_recordings import FLIGHTS

pytestmark = pytest.mark.flight
REFERENCE = ("hold_drift_30s", "land_from_5m", "pos_step_x_p5", "rtl_60m_15m")
BODY = {"SIH_MASS": 1.5, "SIH_T_MAX": 7.0, "SIH_KDV": 0.9}


def rerun(folder, name):
    path = folder / f"{name}.json.gz"
    if not path.exists():
        pytest.skip(f"the recording {name} is not beside this checkout")
    return what_if.rerun(path)


def within(folder, pattern):
    paths = sorted(folder.glob(pattern))
    if not paths:
        pytest.skip(f"the recordings {folder.name}/{pattern} are not beside this checkout")
    reruns = [what_if.rerun(path) for path in paths]
    errors_m = np.array([each.error_m for each in reruns])
    allowed_m = what_if.STATED_M + np.array([each.drift_m for each in reruns])
    near, explained = errors_m <= what_if.STATED_M, errors_m <= allowed_m
    return len(paths), np.count_nonzero(near), np.count_nonzero(explained), np.nanmedian(errors_m)


@pytest.mark.parametrize("name", REFERENCE)
def test_a_recorded_flight_flown_again_stays_within_the_stated_error(name):
    assert rerun(FLIGHTS, name).error_m <= what_if.STATED_M


def test_a_flight_whose_estimate_is_wrong_is_not_flown_again_rightly_and_the_error_says_so():
    assert rerun(FAULTS / "data", "baro_ramp_20pa_s.run1").error_m <= what_if.STATED_M
    assert rerun(FAULTS / "data", "accel_bias_z_2.run1").error_m > 5 * what_if.STATED_M


def test_a_wind_that_rises_is_flown_again():
    """It blows 10 m/s from one second to the next: in calm air the rerun would be 15 m away."""
    assert rerun(FAULTS / "data", "wind_10_offboard_vel.run1").error_m < 2.0


@pytest.mark.story
def test_as_many_recorded_flights_as_documented_stay_within_the_stated_error():
    count, near, explained, median_m = within(FLIGHTS, "*.json.gz")
    assert (count, near >= 18, explained >= 37, median_m < 1.25) == (41, True, True, True)
    count, near, explained, median_m = within(FAULTS / "data", "*.run1.json.gz")
    assert (count, near >= 35, explained >= 43, median_m < 0.6) == (48, True, True, True)


def test_an_aircraft_is_identified_in_the_log_of_a_simulated_flight(tmp_path):
    found = what_if.identified(BODY, tmp_path)
    assert abs(found.thrust) < 0.03
    assert found.drag_known
    assert abs(found.drag) < 0.1


@pytest.mark.story
@pytest.mark.parametrize("body", what_if.BODIES, ids=str)
def test_each_aircraft_is_identified_as_documented(tmp_path, body):
    found = what_if.identified(body, tmp_path)
    assert (abs(found.thrust) < 0.03, abs(found.drag) < 0.1) == (True, True)


@pytest.mark.story
@pytest.mark.parametrize("gains", what_if.GAINS, ids=str)
def test_a_changed_gain_makes_of_a_rerun_what_it_makes_of_a_flight(tmp_path, gains):
    error_m, makes_m = what_if.changed(gains, tmp_path)
    assert makes_m > 0.4
    assert error_m < 0.2 * makes_m
