"""Findings of the controllers: attitude tracking, oscillation, saturated motors, imbalance.

PX4's documentation asks that estimates follow their setpoints closely and without oscillation ("Log Analysis
using Flight Review", "Tracking"); it gives no numbers, so these limits are the station's own.
"""

from __future__ import annotations

import numpy as np

from gcs_server.logbook.findings.model import (
    Finding,
    Flight,
    NotJudged,
    Signal,
    Values,
    highest,
    longest,
    signal_of,
    spans,
    total_s,
)
from gcs_server.logbook.log import Times

TILT_ERROR_RAD = float(np.radians(12.0))
TILT_ERROR_S = 1.0
SETPOINT_MAX_AGE_S = 0.5
WINDOW_S = 2.0
"""Oscillation is judged in windows of this length, half overlapping."""
LOWEST_HZ = 2.0
OSCILLATION_RAD_S = 0.35
OSCILLATION_SHARE = 0.5
OSCILLATION_S = 4.0
"""A body rate swings with one frequency, which has this share of all its movement above LOWEST_HZ, for this
time."""
MIN_SAMPLES = 32
MAX_WINDOWS = 20_000
SATURATED = 0.99
SATURATED_S = 1.0
SATURATED_SHARE = 0.05
HIGH_THRUST = 0.8
HIGH_THRUST_S = 5.0
IMBALANCE = 0.25
IMBALANCE_S = 5.0
AXES = ("roll", "pitch", "yaw")


def attitude_tracking(flight: Flight) -> list[Finding]:
    """Tilt error: angle between the measured and the wanted axis of thrust."""
    actual = _quaternion(flight, ["vehicle_attitude/q[{}]"], "ATTITUDE_QUATERNION/q{}", one_based=True)
    wanted = _quaternion(
        flight, ["vehicle_attitude_setpoint/q_d[{}]"], "ATTITUDE_TARGET/q[{}]", one_based=False
    )
    times_s = actual[0].times_s
    age_s = times_s - _changed(wanted).at(times_s)
    with np.errstate(all="ignore"):
        cosine = np.sum(_down(actual, times_s) * _down(wanted, times_s), axis=0)
    error = np.arccos(np.clip(np.nan_to_num(cosine, nan=1.0), -1.0, 1.0))
    usable = flight.in_air(times_s, 2.0) & (age_s >= 0.0) & (age_s <= SETPOINT_MAX_AGE_S)
    bad = spans(times_s, (error > TILT_ERROR_RAD) & usable, float(times_s[-1]), TILT_ERROR_S, join_s=0.2)
    if not bad:
        return []
    span = longest(bad)
    peak = np.degrees(np.max(error[(times_s >= span.begin_s) & (times_s <= span.end_s)]))
    roll = [
        f"{axis}({', '.join(f'{{{each.field}}}' for each in q)})"
        for axis in AXES[:2]
        for q in (actual, wanted)
    ]
    return [
        Finding(
            "warning", span.begin_s, span.end_s,
            f"The vehicle did not tilt as wanted: the error was up to {peak:.0f}°, for "
            f"{span.end_s - span.begin_s:.1f} s at a stretch.",
            f"At most {np.degrees(TILT_ERROR_RAD):.0f}° for {TILT_ERROR_S:.0f} s (limit of this station; "
            "PX4: estimate and setpoint should match closely).",
            "Look for saturated motors, wind, a wrong centre of gravity or a broken propeller; otherwise "
            "tune the attitude and rate controllers.",
            [roll[:2], roll[2:]],
        )
    ]  # fmt: skip


def _quaternion(flight: Flight, ulog: list[str], tlog: str, *, one_based: bool) -> list[Signal]:
    return [flight.signal(*(each.format(k) for each in ulog), tlog.format(k + one_based)) for k in range(4)]


def _changed(q: list[Signal]) -> Signal:
    """At each time, when the setpoint last changed: one that stays the same for long belongs to another
    mode, as PX4
    goes on sending its last attitude while body rates are flown."""
    times_s = q[0].times_s
    moved = np.any([np.diff(each.at(times_s), prepend=np.inf) != 0.0 for each in q], axis=0)
    return Signal("", times_s, np.maximum.accumulate(np.where(moved, times_s, times_s[0])))


