"""Failing background work is restarted with back-off and limited logging."""

import asyncio
import gc
import logging
import math

import pytest

from gcs_server.clock import SystemClock, until_next_s
from gcs_server.supervise import Supervisor


class SleepRecorder(SystemClock):
    """A clock that advances only while something sleeps."""

    def __init__(self, now_s=0.0):
        self.now_s = now_s
        self.sleeps_s = []

    def monotonic_s(self):
        return self.now_s

    async def sleep(self, seconds):
        self.sleeps_s.append(seconds)
        self.now_s += seconds
        await asyncio.sleep(0)


def test_failing_work_is_started_again_with_back_off_and_few_log_lines(caplog):
    async def scenario():
        clock = SleepRecorder()
        supervisor = Supervisor(clock)
        runs = []

        async def work():
            runs.append(1)
            if len(runs) < 12:
                raise ValueError("broken")

        with caplog.at_level(logging.INFO):
            await supervisor.start("worker", work)
        assert len(runs) == 12
        assert clock.sleeps_s[:5] == [0.2, 0.4, 0.8, 1.6, 3.2]
        assert max(clock.sleeps_s) == 5.0
        assert len(caplog.records) == 6  # five failures, and that no more are logged
        assert supervisor.names() == []

    asyncio.run(scenario())


def test_an_update_is_repeated_at_its_period_also_after_a_failure():
    async def scenario():
        clock = SleepRecorder()
        supervisor, calls, done = Supervisor(clock), [], asyncio.Event()

        def update():
            calls.append(1)
            if len(calls) == 2:
                raise ValueError("broken")
            if len(calls) == 4:
                done.set()

        supervisor.repeat("update", update, 0.7)
        await done.wait()
        await supervisor.close()
        assert clock.sleeps_s[:3] == pytest.approx([0.7, 0.2, 0.5])  # 0.2 s after the failure

    asyncio.run(scenario())


@pytest.mark.parametrize("begin_s", [0.0, 0.03, 1234.567, 1234.5])
def test_all_that_repeats_wakes_together_whenever_it_has_begun(begin_s):
    clock, wakes_s = SleepRecorder(begin_s), []
    for _ in range(20):
        remaining_s = until_next_s(clock, 0.1)
        assert 0.0 < remaining_s < 0.1 + 1e-6
        clock.now_s += remaining_s - 1e-9  # the loop's timers may be early by their resolution
        wakes_s.append(clock.now_s)
    first_s = math.floor(begin_s / 0.1 + 0.01) * 0.1
    assert wakes_s == pytest.approx([first_s + 0.1 * number for number in range(1, 21)], abs=1e-6)


def test_close_cancels_repeated_work_and_the_failure_of_single_work_is_logged(caplog):
    async def scenario():
        supervisor = Supervisor(SystemClock())

        async def forever():
            await asyncio.sleep(3600)

        async def fail_once():
            raise RuntimeError("once")

        task = supervisor.start("forever", forever)
        await supervisor.spawn("single", fail_once())
        assert supervisor.names() == ["forever"]
        await supervisor.close()
        assert task.cancelled()

    asyncio.run(scenario())
    assert "single failed" in caplog.text


def test_work_cancelled_before_its_first_step_causes_no_warning(recwarn):
    async def scenario():
        supervisor = Supervisor(SystemClock())

        async def work():
            raise AssertionError("must not run: the task was cancelled before its first step")

        supervisor.spawn("single", work())
        await supervisor.close()

    asyncio.run(scenario())
    gc.collect()
    assert not [str(each.message) for each in recwarn if each.category is RuntimeWarning]
