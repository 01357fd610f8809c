"""Findings of the sensors: vibration, clipping, GPS, compass, temperature.

Limits are those that PX4's documentation and Flight Review show beside their plots ("Log Analysis using
Flight Review", docs.px4.io), or the vehicle's own parameters.
"""

from __future__ import annotations

import numpy as np

from gcs_server.logbook.findings.model import (
    Finding,
    Flight,
    NotJudged,
    Signal,
    Span,
    above,
    highest,
    longest,
    signal_of,
    spans,
    total_s,
)
from gcs_server.logbook.log import Topic

VIBRATION_CAUTION_M_S2, VIBRATION_WARNING_M_S2 = 4.905, 9.81
"""Flight Review, "Vibration Metrics": orange from half of g, red from g."""
MIN_CLIPPED_SAMPLES = 20
JAMMING_LIMIT = 80
"""PX4's documentation of Flight Review: a jamming indicator of 40 or less is fine, one of 80 or more is
not."""
GPS_NO_DATA_S = 2.0
GPS_REPEATS_S = 3.0
COMPASS_CHANGE = 0.15
COMPASS_CORRELATION = 0.7
"""Flight Review shows thrust beside the norm of the magnetic field, which must not follow it; how much is
ours."""
IMU_MAX_DEG_C, BATTERY_MAX_DEG_C = 85.0, 60.0
"""Operating range of usual IMUs (ICM-42688-P, BMI088), and the usual limit of lithium polymer cells."""


def vibration(flight: Flight) -> list[Finding]:
    """Vibration: mean change of the acceleration from sample to sample (PX4's accel_vibration_metric)."""
    found: list[Finding] = []
    fields = [signal_of(topic, column) for topic, column in _vibration_columns(flight)]
    for signal in fields:
        if not len(signal.values) or not (high := above(flight, signal, VIBRATION_CAUTION_M_S2, 3.0)):
            continue
        span = longest(high)
        peak = highest(signal, span)
        found.append(
            Finding(
                "warning" if peak > VIBRATION_WARNING_M_S2 else "caution", span.begin_s, span.end_s,
                f"The vibration of the accelerometer rose to {peak:.1f} m/s², and was high for "
                f"{total_s(high):.0f} s.",
                f"Good below {VIBRATION_CAUTION_M_S2:.1f} m/s², too high above {VIBRATION_WARNING_M_S2:.1f} "
                "m/s² (PX4 Flight Review).",
                "Balance the propellers, look for loose or damaged parts, and mount the autopilot softer.",
                [[signal.field], _acceleration_fields(flight)],
            )
        )  # fmt: skip
    return found


def _vibration_columns(flight: Flight) -> list[tuple[Topic, str]]:
    column = "vibration_z" if flight.is_tlog else "accel_vibration_metric"
    topics = flight.topics("vehicle_imu_status", "VIBRATION")
    return [(topic, column) for topic in topics if column in topic.columns]


def _acceleration_fields(flight: Flight) -> list[str]:
    for topic, columns in (
        ("sensor_combined", [f"accelerometer_m_s2[{k}]" for k in range(3)]),
        ("HIGHRES_IMU", ["xacc", "yacc", "zacc"]),
    ):
        if flight.has(topic):
            return [f"{flight.topic(topic).id}/{c}" for c in columns if c in flight.topic(topic).columns]
    return []


