"""Single random faults of random flights: accuracies are as true as PX4's, validity ends when PX4's would."""

import numpy as np
import pytest

from tests.support.random_faults import GONE_FOR_A_WHILE, KINDS, Course, fly
from vehicle_sim.estimator.estimator import DEAD_RECKONING_AFTER_S
from vehicle_sim.estimator.fusion import HORIZON_S, RESET_TIMEOUT_S
from vehicle_sim.estimator.gnss import GOOD_AGAIN_S

NO_AID_S = 5.0 + HORIZON_S
"""EKF2_NOAID_TOUT; the recorded position was invalid 5.12 s after the loss."""
LOOK_S = 0.05
"""Estimates are published, and looked at, so often."""
FIX_S, STEP_S = 0.124, 0.008
"""Between fixes, and between steps of the estimator."""


def in_time(moment_s: float, due_s: float, late_s: float = LOOK_S) -> bool:
    return due_s - LOOK_S <= moment_s <= due_s + late_s


def validity_ended_in_time(course: Course, seconds: float) -> bool:
    """Whether an estimate was valid for as long as it was aided, and five seconds more."""
    last_fix_s = max(at for at in course.fixes_s if at < 0.0)
    if KINDS[course.kind].aided:
        return not course.invalid_at_s
    if KINDS[course.kind].aided is False:
        return (
            in_time(course.dead_reckoning_at_s[0], last_fix_s + DEAD_RECKONING_AFTER_S + HORIZON_S)
            and in_time(course.invalid_at_s[0], last_fix_s + NO_AID_S)
            and not course.valid_at_s
        )
    if course.kind == GONE_FOR_A_WHILE:
        bad_s = max(at for at in course.fixes_s if at < course.back_s)
        # A fix that comes just when the wait is over may be the first one or not.
        again_s = min((at for at in course.fixes_s if at >= bad_s + GOOD_AGAIN_S - STEP_S), default=seconds)
        if again_s - last_fix_s < NO_AID_S:
            moments = (*course.invalid_at_s, *course.valid_at_s)
            return all(in_time(at, again_s, LOOK_S + FIX_S) for at in moments)
        # A position that drifted out of the gate is taken by a reset, once nothing was fused for 7 s.
        reset_s = max(again_s, last_fix_s + RESET_TIMEOUT_S) + 2.0 * FIX_S
        ended = in_time(course.invalid_at_s[0], last_fix_s + NO_AID_S)
        back = course.valid_at_s[0] if course.valid_at_s else seconds
        return ended and again_s - LOOK_S <= back <= reset_s + LOOK_S
    return all(
        any(in_time(at, reckoning_s + NO_AID_S - DEAD_RECKONING_AFTER_S - HORIZON_S)
            for reckoning_s in course.dead_reckoning_at_s)
        for at in course.invalid_at_s
    )  # fmt: skip


@pytest.mark.flight
@pytest.mark.parametrize(
    ("count", "seed", "seconds"),
    [(36, 1, 7.5), pytest.param(240, 3, 20.0, marks=pytest.mark.broad)],
)
def test_an_estimate_under_a_random_fault_is_as_wrong_and_as_sure_of_itself_as_recorded(count, seed, seconds):
    courses = fly(count, seed, seconds)
    assert [course for course in courses if not validity_ended_in_time(course, seconds)] == []
    for name, kind in KINDS.items():
        of_kind = [course for course in courses if course.kind == name]
        for recorded, ratios in (
            (kind.horizontal, [course.horizontal_ratio for course in of_kind]),
            (kind.vertical, [course.vertical_ratio for course in of_kind]),
        ):
            assert np.quantile(ratios, 0.9) <= 1.5 * recorded[1], (name, ratios)
            if seconds >= 20.0:
                assert np.median(ratios) >= recorded[0] / 1.5, (name, ratios)
