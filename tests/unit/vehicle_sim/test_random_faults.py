"""In flights with one random fault each, errors, reported accuracies and validity are as in PX4."""

import math

import numpy as np
import pytest

from tests.support.random_faults import FAULT_KINDS, TEMPORARY_GPS_LOSS, FaultFlight, fly_with_random_faults
from vehicle_sim.estimator.estimator import DEAD_RECKONING_AFTER_S
from vehicle_sim.estimator.fusion import HORIZON_S, RESET_TIMEOUT_S
from vehicle_sim.estimator.gnss import RECHECK_S

NO_AID_S = 5.0 + HORIZON_S
"""EKF2_NOAID_TOUT; the recorded position was invalid 5.12 s after the loss."""
CHECK_S = 0.05
"""Interval at which estimates are published and checked."""
FIX_S, STEP_S = 0.124, 0.008
"""Intervals of GPS fixes and of the estimator's steps."""
RECKONING_AFTER_S = DEAD_RECKONING_AFTER_S + HORIZON_S


def in_time(moment_s: float, due_s: float, tolerance_s: float = CHECK_S) -> bool:
    return due_s - STEP_S <= moment_s <= due_s + tolerance_s


def once_in_time(moments_s: list[float], due_s: float) -> bool:
    return len(moments_s) == 1 and in_time(moments_s[0], due_s)


def validity_follows_dead_reckoning(flight: FaultFlight, seconds: float) -> bool:
    """Whether validity ended in time in each long period of dead reckoning, and in no other period."""
    invalid_s, valid_s = list(flight.invalid_at_s), list(flight.valid_at_s)
    for k, start_s in enumerate(flight.dead_reckoning_at_s):
        end_s = flight.aided_again_at_s[k] if k < len(flight.aided_again_at_s) else math.inf
        due_s = start_s + NO_AID_S - RECKONING_AFTER_S
        validity_ends_s = [ended_s for ended_s in invalid_s if start_s <= ended_s <= end_s]
        if validity_ends_s:
            # Both times are accurate to one interval of checks.
            if len(validity_ends_s) > 1 or abs(invalid_s.pop(0) - due_s) > CHECK_S:
                return False
            if end_s < math.inf and not (valid_s and end_s - CHECK_S <= valid_s.pop(0) <= end_s):
                return False
        elif min(end_s, seconds) > due_s + CHECK_S:
            return False
    return not invalid_s and not valid_s


def validity_ended_in_time(flight: FaultFlight, seconds: float) -> bool:
    """Whether an estimate was valid while it was aided and for five seconds afterwards."""
    last_fix_s = max(fix_s for fix_s in flight.fixes_s if fix_s < 0.0)
    due_s = last_fix_s + NO_AID_S
    if FAULT_KINDS[flight.kind].aided:
        return not flight.invalid_at_s
    if not validity_follows_dead_reckoning(flight, seconds):
        return False
    if FAULT_KINDS[flight.kind].aided is False:
        dead_reckoning_in_time = once_in_time(flight.dead_reckoning_at_s, last_fix_s + RECKONING_AFTER_S)
        return dead_reckoning_in_time and once_in_time(flight.invalid_at_s, due_s) and not flight.valid_at_s
    if flight.kind != TEMPORARY_GPS_LOSS:
        return True
    last_bad_fix_s = max(fix_s for fix_s in flight.fixes_s if fix_s < flight.gps_returns_s)
    # A fix exactly at the end of the waiting time may or may not be the first fix that is used.
    first_used_fix_s = min(
        (fix_s for fix_s in flight.fixes_s if fix_s >= last_bad_fix_s + RECHECK_S - STEP_S), default=seconds
    )
    if first_used_fix_s + FIX_S + CHECK_S < due_s:
        return not flight.invalid_at_s
    if first_used_fix_s < due_s and not flight.invalid_at_s:
        return True
    # After 7 s without fusion the estimate is reset to a position outside the gate.
    reset_s = max(first_used_fix_s, last_fix_s + RESET_TIMEOUT_S) + 2.0 * FIX_S
    valid_s = flight.valid_at_s[0] if flight.valid_at_s else seconds
    return (
        once_in_time(flight.invalid_at_s, due_s)
        and first_used_fix_s - CHECK_S <= valid_s <= reset_s + CHECK_S
    )


