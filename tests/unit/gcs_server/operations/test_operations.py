"""Long work: started, followed, joined, cancelled, bounded, and what ends it. On a clock that jumps."""

import asyncio
from types import SimpleNamespace

import pytest

from gcs_server.clock import LoopClock
from gcs_server.errors import Disconnected, NoReply, Refused, UnknownOperation
from gcs_server.operations.operations import (
    LINK_GRACE_S,
    MAX_ENDED,
    MAX_RESULT,
    MAX_RUNNING,
    MAX_TEXT_LENGTH,
    PROGRESS_PERIOD_S,
    Operations,
)
from gcs_server.supervise import Supervisor
from tests.jump_time import in_jumps


def story(work):
    """Runs `work(at)` with operations on a clock of their own."""

    async def run():
        clock = LoopClock(asyncio.get_running_loop())
        supervisor, told = Supervisor(clock), []
        operations = Operations(clock, supervisor, told.append)
        await work(SimpleNamespace(operations=operations, clock=clock, told=told, supervisor=supervisor))
        await operations.close()
        await supervisor.close()

    in_jumps(run)


async def for_ever(report):
    report("Reading", 0.25)
    await asyncio.sleep(1e6)


def begin(at, work=for_ever, kind="parameters/read", **more):
    return at.operations.start(kind, work, text="Beginning", **more)


def test_an_operation_reports_progress_and_ends_with_its_result():
    async def tell(at):
        async def work(report):
            for step in range(4):
                report(f"Step {step}", step / 4)
                await asyncio.sleep(1.0)
            return {"count": 929}

        begun = begin(at, work, vehicle="1", by=("anna", "key"))
        assert (begun.state, begun.progress, begun.text, begun.client) == (
            "running",
            None,
            "Beginning",
            "anna",
        )
        await asyncio.sleep(2.5)
        assert (at.operations.get(begun.id).text, at.operations.get(begun.id).progress) == ("Step 2", 0.5)
        ended = await at.operations.wait(begun.id)
        assert (ended.state, ended.progress, ended.result) == ("succeeded", 1.0, {"count": 929})
        assert ended.ended_unix_s - ended.started_unix_s == pytest.approx(4.0)
        assert [(o.state, o.text) for o in at.told] == [
            ("running", "Beginning"),
            *(("running", f"Step {step}") for step in (1, 2, 3)),
            ("succeeded", "Done."),
        ]

    story(tell)


def test_progress_events_are_limited_to_a_few_per_second():
    async def tell(at):
        async def work(report):
            for step in range(1000):
                report("Reading " + "x" * 1000, step / 1000 * 5 - 1)
                await asyncio.sleep(0.001)

        begin(at, work)
        await asyncio.sleep(2.0)
        assert len(at.told) <= 2 + 1.0 / PROGRESS_PERIOD_S
        assert all(o.progress is None or 0 <= o.progress <= 1 for o in at.told)
        assert all(len(o.text) <= MAX_TEXT_LENGTH for o in at.told)

    story(tell)


def test_equal_requests_share_one_operation_that_outlives_its_caller():
    async def tell(at):
        first = begin(at, vehicle="1")
        assert begin(at, vehicle="1").id == first.id
        assert begin(at, vehicle="2").id != first.id
        waiting = asyncio.ensure_future(at.operations.wait(first.id))
        await asyncio.sleep(1)
        waiting.cancel()
        await asyncio.sleep(1)
        assert at.operations.get(first.id).state == "running"

    story(tell)


def test_cancel_waits_for_the_cleanup_and_can_be_repeated():
    async def tell(at):
        steps = []

        async def work(report):
            try:
                await asyncio.sleep(1e6)
            finally:
                steps.append("cleaning")
                await asyncio.sleep(1.5)
                steps.append("clean")

        begun = begin(at, work)
        await asyncio.sleep(1)
        ended = await at.operations.cancel(begun.id)
        assert (ended.state, ended.error, steps) == ("cancelled", None, ["cleaning", "clean"])
        assert await at.operations.cancel(begun.id) == ended

    story(tell)