def _down(q: list[Signal], times_s: Times) -> Values:
    """(3, N): the body's down axis in the world."""
    w, x, y, z = (each.at(times_s) for each in q)
    norm = w * w + x * x + y * y + z * z
    return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z]) / norm


def oscillation(flight: Flight) -> list[Finding]:
    """Oscillation: a body rate swings with one frequency for seconds."""
    found: list[Finding] = []
    for k, axis in enumerate(AXES):
        rate = flight.signal(f"vehicle_angular_velocity/xyz[{k}]", f"ATTITUDE_QUATERNION/{axis}speed")
        wanted = flight.optional(f"vehicle_rates_setpoint/{axis}")
        windows = _windows(flight, rate)
        swinging = [each for each in windows if each[2] > OSCILLATION_RAD_S and each[4] > OSCILLATION_SHARE]
        joined: list[list[tuple[float, float, float, float, float]]] = []
        for each in swinging:
            if joined and each[0] - joined[-1][-1][1] <= WINDOW_S / 2:
                joined[-1].append(each)
            else:
                joined.append([each])
        long = [run for run in joined if run[-1][1] - run[0][0] >= OSCILLATION_S]
        if not long:
            continue
        run = max(long, key=lambda each: each[-1][1] - each[0][0])
        strongest = max(run, key=lambda each: each[2])
        found.append(
            Finding(
                "warning", run[0][0], run[-1][1],
                f"The vehicle oscillated in {axis}, with {strongest[3]:.1f} Hz and "
                f"{np.degrees(strongest[2]):.0f}°/s, for {run[-1][1] - run[0][0]:.0f} s.",
                f"A swing of one frequency stays below {np.degrees(OSCILLATION_RAD_S):.0f}°/s (limit of "
                "this station; PX4: no oscillation in “Tracking”).",
                f"Lower MC_{axis.upper()}RATE_P and _D, or MC_{axis.upper()}_P if it is slow; look for "
                "loose arms and propellers.",
                [[rate.field, *([wanted.field] if wanted is not None else [])]],
            )
        )  # fmt: skip
    return found


