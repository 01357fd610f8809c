"""Some of the reference flights of `make bench` stay within their limits and are listed in the table."""

import math

import pytest

from tests.bench import (
    flight_comparison,
    flight_recordings,
    reference_flights,
    ros2_flights,
    ros2_recordings,
)

pytestmark = pytest.mark.flight

SHORT_FLIGHTS = ("att_roll_10", "rate_roll_pulse", "vel_z_up1p5", "pos_step_z_up3", "yaw_step_90")


@pytest.fixture(scope="module")
def comparisons(reference_data):
    return {each.name: each for each in reference_flights.measure(list(SHORT_FLIGHTS))}


@pytest.mark.parametrize("name", SHORT_FLIGHTS)
def test_flights_stay_within_their_limits(comparisons, name):
    comparison = comparisons[name]
    assert comparison.error <= comparison.limit
    assert comparison.path_error_m <= max(comparison.path_limit_m, 1.0)


def test_both_controllers_are_active_after_a_change_of_the_setpoint_type(comparisons):
    comparison = comparisons["att_roll_10"]
    assert comparison.real.rise_s > 0.4, "in PX4 the rise takes three times as long as without the change"
    assert comparison.sim.rise_s == pytest.approx(comparison.real.rise_s, abs=0.15)


def test_the_table_has_a_row_for_each_flight_and_a_sum(comparisons):
    rows = list(reference_flights.rows(list(comparisons.values())))
    assert len(rows) == 2 + len(SHORT_FLIGHTS) + 2
    assert rows[-1].split()[2] == str(len(SHORT_FLIGHTS))


def test_every_recorded_flight_has_its_manoeuvre(reference_data):
    assert set(flight_recordings.names()) == set(flight_comparison.MANOEUVRES)


def test_recorded_streams_are_expanded_to_single_messages(reference_data):
    messages = list(flight_recordings.load("vel_x_1").messages())
    assert len(messages) == 30 * 6 + 30 * 6
    assert messages[1][0] - messages[0][0] == pytest.approx(1.0 / 30.0)
    circle_messages = list(flight_recordings.load("circle_r5_v3_posvel").messages())
    assert circle_messages[-1][0] == pytest.approx(24.84, abs=0.01), "time on the vehicle's clock"


def test_ros2_setpoints_become_messages(reference_data):
    """Each OffboardControlMode becomes one message with the newest setpoint; motors do not use MAVLink."""

    def messages_of(name):
        recording = ros2_recordings.load(name, "vel_x_1")
        return [(t_s, message, fields) for t_s, message, fields in recording.messages() if t_s < 3.0]

    velocity = messages_of("vel_x2")
    assert {message for _, message, _ in velocity} == {"SET_POSITION_TARGET_LOCAL_NED"}
    assert len(velocity) == 59, "20 Hz from 0.099 s on"
    assert velocity[-1][2] == pytest.approx(velocity[-1][2] | {"type_mask": 0b100111000111, "vx": 2.0})
    assert messages_of("vel_x1_z_nan")[-1][2]["type_mask"] == 0b100111100111
    motors = [fields for _, message, fields in messages_of("motors_one_nan") if message == "actuators"]
    assert len(motors) == 37
    assert motors[0]["motors"] == pytest.approx([0.49, 0.49, 0.49, math.nan], nan_ok=True)
    attitude = [
        fields for _, message, fields in messages_of("att_roll10") if message == "SET_ATTITUDE_TARGET"
    ]
    assert attitude[60]["q"] == pytest.approx([0.996, 0.087, 0.0, 0.0], abs=1e-3)
    assert {fields["thrust"] for fields in attitude} == {0.49}
    commands = [
        fields for _, message, fields in messages_of("takeoff_hold_land") if message == "COMMAND_LONG"
    ]
    assert [fields["command"] for fields in commands] == [400, 22]
    assert math.isnan(commands[1]["param7"])


def test_each_ros2_flight_has_a_reference_flight_that_was_repeated(reference_data):
    references = {reference for _, reference in ros2_flights.MANOEUVRES.values()}
    assert all(flight_recordings.spread_of(reference).comparable for reference in references)
