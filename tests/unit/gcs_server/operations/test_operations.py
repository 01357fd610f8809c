"""Operations: progress, sharing, cancellation, limits and failures, on simulated time."""

import asyncio
from types import SimpleNamespace

import pytest

from gcs_server.clock import LoopClock
from gcs_server.errors import ClientHasTooMany, Disconnected, NoReply, Refused, UnknownOperation
from gcs_server.operations.operations import (
    LINK_GRACE_S,
    MAX_ENDED,
    MAX_RESULT_LENGTH,
    MAX_RUNNING,
    MAX_RUNNING_PER_CLIENT,
    MAX_TEXT_LENGTH,
    PROGRESS_PERIOD_S,
    Operations,
)
from gcs_server.scenarios.simulated_time import run_on_simulated_time
from gcs_server.supervise import Supervisor


def run_test(work):
    """Runs a test with operations on simulated time."""

    async def run():
        clock = LoopClock(asyncio.get_running_loop())
        supervisor, published = Supervisor(clock), []
        operations = Operations(clock, supervisor, published.append)
        await work(
            SimpleNamespace(operations=operations, clock=clock, published=published, supervisor=supervisor)
        )
        await operations.close()
        await supervisor.close()

    run_on_simulated_time(run)


async def work_forever(report):
    report("Reading", 0.25)
    await asyncio.sleep(1e6)


def start(context, work=work_forever, kind="parameters/read", **options):
    return context.operations.start(kind, work, text="Beginning", **options)


def test_an_operation_reports_progress_and_ends_with_its_result():
    async def test(context):
        async def work(report):
            for step in range(4):
                report(f"Step {step}", step / 4)
                await asyncio.sleep(1.0)
            return {"count": 929}

        operation = start(context, work, vehicle="1", by=("anna", "key"))
        assert (operation.state, operation.progress, operation.text, operation.client) == (
            "running",
            None,
            "Beginning",
            "anna",
        )
        await asyncio.sleep(2.5)
        assert (context.operations.get(operation.id).text, context.operations.get(operation.id).progress) == (
            "Step 2",
            0.5,
        )
        operation = await context.operations.wait(operation.id)
        assert (operation.state, operation.progress, operation.result) == ("succeeded", 1.0, {"count": 929})
        assert operation.ended_unix_s - operation.started_unix_s == pytest.approx(4.0)
        assert [(o.state, o.text) for o in context.published] == [
            ("running", "Beginning"),
            *(("running", f"Step {step}") for step in (1, 2, 3)),
            ("succeeded", "Done."),
        ]

    run_test(test)


def test_progress_events_are_limited_to_a_few_per_second():
    async def test(context):
        async def work(report):
            for step in range(1000):
                report("Reading " + "x" * 1000, step / 1000 * 5 - 1)  # from -1 to 4
                await asyncio.sleep(0.001)

        start(context, work)
        await asyncio.sleep(2.0)
        # The start, the end, and the progress during one second.
        assert len(context.published) <= 2 + 1.0 / PROGRESS_PERIOD_S
        assert all(o.progress is None or 0 <= o.progress <= 1 for o in context.published)
        assert all(len(o.text) <= MAX_TEXT_LENGTH for o in context.published)

    run_test(test)


def test_equal_requests_share_one_operation_that_outlives_its_caller():
    async def test(context):
        first = start(context, vehicle="1")
        assert start(context, vehicle="1").id == first.id
        assert start(context, vehicle="2").id != first.id
        waiting = asyncio.ensure_future(context.operations.wait(first.id))
        await asyncio.sleep(1)
        waiting.cancel()
        await asyncio.sleep(1)
        assert context.operations.get(first.id).state == "running"

    run_test(test)


def test_cancel_waits_for_the_cleanup_and_can_be_repeated():
    async def test(context):
        cleanup_steps = []

        async def work(report):
            try:
                await asyncio.sleep(1e6)
            finally:
                cleanup_steps.append("cleaning")
                await asyncio.sleep(1.5)
                cleanup_steps.append("clean")

        operation = start(context, work)
        await asyncio.sleep(1)
        operation = await context.operations.cancel(operation.id)
        assert (operation.state, operation.error, cleanup_steps) == ("cancelled", None, ["cleaning", "clean"])
        assert await context.operations.cancel(operation.id) == operation

    run_test(test)


def test_an_operation_can_be_cancelled_before_its_first_step():
    async def test(context):
        operation = start(context)
        assert (await context.operations.cancel(operation.id)).state == "cancelled"

    run_test(test)


