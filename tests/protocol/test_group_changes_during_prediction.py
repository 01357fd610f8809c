"""Events while the server predicts the paths of a group: the server checks the new situation before it
accepts the setpoints."""

import asyncio

import pytest

from gcs_server.api import group_routes, offboard_routes
from gcs_server.api.setpoints import StartRequest
from gcs_server.errors import Interrupted, NotTogether, Refused
from gcs_server.flights.group import GroupChecks
from tests.protocol.api_calls import json_of
from tests.protocol.fake_autopilot import HOLD_MODE, OFFBOARD_MODE, POSITION_MODE
from tests.protocol.group_testbed import (
    ANNA,
    BOB,
    SETPOINTS_NORTH,
    assert_no_vehicle_moved,
    autopilot_modes,
    position_setpoint,
    run_with_vehicles,
    setpoints_request,
    start_group,
)
from tests.protocol.offboard_testbed import mode_requests, sleep


def call_during_prediction(monkeypatch, number, callback):
    """Calls `callback` during the prediction with this number (from 1)."""
    in_pieces, count = GroupChecks._in_pieces, 0

    async def in_pieces_with_call(self, plan):
        nonlocal count
        count += 1
        if count == number:
            await callback()
        return await in_pieces(self, plan)

    monkeypatch.setattr(GroupChecks, "_in_pieces", in_pieces_with_call)


def switch_to_position_by_pilot(rig, vehicle_id):
    """Switches this vehicle to Position mode, as its pilot does."""
    autopilot = rig.autopilots[vehicle_id]
    autopilot.mode = autopilot.requested_mode = POSITION_MODE
    autopilot.send_current_mode()


def test_a_member_that_leaves_during_the_prediction_cancels_the_start(run_simulated, monkeypatch):
    async def scenario(rig):
        async def take_over_by_pilot():
            assert set(autopilot_modes(rig).values()) == {OFFBOARD_MODE}
            await sleep(6)  # after a mode request the server tolerates another mode for some seconds
            switch_to_position_by_pilot(rig, "2")
            await sleep(6)

        call_during_prediction(monkeypatch, 2, take_over_by_pilot)
        with pytest.raises(NotTogether, match="Vehicle 2 left before the common start") as refused:
            await start_group(rig, SETPOINTS_NORTH, others_go_on=True)
        assert refused.value.vehicles == ("2",)
        await sleep(3)
        assert autopilot_modes(rig) == {"1": HOLD_MODE, "2": POSITION_MODE, "3": HOLD_MODE}
        assert_no_vehicle_moved(rig)
        assert json_of(await group_routes.show("1", rig.station))["state"] == "ended"

    run_with_vehicles(run_simulated, scenario)


def test_hold_during_the_prediction_cancels_the_start(run_simulated, monkeypatch):
    async def scenario(rig):
        async def hold():
            await group_routes.hold("1", rig.station, BOB)

        call_during_prediction(monkeypatch, 2, hold)
        with pytest.raises(Interrupted, match="Interrupted by “Hold”"):
            await start_group(rig, SETPOINTS_NORTH)
        await sleep(3)
        assert set(autopilot_modes(rig).values()) == {HOLD_MODE}
        assert_no_vehicle_moved(rig)
        assert json_of(await group_routes.show("1", rig.station))["state"] == "ended"

    run_with_vehicles(run_simulated, scenario)


def test_a_members_stream_that_starts_during_the_prediction_interrupts_the_start(run_simulated, monkeypatch):
    async def scenario(rig):
        async def start_stream():
            single_start = StartRequest.model_validate({"setpoint": position_setpoint(1), "valid_for_s": 60})
            starts.append(asyncio.ensure_future(offboard_routes.start("3", single_start, rig.station, ANNA)))
            await sleep(0.1)

        starts = []
        call_during_prediction(monkeypatch, 1, start_stream)
        with pytest.raises(Interrupted, match="Interrupted by “offboard/start”"):
            await start_group(rig, SETPOINTS_NORTH)
        assert json_of(await starts[0])["state"] == "streaming"
        assert not any(mode_requests(rig.autopilots[v], OFFBOARD_MODE) for v in "12")

    run_with_vehicles(run_simulated, scenario)


