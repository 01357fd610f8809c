"""Findings of the estimator: rejected measurements and resets (PX4, "Using PX4's Navigation Filter
(EKF2)")."""

from __future__ import annotations

import numpy as np

from gcs_server.logbook.findings.model import (
    MAX_OF_A_KIND,
    Finding,
    Flight,
    Signal,
    above,
    highest,
    longest,
    signal_of,
    total_s,
)

REJECTED = 1.0
"""An innovation's test ratio from which EKF2 ignores a measurement."""
MIN_REJECTED_S = 1.0
ALIGNMENT_S = 15.0
"""In this time after a take-off PX4 aligns the heading in the air (EKF2, 1.5 m above the ground)."""
HEADING_RAD = float(np.radians(15.0))
JUMPS: tuple[tuple[str, str, tuple[str, ...], tuple[str, ...], float, str], ...] = (
    ("xy_reset_counter", "The estimated position was reset in the air", ("x", "y"), ("vx", "vy"), 1.0, "m"),
    ("z_reset_counter", "The estimated height was reset in the air", ("z",), ("vz",), 1.0, "m"),
    ("vxy_reset_counter", "The estimated speed was reset in the air", ("vx", "vy"), (), 1.0, "m/s"),
    ("vz_reset_counter", "The estimated climb rate was reset in the air", ("vz",), (), 1.0, "m/s"),
    (
        "heading_reset_counter",
        "The estimated heading was reset in the air",
        ("heading",),
        (),
        HEADING_RAD,
        "°",
    ),
)
"""Counter, what happened, the fields, their derivatives, and from which jump a reset is reported."""


def innovations(flight: Flight) -> list[Finding]:
    """Innovations: differences between measurement and estimate, as multiples of what is accepted."""
    topic = flight.topic("estimator_status", "ESTIMATOR_STATUS")
    columns = (
        ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio")
        if flight.is_tlog
        else ("vel_test_ratio", "pos_test_ratio", "hgt_test_ratio", "hdg_test_ratio")
    )
    found: list[Finding] = []
    for column, (statement, remedy) in zip(columns, _MISFITS, strict=True):
        if column not in topic.columns or not len((ratio := signal_of(topic, column)).values):
            continue
        rejected = above(flight, ratio, REJECTED, 0.0)
        if total_s(rejected) < MIN_REJECTED_S:
            continue
        span = longest(rejected)
        others = [f"{topic.id}/{each}" for each in columns if each in topic.columns and each != column]
        found.append(
            Finding(
                "warning", span.begin_s, span.end_s,
                f"{statement}: test ratio up to {highest(ratio, span):.1f}, "
                f"above {REJECTED:.0f} for {total_s(rejected):.1f} s.",
                f"Below {REJECTED:.0f}; above it the estimator ignores the measurement (PX4, “Using PX4's "
                "Navigation Filter (EKF2)”).",
                remedy,
                [[ratio.field], others],
            )
        )  # fmt: skip
    return found


_MISFITS = (
    (
        "Measured and estimated speed did not fit",
        "Compare GPS and vibration at that time: one of the two is wrong.",
    ),
    (
        "Measured and estimated position did not fit",
        "Look at the GPS at that time: accuracy, satellites, jumps.",
    ),
    (
        "Measured and estimated height did not fit",
        "Look at barometer and GPS height at that time; keep wind and the propellers' air away from the "
        "barometer.",
    ),
    (
        "Measured and estimated heading did not fit",
        "Look at the compass at that time; calibrate it away from metal, and far from power cables.",
    ),
)


def resets(flight: Flight) -> list[Finding]:
    """Resets: the estimate jumped in the air, by more than a small correction."""
    topic = flight.topic("vehicle_local_position")
    found: list[Finding] = []
    for counter, statement, fields, rates, limit, unit in JUMPS:
        if counter not in topic.columns or any(each not in topic.columns for each in (*fields, *rates)):
            continue
        counts = np.asarray(topic.columns[counter]).astype(np.int64)
        margin_s = ALIGNMENT_S if unit == "°" else 2.0
        for k in np.flatnonzero((np.diff(counts) != 0) & flight.in_air(topic.times_s[1:], margin_s))[:200]:
            signals = [signal_of(topic, each) for each in (*fields, *rates)]
            jump = _jump(signals, len(fields), float(topic.times_s[k]), float(topic.times_s[k + 1]), unit)
            if jump <= limit or len(found) >= MAX_OF_A_KIND:
                continue
            t_s = float(topic.times_s[k + 1])
            shown = np.degrees(jump) if unit == "°" else jump
            found.append(
                Finding(
                    "warning", t_s - 1.0, t_s + 1.0,
                    f"{statement}, by {shown:.1f} {unit}.",
                    "The estimate should not jump in the air; the vehicle follows the jump.",
                    "Look at the innovations before it: which sensor was wrong, or was lost and came back.",
                    [[each.field for each in signals[: len(fields)]], [f"{topic.id}/{counter}"]],
                )
            )  # fmt: skip
    return found


def _jump(signals: list[Signal], size: int, before_s: float, after_s: float, unit: str) -> float:
    """Size of a jump between two samples, without what the movement explains."""
    if any(not len(each.values) for each in signals):
        return 0.0
    times_s = np.array([before_s, after_s])
    total = 0.0
    for k, signal in enumerate(signals[:size]):
        before, after = signal.at(times_s)
        step = float(after - before)
        if len(signals) > size:
            step -= float(np.mean(signals[size + k].at(times_s))) * (after_s - before_s)
        if unit == "°":
            step = float(np.arctan2(np.sin(step), np.cos(step)))
        total += step * step
    return float(np.sqrt(total))
