"""PX4's autotune with a scripted vehicle that starts it with every request that it gets when it is idle: at
any loss it is started once, its progress and result are those of the vehicle, and where they are not known,
that is said. A stick, a mode, another client and the end of the server end the requests."""

from contextlib import suppress

import pytest

from gcs_server.api import autotune_routes, command_routes, control_routes, models, operation_routes
from gcs_server.errors import NoReply, PlanFindings, Refused, Rejected
from gcs_server.operations.operations import Operations
from gcs_server.vehicle.services.autotune import AutotuneService
from tests.protocol.api_calls import (
    ANNA,
    BOB,
    FORCED_CONTROL_REQUEST,
    journal_entries,
    json_of,
    run_with_routes,
)
from tests.protocol.autotune_vehicle import AUTOTUNE, Px4Autotune
from tests.protocol.fake_autopilot import HOLD_MODE, LAND_MODE, ON_GROUND, POSITION_MODE
from tests.protocol.offboard_testbed import sleep

LONG_S = 170.0
"""Longer than any run and any wait of the server."""


def run_with_autotune(run_simulated, scenario, *, loss=0.0, seed=0, mode=POSITION_MODE, **options):
    async def with_autotune(rig):
        rig.autotune = Px4Autotune(rig.autopilot, **options)
        rig.autopilot.mode, rig.autopilot.position[2] = mode, 499.0
        await sleep(2.5)
        rig.autopilot.loss = loss
        rig.autopilot.random.seed(seed)
        await scenario(rig)

    run_with_routes(run_simulated, with_autotune)


async def start(rig, *despite):
    body = autotune_routes.AutotuneRequest(despite=list(despite))
    return json_of(await autotune_routes.start_autotune("1", rig.station, ANNA, body))


async def state_of(rig):
    return json_of(await autotune_routes.show_autotune(rig.vehicle))


async def ended(rig, operation, within_s=LONG_S):
    for _ in range(round(within_s)):
        shown = json_of(await operation_routes.show_operation(operation["id"], rig.station))
        if shown["state"] != "running":
            return shown
        await sleep(1.0)
    raise AssertionError(f"autotune is followed for more than {within_s} s")


async def until_progress(rig, operation, least):
    for _ in range(600):
        await sleep(0.1)
        shown = json_of(await operation_routes.show_operation(operation["id"], rig.station))
        if (shown["progress"] or 0) >= least:
            return shown
    raise AssertionError(f"progress {least} is not reached")


def test_a_run_is_followed_to_its_end_and_never_started_again(run_simulated):
    async def scenario(rig):
        known = {"enabled": True, "apply": 0, "running": False}
        assert await state_of(rig) == known | {"problem": None, "remedy": None}
        operation = await start(rig)
        assert operation["kind"] == "autotune"
        shown = await until_progress(rig, operation, 0.2)
        assert shown["text"] == "Vehicle 1 moves about its roll axis."
        assert (await state_of(rig))["running"] is True
        assert "pitch axis" in (await until_progress(rig, operation, 0.4))["text"]
        assert "yaw axis" in (await until_progress(rig, operation, 0.6))["text"]
        shown = await ended(rig, operation)
        assert (shown["state"], shown["result"]) == ("succeeded", {"outcome": "complete", "apply": 0})
        requests = len(rig.autotune.requests)
        assert 40 < requests < 70
        await sleep(60)
        assert (len(rig.autotune.starts), len(rig.autotune.requests)) == (1, requests)
        assert (await state_of(rig))["running"] is False
        assert journal_entries(rig.station)[0] == ("anna", "autotune/start", "1", "ok")

    run_with_autotune(run_simulated, scenario)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("loss", [0.05, 0.2, 0.5])
def test_at_any_loss_it_is_started_once_and_the_answer_is_true(run_simulated, loss, seed):
    async def scenario(rig):
        operation = None
        with suppress(NoReply, Refused):
            operation = await start(rig)
        if operation is not None:
            shown = await ended(rig, operation)
            if shown["state"] == "succeeded":
                assert shown["result"]["outcome"] == "complete"
            else:
                assert shown["error"]["code"] == "no_reply", shown
        await sleep(60)
        assert len(rig.autotune.starts) <= 1

    run_with_autotune(run_simulated, scenario, loss=loss, seed=seed)


def test_with_a_fifth_of_all_frames_lost_the_result_is_nearly_always_known(run_simulated):
    known = []
    for seed in range(10):

        async def scenario(rig):
            shown = await ended(rig, await start(rig))
            known.append(shown["state"] == "succeeded")

        run_with_autotune(run_simulated, scenario, loss=0.2, seed=100 + seed)
    assert sum(known) >= 8


