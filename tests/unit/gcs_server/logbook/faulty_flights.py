"""Flights as logs in memory: a healthy one, and one with each fault that a kind of finding is to find."""

import numpy as np

from gcs_server.logbook.log import Log, Span, Topic, VehicleStates

END_S = 60.0
AIR = (10.0, 50.0)


def topic(name, rate_hz, instance="0", **fields):
    """A topic with values over the whole flight; a field is a function of time, or a number."""
    times_s = np.arange(0.0, END_S, 1.0 / rate_hz)
    values = {
        key.replace("__", "[") + ("]" if "__" in key else ""): np.broadcast_to(
            np.asarray(value(times_s) if callable(value) else value, float), times_s.shape
        ).copy()
        for key, value in fields.items()
    }
    return Topic(name, instance, times_s, values, {})


def between(begin_s, end_s, inside, outside=0.0):
    return lambda t: np.where((t >= begin_s) & (t < end_s), inside, outside)


def flight(*topics, parameters=None, modes=(), failsafe=(), kind="ulog", **more):
    """A flight in the air from 10 to 50 s."""
    landed = topic("vehicle_land_detected", 1, landed=between(*AIR, 0, 1))
    status = topic("vehicle_status", 2, nav_state=4, gcs_connection_lost=0)
    states = VehicleStates(
        "1", [Span(*m) for m in modes], [Span(8.0, 52.0, "Armed")], [Span(*f) for f in failsafe]
    )
    replaced = {each.id for each in topics}
    base = [each for each in (landed, status) if each.id not in replaced and kind == "ulog"]
    return Log(
        kind=kind, start_unix_s=None, duration_s=END_S, topics=[*base, *topics], vehicles=[states],
        parameters=dict(parameters or {}), **more,
    )  # fmt: skip


def gps(**fields):
    healthy = {"fix_type": 3, "satellites_used": 12, "eph": 0.8, "epv": 1.2, "s_variance_m_s": 0.3}
    healthy |= {"latitude_deg": lambda t: 47 + 1e-6 * np.sin(t), "longitude_deg": 8, "altitude_msl_m": 500}
    healthy |= {"jamming_indicator": 10, "jamming_state": 1, "spoofing_state": 1}
    return topic("vehicle_gps_position", 5, **(healthy | fields))


def motors(*levels):
    values = {
        f"control__{k}": (lambda t, level=level: level + 0.01 * np.sin(7 * t))
        if not callable(level)
        else level
        for k, level in enumerate(levels)
    }
    return topic("actuator_motors", 10, **values)


def imu(**fields):
    return topic("vehicle_imu_status", 1, **fields)


def rates(**fields):
    noise = np.random.default_rng(1)
    healthy = {f"xyz__{k}": lambda t: 0.08 * noise.standard_normal(t.shape) for k in range(3)}
    return topic("vehicle_angular_velocity", 50, **(healthy | fields))


def attitude(roll_rad, wanted_rad):
    half = lambda angle: (lambda t: np.cos(angle(t) / 2), lambda t: np.sin(angle(t) / 2))  # noqa: E731
    (w, x), (wd, xd) = half(roll_rad), half(wanted_rad)
    return (
        topic("vehicle_attitude", 20, q__0=w, q__1=x, q__2=0, q__3=0),
        topic("vehicle_attitude_setpoint", 20, q_d__0=wd, q_d__1=xd, q_d__2=0, q_d__3=0),
    )


def battery(**fields):
    return topic(
        "battery_status",
        5,
        **({"voltage_v": 15.6, "current_a": 12, "cell_count": 4, "remaining": 0.7} | fields),
    )


def ratios(**fields):
    return topic(
        "estimator_status", 5,
        **({f"{each}_test_ratio": 0.1 for each in ("vel", "pos", "hgt", "hdg")} | fields),
    )  # fmt: skip


def position(**fields):
    counters = {f"{each}_reset_counter": 0 for each in ("xy", "z", "vxy", "vz", "heading")}
    healthy = {"x": 0, "y": 0, "z": -10, "vx": 0, "vy": 0, "vz": 0, "heading": 0}
    return topic("vehicle_local_position", 10, **(healthy | counters | fields))


def thrust_and_field(change):
    load = between(*AIR, -0.5, 0.0)
    return (
        topic("vehicle_thrust_setpoint", 50, xyz__2=load),
        topic(
            "vehicle_magnetometer", 10,
            magnetometer_ga__0=lambda t: 0.2 - change * load(t), magnetometer_ga__1=0, magnetometer_ga__2=0.4,
        ),
    )  # fmt: skip


def sagging(ohm):
    current = lambda t: 15 + 10 * np.sin(0.7 * t)  # noqa: E731
    return battery(current_a=current, voltage_v=lambda t: 17.4 - 0.005 * t - ohm * current(t))