def test_the_later_of_two_starts_with_a_common_vehicle_interrupts_the_earlier(run_simulated):
    async def scenario(rig):
        starts = (
            start_group(rig, {"1": position_setpoint(4), "2": position_setpoint(4)}),
            start_group(rig, {"2": position_setpoint(4), "3": position_setpoint(4)}),
        )
        results = await asyncio.gather(*starts, return_exceptions=True)
        assert isinstance(results[0], Interrupted)
        assert results[1]["state"] in ("waiting", "flying")
        assert len(json_of(await group_routes.show_all(rig.station))["groups"]) == 1

    run_with_vehicles(run_simulated, scenario)


def test_vehicles_that_approach_during_the_prediction_are_refused(run_simulated, monkeypatch):
    async def scenario(rig):
        async def move_vehicle_2():
            north_m, _, down_m = rig.autopilots["2"].position_ned_m
            rig.autopilots["2"].position_ned_m = [
                north_m,
                -7.0,
                down_m,
            ]  # its origin is 10 m east of vehicle 1's
            await sleep(1)

        call_during_prediction(monkeypatch, 1, move_vehicle_2)
        with pytest.raises(NotTogether, match=r"Vehicles 1 and 2 are 3\.0 m apart now"):
            await start_group(rig, SETPOINTS_NORTH)
        assert not any(mode_requests(autopilot, OFFBOARD_MODE) for autopilot in rig.autopilots.values())

    run_with_vehicles(run_simulated, scenario)


@pytest.mark.parametrize("others_go_on", [False, True])
def test_a_member_that_leaves_during_the_prediction_of_new_setpoints_gets_no_setpoint(
    run_simulated, monkeypatch, others_go_on
):
    async def scenario(rig):
        async def take_over_by_pilot():
            switch_to_position_by_pilot(rig, "2")
            await sleep(6)

        await start_group(rig, SETPOINTS_NORTH, others_go_on=others_go_on)
        await sleep(7)
        call_during_prediction(monkeypatch, 1, take_over_by_pilot)
        with pytest.raises(Refused, match=r"Vehicle 2 is held|is ended: it accepts no setpoints"):
            await group_routes.setpoints(
                "1",
                setpoints_request({"1": position_setpoint(7), "2": position_setpoint(7)}),
                rig.station,
                ANNA,
            )
        await sleep(3)
        others_mode = OFFBOARD_MODE if others_go_on else HOLD_MODE
        assert autopilot_modes(rig) == {"1": others_mode, "2": POSITION_MODE, "3": others_mode}
        assert not [m for a in rig.autopilots.values() for _, m in a.setpoints if abs(m.x - 7.0) < 0.01]

    run_with_vehicles(run_simulated, scenario)


def test_a_client_that_disconnects_during_the_prediction_leaves_no_partial_group(run_simulated, monkeypatch):
    async def scenario(rig):
        async def disconnect_during(call):
            in_prediction = asyncio.Event()

            async def wait_in_prediction():
                in_prediction.set()
                await sleep(60)

            with monkeypatch.context() as patch:
                call_during_prediction(patch, 1, wait_in_prediction)
                request = asyncio.ensure_future(call)
                await in_prediction.wait()
                request.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await request

        await disconnect_during(start_group(rig, SETPOINTS_NORTH))
        assert json_of(await group_routes.show_all(rig.station))["groups"] == []
        assert not any(mode_requests(autopilot, OFFBOARD_MODE) for autopilot in rig.autopilots.values())
        await start_group(rig, SETPOINTS_NORTH)
        await sleep(1)
        await disconnect_during(
            group_routes.setpoints(
                "1", setpoints_request({"1": position_setpoint(7)}, valid_for_s=5), rig.station, ANNA
            )
        )
        group = json_of(await group_routes.show("1", rig.station))
        assert (group["state"], group["findings"]) == ("flying", [])
        assert group["valid_left_s"] > 50
        assert not [m for a in rig.autopilots.values() for _, m in a.setpoints if abs(m.x - 7.0) < 0.01]
        await group_routes.setpoints("1", setpoints_request({"1": position_setpoint(6)}), rig.station, ANNA)
        await sleep(0.1)
        assert rig.autopilots["1"].setpoints[-1][1].x == pytest.approx(6.0)

    run_with_vehicles(run_simulated, scenario)