def test_an_operation_cancelled_before_its_first_step_has_ended():
    async def tell(at):
        begun = begin(at)
        assert (await at.operations.cancel(begun.id)).state == "cancelled"

    story(tell)


@pytest.mark.parametrize(
    ("error", "code"), [(NoReply("No answer.", deadline_s=5), "no_reply"), (KeyError("x"), "error")]
)
def test_a_raised_exception_is_the_operations_error(error, code):
    async def tell(at):
        async def work(report):
            raise error

        begun = begin(at, work)
        with pytest.raises(type(error) if isinstance(error, NoReply) else Exception):
            await at.operations.wait(begun.id)
        ended = at.operations.get(begun.id)
        assert (ended.state, ended.error.code, ended.result) == ("failed", code, None)

    story(tell)


def test_a_too_large_result_is_a_failure():
    async def tell(at):
        async def work(report):
            return {"all": "x" * MAX_RESULT}

        begun = begin(at, work)
        await asyncio.sleep(0.1)
        assert (at.operations.get(begun.id).state, at.operations.get(begun.id).result) == ("failed", None)

    story(tell)


def test_a_lost_vehicle_ends_only_operations_that_need_it():
    async def tell(at):
        upload = begin(at, kind="upload", vehicle="1", needs_vehicle=True)
        dry_run = begin(at, kind="dry_run", vehicle="1")
        other = begin(at, kind="upload", vehicle="2", needs_vehicle=True)
        await asyncio.sleep(1)
        at.operations.vehicle_lost("1", "silent for 5 s")
        await asyncio.sleep(LINK_GRACE_S + 0.01)
        lost = at.operations.get(upload.id)
        assert (lost.state, lost.text) == ("failed", "Vehicle 1 was lost: silent for 5 s")
        assert isinstance(lost.error, Disconnected)
        assert [at.operations.get(o.id).state for o in (dry_run, other)] == ["running", "running"]

    story(tell)


def test_work_that_detects_the_loss_fails_with_its_own_error():
    async def tell(at):
        async def work(report):
            await asyncio.sleep(1.5)
            raise NoReply("It sent 12 of 929 parameters.", deadline_s=1)

        begun = begin(at, work, vehicle="1", needs_vehicle=True)
        await asyncio.sleep(1)
        at.operations.vehicle_lost("1", "its link was closed")
        await asyncio.sleep(5)
        assert at.operations.get(begun.id).text == "It sent 12 of 929 parameters."

    story(tell)


def test_a_server_stop_cancels_all_operations_and_starts_none():
    async def tell(at):
        begun = [begin(at, vehicle=str(n)) for n in range(3)]
        await asyncio.sleep(1)
        await at.operations.close()
        assert {at.operations.get(o.id).state for o in begun} == {"cancelled"}
        assert at.operations.get(begun[0].id).text == "The server stopped."
        with pytest.raises(Refused, match="shutting down"):
            begin(at)

    story(tell)


def test_running_operations_are_limited_and_the_oldest_ended_are_dropped():
    async def tell(at):
        async def short(report):
            await asyncio.sleep(0.01)

        running = [begin(at, kind="dry_run", vehicle=str(n)) for n in range(MAX_RUNNING)]
        with pytest.raises(Refused, match="which is the limit"):
            begin(at, short)
        await at.operations.cancel(running[0].id)
        ended = []
        for _ in range(MAX_ENDED + 10):
            ended.append(begin(at, short).id)
            await asyncio.sleep(0.02)
        assert len(at.operations.all()) == MAX_RUNNING - 1 + MAX_ENDED
        with pytest.raises(UnknownOperation):
            at.operations.get(running[0].id)
        with pytest.raises(UnknownOperation):
            at.operations.get(ended[9])
        assert at.operations.get(ended[10]).state == "succeeded"
        assert at.operations.get(running[1].id).state == "running"

    story(tell)