@pytest.mark.parametrize("has_start_parameter", [True, False])
@pytest.mark.parametrize("silent_s", [1.0, 4.0, 40.0])
def test_after_a_gap_nothing_is_sent_that_could_start_it_again(run_simulated, silent_s, has_start_parameter):
    async def scenario(rig):
        operation = await start(rig)
        await until_progress(rig, operation, 0.2)
        rig.autopilot.loss = 1.0
        await sleep(silent_s)
        rig.autopilot.loss = 0.0
        shown = await ended(rig, operation)
        if silent_s == 1.0:
            assert shown["state"] == "succeeded"
        elif has_start_parameter:
            assert "has ended; its result is not known" in shown["error"]["title"] + shown["text"]
        else:
            assert "It is not known whether" in shown["text"]
        await sleep(60)
        assert len(rig.autotune.starts) == 1

    run_with_autotune(run_simulated, scenario, has_start_parameter=has_start_parameter)


@pytest.mark.parametrize("silent_s", [1.6, 2.2, 3.0, 5.0])
def test_the_end_of_a_run_within_a_gap_does_not_start_another(run_simulated, silent_s):
    async def scenario(rig):
        operation = await start(rig)
        await until_progress(rig, operation, 0.6)
        while rig.autotune.state == "yaw":
            await sleep(0.05)
        rig.autopilot.loss = 1.0
        await sleep(silent_s)
        rig.autopilot.loss = 0.0
        await ended(rig, operation)
        await sleep(30)
        assert len(rig.autotune.starts) == 1

    run_with_autotune(run_simulated, scenario)


@pytest.mark.parametrize(
    ("disturb", "words"),
    [
        (lambda rig: rig.autotune.move_stick(), "A stick was moved"),
        (lambda rig: setattr(rig.autopilot, "mode", HOLD_MODE), "The mode changed to Hold"),
        (lambda rig: rig.autotune.durations_s.update(roll=30.0), "no model of the vehicle within 20 s"),
        (lambda rig: setattr(rig.autotune, "gains_are_good", False), "out of range"),
    ],
)
def test_a_run_that_ends_without_gains_says_why(run_simulated, disturb, words):
    async def scenario(rig):
        operation = await start(rig)
        await until_progress(rig, operation, 0.2)
        disturb(rig)
        shown = await ended(rig, operation)
        assert (shown["state"], shown["error"]["code"]) == ("failed", "rejected")
        assert words in shown["text"]
        await sleep(30)
        assert len(rig.autotune.starts) == 1

    run_with_autotune(run_simulated, scenario)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rig: rig.autotune.set("MC_AT_EN", 0), "Autotune is off"),
        (lambda rig: rig.autopilot.params.pop("MC_AT_EN"), "does not answer about its autotune"),
        (lambda rig: rig.autotune.set("MC_AT_START", 1), "already tuning itself"),
        (lambda rig: setattr(rig.autopilot, "landed_state", ON_GROUND), "is not flying"),
        (lambda rig: setattr(rig.autopilot, "mode", LAND_MODE), "cannot start in Land"),
    ],
)
def test_what_prevents_a_start_is_said_and_nothing_is_sent(run_simulated, change, words):
    async def scenario(rig):
        change(rig)
        await sleep(2.5)
        assert words in (await state_of(rig))["problem"]
        with pytest.raises(Refused, match=words):
            await start(rig)
        assert rig.autotune.requests == []

    run_with_autotune(run_simulated, scenario)


@pytest.mark.parametrize(("apply", "code"), [(1, "after_disarming"), (2, "in_flight")])
def test_gains_that_the_vehicle_writes_itself_must_be_accepted(run_simulated, apply, code):
    async def scenario(rig):
        rig.autotune.set("MC_AT_APPLY", apply)
        rig.autopilot.position[2] = 491.0
        await sleep(1.0)
        with pytest.raises(PlanFindings) as refused:
            await start(rig)
        assert refused.value.codes == (f"autotune_applies_{code}", "autotune_low")
        assert rig.autotune.requests == []
        operation = await start(rig, *refused.value.codes)
        shown = await ended(rig, operation)
        outcome = "waits_for_disarming" if apply == 1 else "complete"
        assert shown["result"] == {"outcome": outcome, "apply": apply}
        await sleep(5)
        rig.autopilot.armed = False
        await sleep(30)
        assert len(rig.autotune.starts) == 1

    run_with_autotune(run_simulated, scenario)


def test_a_refusal_and_a_vehicle_without_an_answer_are_said(run_simulated):
    async def scenario(rig):
        rig.autopilot.refusals[AUTOTUNE] = 3
        with pytest.raises(Rejected, match="not supported by this vehicle"):
            await start(rig)
        rig.autopilot.refusals.clear()
        rig.autopilot.silent_commands.add(AUTOTUNE)
        with pytest.raises(NoReply, match="It may be tuning itself"):
            await start(rig)
        rig.autopilot.silent_commands.clear()
        assert (await ended(rig, await start(rig)))["state"] == "succeeded"

    run_with_autotune(run_simulated, scenario)


def test_a_start_whose_answers_are_lost_is_watched(run_simulated):
    async def scenario(rig):
        rig.autotune.answers = False
        operation = await start(rig)
        await sleep(3)
        shown = json_of(await operation_routes.show_operation(operation["id"], rig.station))
        assert (shown["progress"], "progress is not known" in shown["text"]) == (None, True)
        assert "has ended; its result is not known" in (await ended(rig, operation))["text"]
        await sleep(30)
        assert len(rig.autotune.starts) == 1

    run_with_autotune(run_simulated, scenario)


