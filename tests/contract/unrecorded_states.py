"""Starting states that unrecorded events caused.

Some dialogues are not in the recordings; between dialogues, the recording program flew, armed and landed the
vehicle without recording that. Each entry brings the simulated vehicle into such a state, and has a part of
the dialogue as evidence, which `test_rules.py` verifies. Then the dialogue is compared like any other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from tests.contract.recordings import Dialogue, mission_of_200_items
from tests.contract.replay_vehicle import (
    ARM_DISARM,
    DO_SET_MODE,
    FORCE_DISARM,
    HOLD_CUSTOM_MODE,
    TAKEOFF,
    Vehicle,
)
from tests.support.estimator_restart import restart_estimator

HOME_LAT_E7, HOME_LON_E7 = 473977423, 85455936
PREFLIGHT_CALIBRATION = 241
REMAINING_CLIMB_M = 4.0
"""Climb that remains when a dialogue begins during the take-off."""
METRE_E7 = 90
"""A metre to the north [1e-7 degrees], approximately."""
HOLD_MODE, MISSION_MODE, RTL_MODE = (4, 3), (4, 4), (4, 5)
RECEPTION_DELAY_S = {
    ("offboard_air_stream_slows_to_1hz", 5): 0.06,
    ("calibration_baro", 0): 10.79,
    ("arm_in_mode_takeoff", 0): 0.555,
}
"""Delay with which PX4 received the n-th message of each stream of a dialogue, because the recording machine
was busy. PX4 lost a 1 Hz stream, acknowledged a calibration command after 10.8 s and ignored its
cancellation, and armed half a second late."""

Action = Callable[[Vehicle, Dialogue], None]


@dataclass(frozen=True, slots=True)
class UnrecordedState:
    """One unrecorded starting state."""

    evidence: str
    """A part of the dialogue's JSON that shows this state."""
    establish: Action


def _fly_to_altitude(above_home_m: float, north_m: int = 0) -> Action:
    def establish(vehicle: Vehicle, _: Dialogue) -> None:
        lat_e7 = HOME_LAT_E7 + north_m * METRE_E7
        vehicle.go_to(lat_e7, HOME_LON_E7, vehicle.autopilot.home.alt_amsl_m + above_home_m)

    return establish


def _fly_to_orbit_centre(vehicle: Vehicle, dialogue: Dialogue) -> None:
    """Flies to the centre of the recorded orbit if the command has no centre, since PX4 then orbits the
    vehicle's position; otherwise to home."""
    orbit = next(e["fields"] for e in dialogue["received"] if e["msg"] == "ORBIT_EXECUTION_STATUS")
    without_centre = math.isnan(dialogue["send"][0]["fields"]["param5"] or math.nan)
    lat, lon = (orbit["x"], orbit["y"]) if without_centre else (HOME_LAT_E7, HOME_LON_E7)
    vehicle.go_to(lat, lon, orbit["z"])


def _upload_near_rally_point(vehicle: Vehicle, _: Dialogue) -> None:
    """Uploads a rally point 10 m above home, nearer than home, and in a frame that PX4 supports."""
    vehicle.go_to(HOME_LAT_E7 + 40 * METRE_E7, HOME_LON_E7, vehicle.autopilot.home.alt_amsl_m + 10.0)
    point = {"seq": 0, "frame": 3, "command": 5100, "current": 1, "autocontinue": 1, "mission_type": 2,
             "x": HOME_LAT_E7 + 25 * METRE_E7, "y": HOME_LON_E7, "z": 10.0}  # fmt: skip
    vehicle.upload([point])
    vehicle.run(1.5)


def _select_mode(*mode: int) -> Action:
    def establish(vehicle: Vehicle, _: Dialogue) -> None:
        vehicle.command(DO_SET_MODE, 1, *mode)
        vehicle.run(0.3)

    return establish


def _start_take_off(vehicle: Vehicle, _: Dialogue) -> None:
    """Starts a take-off to an altitude that the vehicle reaches at the end of the dialogue."""
    view = vehicle.autopilot.view
    alt_amsl_m = view.estimate.alt_amsl_m + 7.0
    vehicle.command(TAKEOFF, -1, 0, 0, math.nan, math.nan, math.nan, alt_amsl_m)
    vehicle.run_until(lambda: view.estimate.alt_amsl_m > alt_amsl_m - REMAINING_CLIMB_M, 20)


def _disarm_with_closed_log(vehicle: Vehicle, dialogue: Dialogue) -> None:
    """Disarms the vehicle, because the recorded heartbeat of an armed vehicle is from an earlier time. Arms
    it once before, so that its first log is closed."""
    vehicle.command(ARM_DISARM, 0, FORCE_DISARM)
    vehicle.run(1.0)
    vehicle.put_on_ground(False, HOLD_CUSTOM_MODE)
    vehicle.put_on_ground(True, HOLD_CUSTOM_MODE)
    vehicle.run(0.3)
    vehicle.put_on_ground(False, dialogue["state"]["custom_mode"])
    vehicle.run(0.5)


def _upload_200_items(vehicle: Vehicle, _: Dialogue) -> None:
    vehicle.upload(mission_of_200_items())
    vehicle.run(2.5)


def _set_parameter(name: str, value: float, wait_s: float) -> Action:
    def establish(vehicle: Vehicle, _: Dialogue) -> None:
        vehicle.set_parameter(name, value)
        vehicle.run(wait_s)

    return establish


def _turn_onto_its_side(vehicle: Vehicle, _: Dialogue) -> None:
    """Turns the vehicle onto its side, as an actuator test does with PX4's simulated airframe."""
    q_component = math.sqrt(0.5)
    vehicle.sim.simulation.set_attitude_if_disarmed(0, (q_component, q_component, 0.0, 0.0))
    # Restart the estimator, because the turn takes no simulated time.
    restart_estimator(vehicle.sim.simulation)
    vehicle.run(10.0)


