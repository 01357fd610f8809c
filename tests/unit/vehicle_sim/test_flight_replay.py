"""Some reference flights flown through MAVLink as `make bench` flies all: near PX4, and the table says so."""

import pytest

from tests.bench import flight_comparison, flight_recordings, reference_flights

SHORT = ("att_roll_10", "rate_roll_pulse", "vel_z_up1p5", "pos_step_z_up3", "yaw_step_90")


@pytest.fixture(scope="module")
def comparisons(shared):
    return {each.name: each for each in reference_flights.measure(list(SHORT))}


@pytest.mark.parametrize("name", SHORT)
def test_flights_stay_within_their_limits(comparisons, name):
    flown = comparisons[name]
    assert flown.error <= flown.limit
    assert flown.path_error_m <= max(flown.path_limit_m, 1.0)


def test_both_controllers_fly_while_the_kind_of_set_point_changes(comparisons):
    flown = comparisons["att_roll_10"]
    assert flown.real.rise_s > 0.4, "PX4 needs three times as long as for the step alone"
    assert flown.sim.rise_s == pytest.approx(flown.real.rise_s, abs=0.15)


def test_the_table_has_a_row_for_each_flight_and_a_sum(comparisons):
    rows = list(reference_flights.rows(list(comparisons.values())))
    assert len(rows) == 2 + len(SHORT) + 2
    assert rows[-1].split()[2] == str(len(SHORT))


def test_every_recorded_flight_has_its_manoeuvre(shared):
    assert set(flight_recordings.names()) == set(flight_comparison.MANOEUVRES)


def test_streams_are_unrolled_at_their_rate(shared):
    sends = list(flight_recordings.load("vel_x_1").sends())
    assert len(sends) == 30 * 6 + 30 * 6
    assert sends[1][0] - sends[0][0] == pytest.approx(1.0 / 30.0)
    circle = list(flight_recordings.load("circle_r5_v3_posvel").sends())
    assert circle[-1][0] == pytest.approx(24.84, abs=0.01), "by the vehicle's clock"
