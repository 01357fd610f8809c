"""The gains of PX4's autotune in a log: those at the end of each step of a completed run, in the form in
which PX4 would write them; and of another run, why there are none."""

import math

import pytest

from gcs_server.logbook.loops import loops
from gcs_server.logbook.ulog import read_ulog
from tests.unit.gcs_server.logbook.autotuned_ulog import COMPLETE, FROM_1_18, GAINS, autotuned_ulog

FAILED_ON_PITCH = ((1, 3), (2, 60), (3, 21), (4, 30), (12, 20), (0, 1))


@pytest.fixture
def found(tmp_path):
    def find(*runs, **options):
        path = tmp_path / "flight.ulg"
        path.write_bytes(autotuned_ulog(*runs, **options))
        return loops(read_ulog(path), None, None).autotune

    return find


@pytest.mark.parametrize("numbers", [None, FROM_1_18])
def test_the_gains_at_the_end_of_each_step_are_parameters_in_the_parallel_form(found, numbers):
    result = found(COMPLETE, numbers=numbers)
    roll, pitch, yaw = (each.parameters for each in result.axes)
    assert list(roll.items()) == [
        ("MC_ROLLRATE_K", 1.0), ("MC_ROLLRATE_P", 0.12), ("MC_ROLLRATE_I", pytest.approx(0.18)),
        ("MC_ROLLRATE_D", pytest.approx(0.0024)), ("MC_ROLL_P", 5.5),
    ]  # fmt: skip
    assert pitch["MC_PITCHRATE_D"] == 0.0
    assert yaw["MC_YAWRATE_I"] == pytest.approx(0.125)
    assert yaw["MC_YAW_P"] == 2.8
    assert (result.runs, result.note) == (1, None)
    assert result.begin_s == pytest.approx(5.3)


def test_gains_that_wait_for_disarming_are_gains_too_even_if_px4_then_reports_a_failure(found):
    waits = (*COMPLETE[:-2], (13, 50), (12, 20), (0, 1))
    assert len(found(waits).axes) == 3


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (FAILED_ON_PITCH, "ended on the pitch axis without gains"),
        (COMPLETE[:2], "The log ends while autotune moves the roll axis"),
        ((*COMPLETE[:8], (12, 20)), "out of range or did not pass its test"),
        ((*COMPLETE[:9], (10, 20), (12, 20)), "out of range or did not pass its test"),
        ((*COMPLETE[:5], *COMPLETE[6:]), "gap where autotune moved the yaw axis"),
    ],
)
def test_a_run_that_was_not_completed_has_no_gains_and_says_why(found, run, words):
    result = found(run)
    assert result.axes == []
    assert words in result.note


def test_of_several_runs_the_last_one_counts(found):
    result = found(COMPLETE, FAILED_ON_PITCH)
    assert (result.runs, result.axes) == (2, [])
    assert len(found(FAILED_ON_PITCH, COMPLETE).axes) == 3


@pytest.mark.parametrize("kc", [math.nan, math.inf, -0.1, 0.0])
def test_gains_that_no_vehicle_can_fly_are_not_proposed(found, kc):
    result = found(COMPLETE, gains={**GAINS, 4: (kc, 1.0, 0.0, 5.0)})
    assert result.axes == []
    assert "pitch axis that no vehicle can fly" in result.note


def test_an_aeroplane_has_other_gains_and_a_flight_without_autotune_none(found):
    assert "aeroplane" in found(COMPLETE, vehicle_type=2).note
    assert found(((0, 5),)) is None