def _start_return(vehicle: Vehicle, _: Dialogue) -> None:
    vehicle.hover_in_hold()
    vehicle.command(DO_SET_MODE, 1, *RTL_MODE)
    vehicle.run(1.0)
    vehicle.run_until(lambda: vehicle.altitude_m < 5.0, 60)


def _start_compass_calibration(vehicle: Vehicle, _: Dialogue) -> None:
    """Starts a compass calibration. The recorded one had waited 100 s for a person to turn the vehicle, and
    sent no message in that time."""
    vehicle.command(PREFLIGHT_CALIBRATION, 0, 1)
    vehicle.run(4.0)


def _hover_at_rest(vehicle: Vehicle, _: Dialogue) -> None:
    vehicle.stream_setpoints(True)
    vehicle.run(3.0)
    vehicle.run_until(lambda: vehicle.speed_m_s < 0.3, 10)
    vehicle.stream_setpoints(False)


def _turn_to_heading(yaw_ned_rad: float) -> Action:
    def establish(vehicle: Vehicle, _: Dialogue) -> None:
        vehicle.stream_setpoints(True)
        assert vehicle.background_setpoint is not None
        vehicle.background_setpoint["yaw"] = yaw_ned_rad
        vehicle.run(3.0)
        vehicle.stream_setpoints(False)

    return establish


def _close_console(vehicle: Vehicle, _: Dialogue) -> None:
    """Closes the console, which discards earlier characters without an end of line."""
    target = {"target_system": vehicle.system_id, "target_component": 1}
    vehicle.send("SERIAL_CONTROL", {"device": 10, "flags": 0, "count": 0, "data": [0] * 70, **target})
    vehicle.run(0.2)


UNRECORDED_STATES: dict[str, UnrecordedState] = {
    "air_takeoff_again": UnrecordedState("Already higher than takeoff altitude", _fly_to_altitude(14.0)),
    "air_setmode_auto_none": UnrecordedState("Climb to 10.0 meters above home", _fly_to_altitude(7.5)),
    "air_setmode_auto_mission": UnrecordedState("Executing Mission", _fly_to_altitude(10.0, 30)),
    "air_setmode_auto_rtl": UnrecordedState("530 m (30 m above destination", _upload_near_rally_point),
    "air_rtl": UnrecordedState("530 m (30 m above destination", _upload_near_rally_point),
    "air_standard_mode_7": UnrecordedState('"command": 2003, "confirmation": 0', _select_mode(*MISSION_MODE)),
    "air_standard_mode_8": UnrecordedState("Using default takeoff altitude: 2.5 m", _fly_to_altitude(1.8)),
    **{
        name: UnrecordedState('"msg": "ORBIT_EXECUTION_STATUS"', _fly_to_orbit_centre)
        for name in ("air_orbit_basic", "air_orbit_nan_radius", "air_orbit_too_fast", "air_orbit_centre_1km",
                     "air_orbit_yaw_behaviour_9", "air_orbit_nan_velocity")
    },
    "air_mission_clear_while_running": UnrecordedState('"custom_mode": 50593792', _select_mode(*HOLD_MODE)),
    "cmd_actuator_test_release": UnrecordedState("Attitude failure (roll)", _turn_onto_its_side),
    "param_set_cal_volatile": UnrecordedState("Attitude failure (roll)", _turn_onto_its_side),
    "fence_upload_inclusion_polygon": UnrecordedState('"total": 200', _upload_200_items),
    "fence_arm_inside_exclusion": UnrecordedState("[logger] ./log/", _disarm_with_closed_log),
    "fence_clear": UnrecordedState('"base_mode": 29', _disarm_with_closed_log),
    "mission_start_range_disarmed": UnrecordedState("Armed by mission start", _disarm_with_closed_log),
    "setmode_mission_disarmed_with_mission": UnrecordedState('"base_mode": 29', _disarm_with_closed_log),
    "param_set_int32_back": UnrecordedState(
        '"param_id": "NAV_DLL_ACT"', _set_parameter("NAV_DLL_ACT", 2, 2.5)
    ),
    "param_cruise_restore": UnrecordedState('"param_value": 5.0', _set_parameter("MPC_XY_CRUISE", 12.0, 2.5)),
    "param_set_negative_int": UnrecordedState(
        '"param_id": "COM_ARM_WO_GPS"', _set_parameter("COM_ARM_WO_GPS", 1, 0.2)
    ),
    "hold_after_rtl": UnrecordedState('"relative_altitude_m": 4.99', _start_return),
    "setmode_disarmed_posctl": UnrecordedState('"system_status": 2', _start_compass_calibration),
    "setmode_disarmed_base_29": UnrecordedState('"system_status": 2', _start_compass_calibration),
    "shell_again_after_exit": UnrecordedState("again_after_exit", _close_console),
    "offboard_air_no_stream": UnrecordedState('"custom_mode": 33816576', _start_take_off),
    **{
        name: UnrecordedState('"custom_mode": 50593792, "intended', _select_mode(*HOLD_MODE))
        for name in ("offboard_disarmed_stream_1hz", "offboard_disarmed_stream_2hz")
    },
    "sp_mask_velocity_0xdc7": UnrecordedState('"yaw": -0.194', _turn_to_heading(-0.19)),
    "sp_mask_position_only_0xdf8": UnrecordedState('"vz": 0.24', _hover_at_rest),
    "gsp_frame11_terrain": UnrecordedState('"vy": -0.06', _hover_at_rest),
}  # fmt: skip
"""Unrecorded starting state by the id of the dialogue."""