def clipping(flight: Flight) -> list[Finding]:
    """Clipping: the acceleration exceeded the range of the sensor; its counters rise."""
    columns = (
        [f"clipping_{k}" for k in range(3)] if flight.is_tlog else [f"accel_clipping[{k}]" for k in range(3)]
    )
    found: list[Finding] = []
    for topic in flight.topics("vehicle_imu_status", "VIBRATION"):
        counters = [signal_of(topic, each) for each in columns if each in topic.columns]
        # one sensor: VIBRATION of PX4 has the three axes too
        rising = [each for each in counters if len(each.values) > 1]
        if not rising:
            continue
        times_s = rising[0].times_s[1:]
        added = sum(np.clip(np.diff(each.at(rising[0].times_s)), 0, 1e6) for each in rising)
        added = np.where(flight.in_air(times_s, 2.0), added, 0.0)
        clipped = spans(rising[0].times_s[:-1], added > 0, float(times_s[-1]), join_s=5.0)
        if float(np.sum(added)) < MIN_CLIPPED_SAMPLES or not clipped:
            continue
        span = longest(clipped)
        found.append(
            Finding(
                "warning", span.begin_s, span.end_s,
                f"The accelerometer was at the end of its range in {float(np.sum(added)):.0f} samples in "
                "the air.",
                "None should be: the estimate of height and speed then drifts (PX4, “Vibration Isolation”).",
                "Reduce the vibration: propellers, motors, loose parts, mounting of the autopilot.",
                [[each.field for each in rising], _acceleration_fields(flight)],
            )
        )  # fmt: skip
    return found


def gps_quality(flight: Flight) -> list[Finding]:
    """GPS: fix, gaps, satellites and accuracy, beside what the vehicle requires to use it (EKF2_REQ_*)."""
    if flight.parameter("SYS_HAS_GPS", 1) == 0:
        raise NotJudged("The vehicle has no GPS receiver (SYS_HAS_GPS 0).")
    fix = flight.signal("vehicle_gps_position/fix_type", "sensor_gps/fix_type", "GPS_RAW_INT/fix_type")
    end_s = flight.log.duration_s
    satellites = flight.optional(
        "vehicle_gps_position/satellites_used", "sensor_gps/satellites_used", "GPS_RAW_INT/satellites_visible"
    )
    shown = [[fix.field], *([[satellites.field]] if satellites is not None else [])]
    found: list[Finding] = []
    without = spans(fix.times_s, (fix.values < 3) & flight.in_air(fix.times_s), end_s, 1.0)
    if without:
        span = longest(without)
        found.append(
            Finding(
                "warning", span.begin_s, span.end_s,
                f"The GPS had no position for {total_s(without):.0f} s in the air.",
                "In the air it needs a 3D fix all the time (fix_type 3 or more).",
                "Check antenna, cable and view of the sky. Find out what the vehicle is to do without "
                "position (COM_POSCTL_NAVL).",
                shown,
            )
        )  # fmt: skip
    gaps = np.flatnonzero(
        (np.diff(fix.times_s) > GPS_NO_DATA_S)
        & flight.in_air(fix.times_s[:-1])
        & flight.in_air(fix.times_s[1:])
    )
    logged_often = len(fix.times_s) > 3 and float(np.median(np.diff(fix.times_s))) < GPS_NO_DATA_S / 2
    for gap in gaps[:3] if logged_often and not flight.is_tlog else ():
        begin_s, until_s = float(fix.times_s[gap]), float(fix.times_s[gap + 1])
        found.append(
            Finding(
                "warning", begin_s, until_s,
                f"The GPS receiver sent nothing for {until_s - begin_s:.1f} s in the air.",
                f"PX4 uses positions that are at most {GPS_NO_DATA_S:.0f} s apart.",
                "Check the receiver's cable, plug and supply.",
                shown,
            )
        )  # fmt: skip
    return found + ([] if without else _gps_repeats(flight) + _gps_accuracy(flight, satellites))


def _gps_repeats(flight: Flight) -> list[Finding]:
    """A position that does not change at all: no receiver measures that in the air."""
    fields = [
        flight.optional(f"vehicle_gps_position/{ulog}", f"sensor_gps/{ulog}", f"GPS_RAW_INT/{tlog}")
        for ulog, tlog in (("latitude_deg", "lat"), ("longitude_deg", "lon"), ("altitude_msl_m", "alt"))
    ]
    position = [each for each in fields if each is not None]
    if len(position) < 3 or len(position[0].times_s) < 2:
        return []
    times_s = position[0].times_s
    equal = np.all([np.diff(each.at(times_s)) == 0.0 for each in position], axis=0)
    equal &= flight.in_air(times_s[1:]) & (np.diff(times_s) < GPS_NO_DATA_S)
    often = float(np.median(np.diff(times_s))) <= GPS_REPEATS_S / 8
    repeated = spans(times_s[1:], equal, float(times_s[-1]), GPS_REPEATS_S, join_s=0.0) if often else []
    return [
        Finding(
            "warning", span.begin_s, span.end_s,
            f"The GPS repeated one position for {span.end_s - span.begin_s:.1f} s in the air.",
            "A receiver that works never measures the same twice in the air.",
            "Check the receiver's cable, plug and supply.",
            [[each.field for each in position[:2]]],
        )
        for span in repeated[:3]
    ]  # fmt: skip