SWING = 2 * np.pi * 6.0
HEALTHY = flight(
    imu(accel_vibration_metric=2, accel_clipping__0=0, temperature_accel=45),
    gps(), motors(0.5, 0.52, 0.48, 0.5), rates(), battery(), ratios(), position(), *thrust_and_field(0.02),
    *attitude(lambda t: 0.3 * np.sin(t - 0.1), lambda t: 0.3 * np.sin(t)),
    topic("cpuload", 2, load=0.4, ram_usage=0.5), topic("failsafe_flags", 2, geofence_breached=0),
    topic("obstacle_distance", 10, distances__0=900, distances__1=65535),
)  # fmt: skip
FAULTS = {
    ("vibration", "caution"): flight(imu(accel_vibration_metric=between(20, 30, 7))),
    ("vibration", "warning"): flight(imu(accel_vibration_metric=between(20, 30, 15))),
    ("clipping", "warning"): flight(
        imu(accel_clipping__0=lambda t: 30 * np.clip(np.floor(t - 20), 0, 5))
    ),
    ("gps_quality", "warning"): flight(gps(fix_type=between(20, 25, 0, 3))),
    ("gps_quality", "caution"): flight(gps(satellites_used=between(20, 25, 4, 12))),
    ("gps_interference", "caution"): flight(gps(jamming_indicator=between(20, 25, 120))),
    ("gps_interference", "warning"): flight(gps(spoofing_state=between(20, 25, 2, 1))),
    ("compass", "warning"): flight(*thrust_and_field(0.6)),
    ("innovation", "warning"): flight(ratios(pos_test_ratio=between(20, 23, 4, 0.1))),
    ("reset", "warning"): flight(position(x=between(30, 99, 12), xy_reset_counter=between(30, 99, 1))),
    ("attitude_tracking", "warning"): flight(*attitude(between(20, 23, 0.5), lambda t: 0.01 * np.sin(t))),
    ("oscillation", "warning"): flight(rates(xyz__0=lambda t: 0.9 * np.sin(SWING * t))),
    ("saturation", "warning"): flight(motors(between(20, 23, 1.0, 0.5), 0.5, 0.5, 0.5)),
    ("saturation", "caution"): flight(motors(0.85, 0.86, 0.87, 0.85)),
    ("imbalance", "caution"): flight(motors(0.5, 0.5, 0.5, 0.65)),
    ("imbalance", "warning"): flight(motors(0.4, 0.4, 0.4, 0.7)),
    ("battery_sag", "warning"): flight(battery(voltage_v=between(20, 25, 13.0, 15.6))),
    ("battery_resistance", "caution"): flight(sagging(0.12)),
    ("battery_charge", "warning"): flight(battery(remaining=lambda t: 0.9 - 1.1 * t / END_S)),
    ("temperature", "caution"): flight(imu(temperature_accel=between(20, 40, 92, 50))),
    ("load", "warning"): flight(topic("cpuload", 2, load=between(20, 25, 0.99, 0.4), ram_usage=0.5)),
    ("dropout", "caution"): flight(dropouts=[(20.0, 0.9)]),
    ("link", "caution"): flight(
        topic("vehicle_status", 2, nav_state=4, gcs_connection_lost=between(20, 30, 1))
    ),
    ("fence", "warning"): flight(topic("failsafe_flags", 2, geofence_breached=between(20, 23, 1))),
    ("fence", "caution"): flight(
        topic("failsafe_flags", 2, geofence_breached=0), position(x=between(20, 24, 97)),
        topic("home_position", 1, x=0, y=0, z=0), parameters={"GF_MAX_HOR_DIST": 100.0},
    ),
    ("obstacle", "warning"): flight(topic("obstacle_distance", 10, distances__0=between(20, 22, 120, 900))),
    ("setpoint_gap", "warning"): flight(
        topic("offboard_control_mode", 10, position=1), modes=[(0.0, 12.0, "Hold"), (12.0, 59.0, "Offboard")]
    ),
    ("failsafe", "warning"): flight(
        topic("failsafe_flags", 2, geofence_breached=0, gcs_connection_lost=between(30, 99, 1)), battery(),
        modes=[(0.0, 30.0, "Mission"), (30.0, 50.0, "Return")], failsafe=[(30.0, 50.0, "Failsafe")],
        parameters={"NAV_DLL_ACT": 2},
    ),
}  # fmt: skip
STREAM = FAULTS["setpoint_gap", "warning"].topics[-1]
KEPT = (STREAM.times_s < 25.0) | (STREAM.times_s > 26.4)
STREAM.times_s, STREAM.columns = STREAM.times_s[KEPT], {k: v[KEPT] for k, v in STREAM.columns.items()}