LOST_GPS = {"dead_reckoning_at_s": [1.06], "invalid_at_s": [5.06]}
LONG_LOST_GPS = {"gps_returns_s": 9.9, **LOST_GPS, "aided_again_at_s": [11.06], "valid_at_s": [11.06]}


@pytest.mark.parametrize(
    ("kind", "moments", "expected"),
    [
        ("silent GPS", LOST_GPS, True),
        ("silent GPS", {**LOST_GPS, "invalid_at_s": []}, False),
        ("silent GPS", {**LOST_GPS, "invalid_at_s": [4.98]}, False),
        ("silent GPS", {**LOST_GPS, "invalid_at_s": [5.14]}, False),
        ("silent GPS", {**LOST_GPS, "valid_at_s": [9.0]}, False),
        ("silent GPS", {"dead_reckoning_at_s": [0.9], "invalid_at_s": [5.06]}, False),
        ("silent barometer", {}, True),
        ("silent barometer", LOST_GPS, False),
        ("stuck GPS", {}, True),
        ("stuck GPS", {"dead_reckoning_at_s": [8.0], "aided_again_at_s": [11.5]}, True),
        ("stuck GPS", {"dead_reckoning_at_s": [8.0], "invalid_at_s": [12.0]}, True),
        ("stuck GPS", {"dead_reckoning_at_s": [8.0]}, False),
        ("stuck GPS", {"dead_reckoning_at_s": [8.0], "aided_again_at_s": [13.0]}, False),
        ("stuck GPS", {"dead_reckoning_at_s": [8.0], "invalid_at_s": [11.8]}, False),
        ("stuck GPS", {"invalid_at_s": [12.0]}, False),
        (TEMPORARY_GPS_LOSS, LONG_LOST_GPS, True),
        (TEMPORARY_GPS_LOSS, {**LONG_LOST_GPS, "gps_returns_s": 1.0}, False),
        (TEMPORARY_GPS_LOSS, {**LONG_LOST_GPS, "valid_at_s": []}, False),
        (TEMPORARY_GPS_LOSS, {**LONG_LOST_GPS, "valid_at_s": [13.0], "aided_again_at_s": [13.0]}, False),
    ],
)
def test_the_end_of_validity_is_checked_to_within_50_ms(kind, moments, expected):
    fixes_s = [round(-0.06 + 0.124 * k, 3) for k in range(-10, 150)]
    flight = FaultFlight(kind, fixes_s, **{"gps_returns_s": 20.0, **moments})
    assert validity_ended_in_time(flight, 20.0) is expected


@pytest.mark.flight
@pytest.mark.parametrize(
    ("count", "seed", "seconds"),
    [(36, 1, 7.5), pytest.param(240, 3, 20.0, marks=pytest.mark.broad)],
)
def test_the_ratios_of_error_to_accuracy_after_random_faults_match_the_recordings(count, seed, seconds):
    flights = fly_with_random_faults(count, seed, seconds)
    assert [flight for flight in flights if not validity_ended_in_time(flight, seconds)] == []
    for name, kind in FAULT_KINDS.items():
        flights_of_kind = [flight for flight in flights if flight.kind == name]
        for recorded, ratios in (
            (kind.horizontal_ratios, [flight.horizontal_ratio for flight in flights_of_kind]),
            (kind.vertical_ratios, [flight.vertical_ratio for flight in flights_of_kind]),
        ):
            assert np.quantile(ratios, 0.9) <= kind.tolerance * recorded[1], (name, ratios)
            if seconds >= 20.0:
                assert np.median(ratios) >= recorded[0] / kind.tolerance, (name, ratios)