def _windows(flight: Flight, rate: Signal) -> list[tuple[float, float, float, float, float]]:
    """Of each window in the air: begin, end, amplitude [rad/s] and frequency [Hz] of the strongest frequency
    above LOWEST_HZ, and its share of the movement there."""
    if len(rate.times_s) < MIN_SAMPLES:
        return []
    period_s = float(np.median(np.diff(rate.times_s)))
    if not 0.0 < period_s <= 0.5 / (2 * LOWEST_HZ) or WINDOW_S / period_s < MIN_SAMPLES:
        raise NotJudged("The body rates are logged too seldom.")
    size = min(4096, round(WINDOW_S / period_s))
    taper = np.hanning(size)
    frequencies = np.fft.rfftfreq(size, period_s)
    first = int(np.searchsorted(frequencies, LOWEST_HZ))
    flown = flight.in_air(rate.times_s, 1.0)
    found: list[tuple[float, float, float, float, float]] = []
    for begin in range(0, len(rate.times_s) - size, size // 2)[:MAX_WINDOWS]:
        part = slice(begin, begin + size)
        begin_s, end_s = float(rate.times_s[begin]), float(rate.times_s[begin + size - 1])
        if not np.all(flown[part]) or not 0.5 < (end_s - begin_s) / WINDOW_S < 1.5:
            continue
        values = rate.values[part]
        power = np.abs(np.fft.rfft((values - np.mean(values)) * taper))[first:] ** 2
        if len(power) < 3 or not np.sum(power) > 0:
            continue
        peak = int(np.argmax(power))
        near = float(np.sum(power[max(0, peak - 2) : peak + 3]))
        amplitude = 2.0 * float(np.sqrt(near / np.sum(taper**2) / size))
        found.append(
            (begin_s, end_s, amplitude, float(frequencies[first + peak]), near / float(np.sum(power)))
        )
    return found


def _motors(flight: Flight) -> list[Signal]:
    """Signals of the motors, 0..1."""
    topic = flight.topic("actuator_motors")
    signals = [signal_of(topic, f"control[{k}]") for k in range(12) if f"control[{k}]" in topic.columns]
    used = [each for each in signals if len(each.values) > 10 and float(np.ptp(each.values)) > 0.0]
    if not used:
        raise NotJudged("The topic actuator_motors has no values.")
    return used


def saturation(flight: Flight) -> list[Finding]:
    """Saturated motors, and too little thrust to spare."""
    motors = _motors(flight)
    times_s = motors[0].times_s
    full = np.any([each.at(times_s) >= SATURATED for each in motors], axis=0) & flight.in_air(times_s, 1.0)
    end_s = float(times_s[-1])
    long = spans(times_s, full, end_s, SATURATED_S, join_s=0.3)
    in_air_s = max(1.0, total_s(flight.air))
    all_s = total_s(spans(times_s, full, end_s, join_s=0.0))
    fields = [[each.field for each in motors]]
    found: list[Finding] = []
    if long or all_s > SATURATED_SHARE * in_air_s:
        span = longest(long or spans(times_s, full, end_s))
        found.append(
            Finding(
                "warning", span.begin_s, span.end_s,
                f"A motor was at its limit for {all_s:.1f} s of {in_air_s:.0f} s in the air, for "
                f"{span.end_s - span.begin_s:.1f} s at a stretch.",
                f"Shorter than {SATURATED_S:.0f} s, and less than {100 * SATURATED_SHARE:.0f} % of the "
                "flight (limit of this station): a saturated motor cannot correct the attitude.",
                "Fly lighter, slower or with less wind; check motors, propellers and battery.",
                fields,
            )
        )  # fmt: skip
    mean = np.mean([each.at(times_s) for each in motors], axis=0)
    high = spans(times_s, (mean > HIGH_THRUST) & flight.in_air(times_s, 1.0), end_s, HIGH_THRUST_S)
    if high:
        span = longest(high)
        found.append(
            Finding(
                "caution", span.begin_s, span.end_s,
                f"The motors ran with {100 * highest(Signal('', times_s, mean), span):.0f} % on average: "
                "little thrust is left for control.",
                f"Below {100 * HIGH_THRUST:.0f} % for most of the flight (limit of this station; PX4 "
                "expects to hover at about half thrust).",
                "Fly lighter, or with stronger motors, larger propellers or a full battery.",
                fields,
            )
        )  # fmt: skip
    return found


def imbalance(flight: Flight) -> list[Finding]:
    """Motors that work differently over the whole flight: weight, a weak motor, a bent arm."""
    motors = _motors(flight)
    times_s = motors[0].times_s
    flown = flight.in_air(times_s, 2.0)
    if total_s(spans(times_s, flown, float(times_s[-1]))) < IMBALANCE_S or len(motors) < 3:
        return []
    means = np.array([np.median(each.at(times_s)[flown]) for each in motors])
    if not np.mean(means) > 0.05:
        return []
    difference = float(np.ptp(means) / np.mean(means))
    if difference <= IMBALANCE:
        return []
    strong, weak = int(np.argmax(means)), int(np.argmin(means))
    begin_s, end_s = flight.air[0].begin_s, flight.air[-1].end_s
    return [
        Finding(
            "warning" if difference > 2 * IMBALANCE else "caution", begin_s, end_s,
            f"The motors are not balanced: motor {strong + 1} ran with {100 * means[strong]:.0f} %, motor "
            f"{weak + 1} with {100 * means[weak]:.0f} %.",
            f"They differ by less than {100 * IMBALANCE:.0f} % of their mean in a calm flight (limit of "
            "this station).",
            "Check the centre of gravity, the propeller and bearing of the stronger running motor, and "
            "whether an arm is twisted.",
            [[each.field for each in motors]],
        )
    ]  # fmt: skip
