"""The flight state after each message that changes it."""

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import encode_payload
from gcs_server.vehicle import reducers
from gcs_server.vehicle.mode_cause import is_overruled
from gcs_server.vehicle.px4.modes import BY_NAME
from gcs_server.vehicle.reducers import FlightState

TAKEOFF, HOLD, RTL = (BY_NAME[name].custom_mode for name in ("takeoff", "hold", "rtl"))


def after_heartbeat(flight_state: FlightState, custom_mode: int) -> FlightState:
    message = d.MAVLink_heartbeat_message(
        d.MAV_TYPE_QUADROTOR,
        d.MAV_AUTOPILOT_PX4,
        d.MAV_MODE_FLAG_SAFETY_ARMED,
        custom_mode,
        d.MAV_STATE_ACTIVE,
        3,
    )
    return reducers.heartbeat(flight_state, encode_payload(message), flight_state.mode_s + 1)


def after_current_mode(flight_state: FlightState, custom_mode: int, intended: int) -> FlightState:
    message = d.MAVLink_current_mode_message(0, custom_mode, intended)
    return reducers.current_mode(flight_state, encode_payload(message), flight_state.mode_s + 1)


def test_after_a_take_off_hold_is_no_failsafe_although_current_mode_comes_later_than_the_heartbeat() -> None:
    taking_off = after_current_mode(FlightState(mode_s=0.0), TAKEOFF, TAKEOFF)
    holding = after_heartbeat(taking_off, HOLD)
    assert holding.intended_custom_mode is None
    assert not is_overruled(holding)
    holding = after_current_mode(holding, HOLD, HOLD)
    assert holding.intended_custom_mode == HOLD


def test_a_heartbeat_with_the_same_mode_keeps_the_intended_mode() -> None:
    returning = after_current_mode(FlightState(mode_s=0.0), RTL, HOLD)
    assert is_overruled(after_heartbeat(returning, RTL))


def test_an_intended_mode_of_zero_is_unknown() -> None:
    assert after_current_mode(FlightState(mode_s=0.0), HOLD, 0).intended_custom_mode is None