def _gps_accuracy(flight: Flight, satellites: Signal | None) -> list[Finding]:
    found: list[Finding] = []
    few = flight.parameter("EKF2_REQ_NSATS", 6)
    if satellites is not None:
        mask = (satellites.values < few) & flight.in_air(satellites.times_s)
        if low := spans(satellites.times_s, mask, flight.log.duration_s, 3.0):
            span = longest(low)
            least = float(np.min(satellites.between(span.begin_s, span.end_s).values))
            found.append(
                Finding(
                    "caution", span.begin_s, span.end_s,
                    f"The GPS used only {least:.0f} satellites; for {total_s(low):.0f} s fewer than "
                    f"{few:.0f}.",
                    f"At least {few:.0f} (EKF2_REQ_NSATS).",
                    "Fly with a free view of the sky, and keep cameras, computers and transmitters away "
                    "from the antenna.",
                    [[satellites.field]],
                )
            )  # fmt: skip
    for column, name, default, unit in (
        ("eph", "EKF2_REQ_EPH", 3.0, "m"),
        ("epv", "EKF2_REQ_EPV", 5.0, "m"),
        ("s_variance_m_s", "EKF2_REQ_SACC", 0.5, "m/s"),
    ):
        accuracy = flight.optional(f"vehicle_gps_position/{column}", f"sensor_gps/{column}")
        limit = flight.parameter(name, default)
        if accuracy is None or not (bad := above(flight, accuracy, limit, 3.0)):
            continue
        span = longest(bad)
        found.append(
            Finding(
                "caution", span.begin_s, span.end_s,
                f"The GPS stated an accuracy of only {highest(accuracy, span):.1f} {unit}; for "
                f"{total_s(bad):.0f} s it was too bad.",
                f"At most {limit:.1f} {unit} ({name}).",
                "Fly with a free view of the sky, and keep cameras, computers and transmitters away from "
                "the antenna.",
                [[accuracy.field], *([[satellites.field]] if satellites is not None else [])],
            )
        )  # fmt: skip
    return found


def gps_interference(flight: Flight) -> list[Finding]:
    """Jamming and spoofing as the receiver reports them."""
    jamming = flight.signal("vehicle_gps_position/jamming_indicator", "sensor_gps/jamming_indicator")
    topic = jamming.field.split(":")[0]
    noise = flight.optional(f"{topic}/noise_per_ms")
    found: list[Finding] = []
    if high := above(flight, jamming, JAMMING_LIMIT - 1, 3.0):
        span = longest(high)
        found.append(
            Finding(
                "caution", span.begin_s, span.end_s,
                f"The GPS was disturbed by radio noise: jamming indicator {highest(jamming, span):.0f} for "
                f"{total_s(high):.0f} s.",
                f"About 40 or less; {JAMMING_LIMIT} or more is too much (PX4, “Log Analysis using Flight "
                "Review”).",
                "Move the antenna away from cameras, computers, USB 3 and transmitters, or shield them.",
                [[jamming.field], *([[noise.field]] if noise is not None else [])],
            )
        )  # fmt: skip
    for column, text in (
        ("jamming_state", "The GPS receiver reported jamming, for"),
        ("spoofing_state", "The GPS receiver reported false satellite signals (spoofing), for"),
    ):
        state = flight.optional(f"{topic}/{column}")
        if state is None or not (reported := above(flight, state, 1.5, 1.0)):
            continue
        span = longest(reported)
        found.append(
            Finding(
                "warning", span.begin_s, span.end_s,
                f"{text} {total_s(reported):.0f} s.",
                "None in a normal flight (state of the receiver).",
                "Do not trust the position there; find out where the signal comes from before flying there "
                "again.",
                [[state.field], [jamming.field]],
            )
        )  # fmt: skip
    return found