def test_the_end_of_an_earlier_run_is_not_taken_for_a_start(run_simulated):
    async def scenario(rig):
        operation = await start(rig)
        await until_progress(rig, operation, 0.2)
        rig.autotune.move_stick()
        await sleep(1.0)
        rig.vehicle._services[AutotuneService] = AutotuneService(rig.vehicle)  # a restarted server
        rig.autotune.set("MC_AT_START", 0)
        with pytest.raises(Rejected, match="still reports the end of an earlier run"):
            await start(rig)
        assert len(rig.autotune.starts) == 1

    run_with_autotune(run_simulated, scenario)


@pytest.mark.parametrize("has_start_parameter", [True, False])
def test_a_vehicle_whose_module_does_not_run_does_not_begin_at_its_next_boot(
    run_simulated, has_start_parameter
):
    async def scenario(rig):
        shown = await ended(rig, await start(rig))
        assert "does not begin" in shown["text"]
        assert rig.autopilot.params.get("MC_AT_START", (0, 0))[1] == 0
        assert ("It may still begin" in shown["error"]["remedy"]) is not has_start_parameter

    run_with_autotune(run_simulated, scenario, runs_module=False, has_start_parameter=has_start_parameter)


@pytest.mark.parametrize(
    ("mode", "modes"), [(POSITION_MODE, [HOLD_MODE]), (HOLD_MODE, [LAND_MODE, HOLD_MODE])]
)
def test_anyone_may_end_it_by_a_change_of_the_mode(run_simulated, mode, modes):
    async def scenario(rig):
        operation = await start(rig)
        await until_progress(rig, operation, 0.2)
        await autotune_routes.end_autotune("1", rig.station, BOB)
        sent = [m for m in rig.autopilot.received_messages if getattr(m, "command", None) == 176]
        entered = [int(m.param2) << 16 | int(m.param3) << 24 for m in sent]
        assert list(dict.fromkeys(entered)) == modes
        await sleep(0.2)
        assert rig.autotune.state == "fail"
        shown = await ended(rig, operation)
        assert shown["state"] == "cancelled"
        assert "Interrupted by “End autotune”" in shown["text"]
        assert rig.autopilot.mode == HOLD_MODE
        with pytest.raises(Refused, match="does not tune itself"):
            await autotune_routes.end_autotune("1", rig.station, ANNA)
        assert len(rig.autotune.starts) == 1

    run_with_autotune(run_simulated, scenario, mode=mode)


async def hold(rig):
    await command_routes.hold("1", rig.station, BOB)


async def take_control(rig):
    await control_routes.take("1", rig.station, BOB, FORCED_CONTROL_REQUEST)


async def cancel(rig):
    for each in rig.station.operations.all():
        await operation_routes.cancel_operation(each.id, rig.station, ANNA)


async def stop_server(rig):
    await rig.station.operations.close()


@pytest.mark.parametrize("interrupt", [hold, take_control, cancel, stop_server])
def test_after_another_command_or_the_end_of_control_or_server_nothing_is_asked(run_simulated, interrupt):
    async def scenario(rig):
        operation = await start(rig)
        await until_progress(rig, operation, 0.2)
        await interrupt(rig)
        requests = len(rig.autotune.requests)
        shown = await ended(rig, operation)
        assert shown["state"] == "cancelled"
        await sleep(60)
        assert (len(rig.autotune.requests), len(rig.autotune.starts)) == (requests, 1)

    run_with_autotune(run_simulated, scenario)


def test_a_restarted_server_knows_that_it_runs_and_does_not_start_it_again(run_simulated):
    async def scenario(rig):
        operation = await start(rig)
        await until_progress(rig, operation, 0.2)
        requests = len(rig.autotune.requests)
        await rig.station.operations.close()
        rig.station.operations = Operations(rig.testbed.clock, rig.testbed.supervisor, lambda _: None)
        rig.vehicle._services[AutotuneService] = AutotuneService(rig.vehicle)
        assert (await state_of(rig))["running"] is True
        with pytest.raises(Refused, match="already tuning itself"):
            await start(rig)
        assert len(rig.autotune.requests) == requests
        await autotune_routes.end_autotune("1", rig.station, ANNA)
        await sleep(0.2)
        assert rig.autotune.state == "fail"

    run_with_autotune(run_simulated, scenario)


def test_a_mode_of_the_same_client_ends_the_requests(run_simulated):
    async def scenario(rig):
        operation = await start(rig)
        await until_progress(rig, operation, 0.2)
        await command_routes.mode("1", models.ModeRequest(mode="altitude"), rig.station, ANNA)
        shown = await ended(rig, operation)
        assert "Autotune ended before it was complete. Interrupted by" in shown["text"]
        assert len(rig.autotune.starts) == 1

    run_with_autotune(run_simulated, scenario)
