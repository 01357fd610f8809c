"""Flights commanded over ROS 2: the simulated PX4 compared with the real one, on a second set of flights.

No number in the simulator was fitted to them. Thrust, torque and motor setpoints, which have no MAVLink
message, use the simulator's internal interface. There is one recording of each flight, so its spread is that
of the most similar reference flight.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from . import flight_replay, ros2_recordings
from .flight_comparison import (
    ATTITUDE,
    PATH,
    POSITION,
    RATE,
    VELOCITY,
    XYZ,
    Comparison,
    Manoeuvre,
    compare,
)
from .reference_flights import rows

ROLL_PITCH = ("roll", "pitch")
MANOEUVRES: dict[str, tuple[Manoeuvre, str]] = {
    "acc_x1": (Manoeuvre(VELOCITY, ("vx",), "vx", 0.1, 2.1), "acc_x_1"),
    "att_10hz_roll5": (Manoeuvre(ATTITUDE, ROLL_PITCH, "roll", 0.6, 1.6), "att_roll_10_clean"),
    "att_level_049": (Manoeuvre(ATTITUDE, ROLL_PITCH, None, 0.1, 2.1), "att_thrust_step_clean"),
    "att_q_nan": (Manoeuvre(ATTITUDE, ROLL_PITCH, None, 0.1, 1.1), "att_thrust_step_clean"),
    "att_roll10": (Manoeuvre(ATTITUDE, ROLL_PITCH, "roll", 0.6, 1.6), "att_roll_10_clean"),
    "loss_all_act3": (Manoeuvre(PATH, ("z",), "z", 0.0, 8.0), "land_from_10m"),
    "loss_all_act5": (Manoeuvre(POSITION, XYZ, None, 0.0, 8.0), "hold_drift_30s"),
    "loss_all_streams": (Manoeuvre(PATH, ("z",), "z", 0.0, 8.0), "offboard_stop_streaming"),
    "motors_equal_049": (Manoeuvre(ATTITUDE, ROLL_PITCH, None, 0.1, 1.1), "rate_roll_pulse_clean"),
    "motors_one_nan": (Manoeuvre(ATTITUDE, ROLL_PITCH, "roll", 0.1, 0.6), "rate_roll_pulse_clean"),
    "motors_roll_pulse": (Manoeuvre(ATTITUDE, ROLL_PITCH, None, 0.1, 1.3), "rate_roll_pulse_clean"),
    "ocm_08hz": (Manoeuvre(POSITION, XYZ, None, 0.0, 8.0), "hold_drift_30s"),
    "ocm_1hz": (Manoeuvre(POSITION, XYZ, None, 0.0, 8.0), "hold_drift_30s"),
    "pos_step_x3": (Manoeuvre(POSITION, XYZ, "x", 0.0, 6.1), "pos_step_x_p5"),
    "pos_with_velocity_ff": (Manoeuvre(POSITION, XYZ, "x", 0.0, 6.1), "pos_step_x_p5"),
    "pos_yawspeed": (Manoeuvre(ATTITUDE, ("yaw",), "yaw", 0.0, 5.2), "pos_yawrate_0p5"),
    "pos_z_only_nan_xy": (Manoeuvre(POSITION, ("z",), "z", 0.0, 5.2), "pos_step_z_up3"),
    "rate_roll20": (Manoeuvre(RATE, ("p",), "p", 0.6, 1.2), "rate_roll_pulse_clean"),
    "seed_node_20hz_square": (Manoeuvre(POSITION, XYZ, "x", 14.5, 19.5), "pos_step_x_p5"),
    "seed_node_5m": (Manoeuvre(PATH, ("z",), "z", 0.0, 20.0), "takeoff_10m"),
    "setmode_takeoff_hold_land": (Manoeuvre(PATH, ("z",), "z", 0.0, 20.0), "takeoff_2p5m"),
    "takeoff_hold_land": (Manoeuvre(PATH, ("z",), "z", 0.0, 20.0), "takeoff_2p5m"),
    "tt_hover": (Manoeuvre(ATTITUDE, ROLL_PITCH, None, 0.1, 1.3), "rate_roll_pulse_clean"),
    "tt_roll_pulse": (Manoeuvre(ATTITUDE, ROLL_PITCH, None, 0.1, 1.3), "rate_roll_pulse_clean"),
    "vel_up1": (Manoeuvre(VELOCITY, ("vz",), "vz", 0.1, 3.1), "vel_z_up1p5"),
    "vel_x1_z_nan": (Manoeuvre(VELOCITY, ("vx", "vy"), None, 0.1, 3.1), "vel_x_1"),
    "vel_x2": (Manoeuvre(VELOCITY, ("vx",), "vx", 0.1, 4.1), "vel_x_1"),
    "yaw_nan_only": (Manoeuvre(POSITION, XYZ, "x", 0.0, 4.2), "pos_step_x_p5"),
}
"""How each flight is evaluated, and the reference flight whose spread is used."""


NOISY_FLIGHTS = 4


def measure(selected: list[str] | None = None) -> list[Comparison]:
    """Flies and compares these flights (default: all)."""
    recordings = [ros2_recordings.load(name, MANOEUVRES[name][1]) for name in selected or MANOEUVRES]
    flown = flight_replay.fly(recordings)
    return [compare(each, flown[each.name], MANOEUVRES[each.name][0]) for each in recordings]


def within_limits_with_noise() -> Iterator[int]:
    """Number of flights within their limits if simulated flights with noise take the recordings' place.

    A limit comes from one pair of flights, so not every pair of PX4's own flights would be within it. This
    number shows how many can be expected to be.
    """
    recordings = [ros2_recordings.load(name, reference) for name, (_, reference) in MANOEUVRES.items()]
    flown = flight_replay.fly(recordings)
    for seed in range(NOISY_FLIGHTS):
        noisy_flights = flight_replay.fly(recordings, noise=True, seed=seed)
        compared = [
            compare(
                dataclasses.replace(
                    each, t_s=noisy_flights[each.name].t_s, columns=noisy_flights[each.name].columns
                ),
                flown[each.name],
                MANOEUVRES[each.name][0],
            )
            for each in recordings
        ]
        yield sum(each.within_limit and each.rise_agrees for each in compared)


def table() -> Iterator[str]:
    """Rows of Markdown."""
    if not ros2_recordings.FLIGHTS.is_dir():
        yield "The recordings (../shared/px4/dds/flights) are not beside this checkout."
        return
    yield from rows(measure())
    yield ""
    within = ", ".join(str(each) for each in within_limits_with_noise())
    yield (
        f"In place of the recordings, simulated flights with sensor noise (seeds 0 to {NOISY_FLIGHTS - 1}) "
        f"have {within} of {len(MANOEUVRES)} within the same limits."
    )