def compass(flight: Flight) -> list[Finding]:
    """Compass: whether the strength of the field follows the current of the motors, or else the thrust."""
    columns = [
        flight.signal(f"vehicle_magnetometer/magnetometer_ga[{k}]", f"SCALED_IMU/{axis}mag")
        for k, axis in enumerate(("x", "y", "z"))
    ]
    times_s = columns[0].times_s
    norm = np.sqrt(sum(each.at(times_s) ** 2 for each in columns))
    load = flight.optional("battery_status/current_a")
    if load is None or float(np.max(load.values)) <= 0.0:
        load = flight.signal("vehicle_thrust_setpoint/xyz[2]", "vehicle_rates_setpoint/thrust_body[2]")
    # both as means of a second, so that noise does not hide what they share
    seconds = np.floor(times_s).astype(np.int64)
    _, group = np.unique(seconds, return_inverse=True)
    counts = np.bincount(group)
    field = np.bincount(group, norm) / counts
    carried = np.bincount(group, np.abs(load.at(times_s)) * flight.armed(times_s)) / counts
    if len(field) < 10 or float(np.std(carried)) < 1e-6 or float(np.std(field)) < 1e-9:
        return []
    correlation = float(np.corrcoef(field, carried)[0, 1])
    low, high = np.percentile(carried, [5, 95])
    slope = correlation * float(np.std(field)) / float(np.std(carried))
    change = abs(slope) * float(high - low) / max(float(np.median(field)), 1e-9)
    if abs(correlation) < COMPASS_CORRELATION or change < COMPASS_CHANGE or not flight.air:
        return []
    begin_s, end_s = flight.air[0].begin_s, flight.air[-1].end_s
    strength = "norm(" + ", ".join(f"{{{each.field}}}" for each in columns) + ")"
    return [
        Finding(
            "warning" if change > 2 * COMPASS_CHANGE else "caution", begin_s, end_s,
            f"The magnetic field follows the current of the motors: it changes by {100 * change:.0f} % "
            f"(correlation {correlation:.2f}).",
            "It should stay constant (PX4, “Log Analysis using Flight Review”); more than "
            f"{100 * COMPASS_CHANGE:.0f} % is reported here.",
            "Move the compass away from the power cables, twist these, or calibrate with power compensation.",
            [[strength], [load.field]],
        )
    ]  # fmt: skip


def thermal(flight: Flight) -> list[Finding]:
    """Temperatures of IMU and battery, where they are measured."""
    found: list[Finding] = []
    judged = False
    for fields, limit, what in (
        (
            ("vehicle_imu_status/temperature_accel", "sensor_accel/temperature"),
            IMU_MAX_DEG_C,
            "The IMU was too warm",
        ),
        (("battery_status/temperature",), BATTERY_MAX_DEG_C, "The battery was too warm"),
    ):
        temperature = flight.optional(*fields)
        if temperature is None:
            continue
        judged = True
        mask = temperature.values > limit
        if hot := spans(temperature.times_s, mask, float(temperature.times_s[-1]), 2.0):
            span = Span(hot[0].begin_s, hot[-1].end_s, "")
            found.append(
                Finding(
                    "caution", span.begin_s, span.end_s,
                    f"{what}: {highest(temperature, span):.0f} °C.",
                    f"At most {limit:.0f} °C (data sheets of usual parts).",
                    "Give it air, or shade; let it cool before the next flight.",
                    [[temperature.field]],
                )
            )  # fmt: skip
    if not judged:
        raise NotJudged("No temperature is logged.")
    return found
