"""Gains are proved in simulation: sane ones pass in all conditions, others fail with what went wrong."""

import json
from collections import Counter

import pytest

from gcs_server.flights import proof_worker
from missions.what_if.flight import NotFlyable
from missions.what_if.proof import draw, prove
from missions.what_if.proof_document import ProofSpread

RUNS = 40


@pytest.fixture(scope="module")
def sane():
    return prove({}, {"MC_ROLLRATE_P": 0.18, "MC_PITCHRATE_P": 0.18, "MC_ROLLRATE_I": 0.25}, runs=RUNS)


def failures(proof):
    return Counter(each for pair in proof.pairs for each in pair.proposed.failures)


def test_sane_gains_pass_in_all_conditions_as_the_present_ones_do(sane):
    assert sane.passed
    assert (sane.stable, sane.stable_at_present, sane.runs) == (RUNS, RUNS, RUNS)
    assert sane.present["MC_ROLLRATE_P"] == pytest.approx(0.15)
    assert failures(sane) == {}
    worst = sane.pairs[sane.worst - 1]
    assert worst.number == sane.worst
    assert worst.proposed.tilt_error_deg < worst.present.tilt_error_deg, "quicker gains tilt sooner"


@pytest.mark.parametrize(
    ("proposed", "expected"),
    [
        ({"MC_ROLLRATE_P": 1.5}, {"oscillates", "saturated"}),
        ({"MC_ROLLRATE_P": -0.15}, {"crashed"}),
        ({"MC_ROLLRATE_P": 0.03}, {"tracking"}),
        ({"MC_ROLL_P": 20.0}, {"oscillates"}),
        ({"MC_YAWRATE_P": 2.0}, {"saturated"}),
        ({"MPC_XY_VEL_P_ACC": 12.0}, {"tracking", "oscillates"}),
    ],
)
def test_gains_that_are_not_stable_fail_and_say_how(proposed, expected):
    found = prove({}, proposed, runs=RUNS)
    assert not found.passed
    assert found.stable < RUNS
    assert found.stable_at_present == RUNS
    assert expected <= set(failures(found))
    assert found.pairs[found.worst - 1].proposed.failures


def test_equal_seeds_give_equal_proofs_and_conditions_vary_within_bounds(sane):
    again = prove({}, sane.parameters, runs=5)
    assert again.pairs == sane.pairs[:5], "a run does not depend on the number of runs"
    assert prove({}, sane.parameters, runs=5, seed=1).pairs != again.pairs
    drawn = [draw(ProofSpread(), 0, number) for number in range(1, 200)]
    assert max(max(map(abs, each.wind_ne_m_s)) for each in drawn) <= 2.5 * 2.5
    assert min(each.mass for each in drawn) < 0.92
    assert max(each.thrust for each in drawn) > 1.1


def test_the_present_values_are_the_vehicles(sane):
    own = prove({"MC_ROLLRATE_P": 0.03}, {"MC_ROLLRATE_P": 0.15}, runs=10)
    assert own.passed
    assert own.stable_at_present < 10
    assert own.present["MC_ROLLRATE_P"] == pytest.approx(0.03)


@pytest.mark.parametrize("name", ["COM_DISARM_LAND", "SIH_MASS", "MPC_ACC_HOR", "NO_SUCH"])
def test_what_the_controllers_do_not_use_cannot_be_proved(name):
    with pytest.raises(NotFlyable, match=f"{name} is no gain or limit"):
        prove({}, {name: 1.0}, runs=1)


def test_progress_is_reported_and_its_exception_ends_the_proof():
    said = []

    def report(text, part):
        said.append((text, part))
        if len(said) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        prove({}, {"MC_ROLL_P": 6.0}, runs=2, report=report)
    assert said[1] == ("1 of 25 s of 4 flights are simulated.", pytest.approx(0.04))


def test_the_worker_answers_with_json_that_has_no_infinity():
    request = {
        "id": "7", "vehicle": "1", "parameters": {}, "proposed": {"MC_ROLLRATE_P": -5.0}, "runs": 3,
        "seed": 0, "assumed": ["The body is known."],
    }  # fmt: skip
    summary, body = proof_worker.prove(request, lambda _text, _part: None)
    answer = json.loads(body, parse_constant=pytest.fail)
    assert summary == {"passed": False, "stable": 0, "runs": 3}
    assert (answer["id"], answer["vehicle"], answer["assumed"]) == ("7", "1", ["The body is known."])
    assert answer["pairs"][0]["proposed"]["failures"] == ["crashed"]