@pytest.mark.parametrize(
    ("error", "code"), [(NoReply("No answer.", deadline_s=5), "no_reply"), (KeyError("x"), "error")]
)
def test_a_raised_exception_becomes_the_operations_error(error, code):
    async def test(context):
        async def work(report):
            raise error

        operation = start(context, work)
        with pytest.raises(type(error) if isinstance(error, NoReply) else Exception):
            await context.operations.wait(operation.id)
        operation = context.operations.get(operation.id)
        assert (operation.state, operation.error.code, operation.result) == ("failed", code, None)

    run_test(test)


def test_a_too_large_result_fails_the_operation():
    async def test(context):
        async def work(report):
            return {"all": "x" * MAX_RESULT_LENGTH}

        operation = start(context, work)
        await asyncio.sleep(0.1)
        assert (context.operations.get(operation.id).state, context.operations.get(operation.id).result) == (
            "failed",
            None,
        )

    run_test(test)


def test_when_a_vehicle_is_lost_only_the_operations_that_need_it_fail():
    async def test(context):
        upload = start(context, kind="upload", vehicle="1", needs_vehicle=True)
        dry_run = start(context, kind="dry_run", vehicle="1")
        other_upload = start(context, kind="upload", vehicle="2", needs_vehicle=True)
        await asyncio.sleep(1)
        context.operations.vehicle_lost("1", "silent for 5 s")
        await asyncio.sleep(LINK_GRACE_S + 0.01)
        failed_upload = context.operations.get(upload.id)
        assert (failed_upload.state, failed_upload.text) == ("failed", "Vehicle 1 was lost: silent for 5 s")
        assert isinstance(failed_upload.error, Disconnected)
        assert [context.operations.get(o.id).state for o in (dry_run, other_upload)] == ["running", "running"]

    run_test(test)


def test_an_operation_that_detects_the_loss_itself_fails_with_its_own_error():
    async def test(context):
        async def work(report):
            await asyncio.sleep(1.5)
            raise NoReply("The vehicle sent 12 of 929 parameters.", deadline_s=1)

        operation = start(context, work, vehicle="1", needs_vehicle=True)
        await asyncio.sleep(1)
        context.operations.vehicle_lost("1", "its link was closed")
        await asyncio.sleep(5)
        assert context.operations.get(operation.id).text == "The vehicle sent 12 of 929 parameters."

    run_test(test)


def test_when_the_server_stops_all_operations_are_cancelled_and_no_operation_starts():
    async def test(context):
        operations = [start(context, vehicle=str(n)) for n in range(3)]
        await asyncio.sleep(1)
        await context.operations.close()
        assert {context.operations.get(o.id).state for o in operations} == {"cancelled"}
        assert context.operations.get(operations[0].id).text == "The server stopped."
        with pytest.raises(Refused, match="shutting down"):
            start(context)

    run_test(test)


def test_the_operations_of_one_client_leave_room_for_those_of_others():
    async def test(context):
        for n in range(MAX_RUNNING_PER_CLIENT):
            start(context, vehicle=str(n), by=("mallory", "m"))
        with pytest.raises(ClientHasTooMany, match="of this client are running"):
            start(context, vehicle="more", by=("mallory", "m"))
        assert start(context, vehicle="1", by=("mallory", "m")).vehicle == "1"  # the running one
        assert start(context, vehicle="more", by=("anna", "a")).state == "running"

    run_test(test)


def test_running_operations_are_limited_and_the_oldest_ended_are_dropped():
    async def test(context):
        async def short_work(report):
            await asyncio.sleep(0.01)

        running = [start(context, kind="dry_run", vehicle=str(n)) for n in range(MAX_RUNNING)]
        with pytest.raises(Refused, match="which is the limit"):
            start(context, short_work)
        await context.operations.cancel(running[0].id)
        ended_ids = []
        for _ in range(MAX_ENDED + 10):
            ended_ids.append(start(context, short_work).id)
            await asyncio.sleep(0.02)
        assert len(context.operations.all()) == MAX_RUNNING - 1 + MAX_ENDED
        with pytest.raises(UnknownOperation):
            context.operations.get(running[0].id)
        with pytest.raises(UnknownOperation):
            context.operations.get(ended_ids[9])
        assert context.operations.get(ended_ids[10]).state == "succeeded"
        assert context.operations.get(running[1].id).state == "running"

    run_test(test)
