"""When a vehicle may be asked for the progress of its autotune: never so late that the request could arrive
after the vehicle has forgotten the end, and therefore start it again."""

import math
import random

import pytest

from gcs_server.vehicle.services.autotune_polls import MARGIN_S, PERIOD_S, RESULT_KEPT_S, AutotunePolls

START_S = 100.0


def test_the_start_is_repeated_only_while_it_cannot_be_a_second_one():
    polls, sent = AutotunePolls(START_S), []
    while polls.next_s < math.inf:
        sent.append(polls.next_s)
        polls.sent(polls.next_s)
    assert sent[0] == START_S
    assert len(sent) > 8
    assert START_S + 1.3 < sent[-1] <= START_S + RESULT_KEPT_S - MARGIN_S
    assert polls.silent_s > sent[-1]


def test_an_answer_allows_requests_for_a_time_that_begins_with_the_oldest_one_that_it_may_belong_to():
    polls = AutotunePolls(START_S)
    for now_s in (START_S, START_S + 0.2, START_S + 0.3):
        polls.sent(now_s)
    polls.answered(START_S + 0.35)
    assert polls.until_s == START_S + RESULT_KEPT_S - MARGIN_S
    assert polls.next_s == START_S + 0.3 + PERIOD_S
    polls.answered(START_S + 0.4)  # to the second copy
    assert polls.next_s == START_S + 0.3 + PERIOD_S
    polls.sent(START_S + 0.8)
    polls.answered(START_S + 0.85)
    assert polls.until_s == START_S + 0.8 + RESULT_KEPT_S - MARGIN_S


@pytest.mark.parametrize("one_way_s", [0.0, 0.05, 0.25])
@pytest.mark.parametrize("loss", [0.0, 0.2, 0.4, 0.7])
def test_no_request_ever_reaches_a_vehicle_that_has_forgotten_the_end(loss, one_way_s):
    """A vehicle that ends at a random time, at random losses: 300 runs."""
    rng, asked, known = random.Random(f"{loss} {one_way_s}"), 0, 0
    for _ in range(300):
        end_s = START_S + one_way_s + rng.uniform(0.0, 30.0)
        polls, answers = AutotunePolls(START_S), []
        while True:
            now_s = min(polls.next_s, *answers, math.inf)
            if now_s == math.inf:
                break
            if answers and answers[0] == now_s:
                if answers.pop(0) - one_way_s >= end_s:  # the vehicle tells its end
                    known += 1
                    break
                polls.answered(now_s)
                continue
            polls.sent(now_s)
            asked += 1
            if rng.random() >= loss:
                assert now_s + one_way_s < end_s + RESULT_KEPT_S
                if rng.random() >= loss:
                    answers.append(now_s + 2 * one_way_s)
    assert asked > 300
    assert known == 300 or loss > 0.0
    assert known >= 285 or loss > 0.2 or one_way_s > 0.1
