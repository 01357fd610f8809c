"""Examples of interrupted commands: what is sent afterwards, and what the caller gets."""

import asyncio

import pytest

from gcs_server.api import authorized, command_routes, models, offboard_mission_routes
from gcs_server.api import offboard_mission_models as mission_models
from gcs_server.errors import Interrupted, PlanFindings
from tests.protocol.api_calls import ANNA, BOB, InlinePlanWork, json_of, run_with_routes
from tests.protocol.command_numbers import ARM_DISARM, DO_SET_MODE, TAKEOFF_COMMAND
from tests.protocol.fake_autopilot import HOLD_MODE, RTL_MODE, TAKEOFF_MODE
from tests.protocol.offboard_testbed import sleep

MISSION = {
    "format": "offboard-gcs-mission",
    "version": 1,
    "name": "Hover",
    "steps": [{"step": "take_off", "height_m": 5}, {"step": "land"}],
}
KILL = models.KillRequest(confirm="motors stop, vehicle 1 falls")


def arming_commands(autopilot):
    return [m for m in autopilot.received_commands(ARM_DISARM) if m.param1 == 1.0]


def test_after_stop_motors_interrupts_a_start_the_vehicle_is_in_hold_until_armed(run_simulated):
    async def scenario(rig):
        rig.autopilot.silent_commands.add(ARM_DISARM)
        take_off = asyncio.ensure_future(
            command_routes.takeoff("1", models.TakeoffRequest(alt_home_m=10), rig.station, ANNA)
        )
        await sleep(1.0)
        assert rig.autopilot.mode == TAKEOFF_MODE
        rig.autopilot.silent_commands.clear()
        await command_routes.kill("1", KILL, rig.station, BOB)
        with pytest.raises(Interrupted, match="Stop motors") as interrupted:
            await take_off
        assert interrupted.value.code == "interrupted"
        await sleep(1.0)
        assert (rig.autopilot.mode, rig.autopilot.armed) == (HOLD_MODE, False)
        texts = [event.text for event in rig.vehicle.events.since()]
        assert any("the server has put it into Hold" in text for text in texts)
        await command_routes.arm("1", rig.station, ANNA)
        await sleep(5.0)
        assert rig.vehicle.status.landed_state == "on_ground"

    run_with_routes(run_simulated, scenario, flying=False)


def test_arming_in_a_mode_that_flies_is_refused_unless_accepted(run_simulated):
    async def scenario(rig):
        rig.autopilot.mode = TAKEOFF_MODE
        await sleep(2.5)
        with pytest.raises(PlanFindings, match="arming it would start the flight") as refused:
            await command_routes.arm("1", rig.station, ANNA)
        assert refused.value.codes == ("arming_starts_flight",)
        assert not arming_commands(rig.autopilot)
        rig.autopilot.mode = HOLD_MODE
        await sleep(2.5)
        rig.autopilot.silent_commands.add(TAKEOFF_COMMAND)  # requested, and not reported yet
        take_off = asyncio.ensure_future(
            command_routes.takeoff("1", models.TakeoffRequest(alt_home_m=10), rig.station, ANNA)
        )
        await sleep(0.2)
        with pytest.raises(PlanFindings, match="was just commanded to Take off"):
            await command_routes.arm("1", rig.station, ANNA)
        await asyncio.gather(take_off, return_exceptions=True)
        rig.autopilot.mode = TAKEOFF_MODE
        await sleep(2.5)
        await command_routes.arm("1", rig.station, ANNA, models.ArmRequest(despite=["arming_starts_flight"]))
        assert rig.autopilot.armed

    run_with_routes(run_simulated, scenario, flying=False)


class ClosingCaller:
    """A connection that its client closes after some time."""

    async def receive(self):
        await sleep(0.3)
        return {"type": "http.disconnect"}


def test_the_end_of_the_caller_ends_only_commands_that_move(run_simulated):
    async def scenario(rig):
        authorized._caller.set(ClosingCaller())
        rig.autopilot.silent_commands.add(DO_SET_MODE)
        with pytest.raises(Interrupted, match="closed its connection"):
            await command_routes.mode("1", models.ModeRequest(mode="position"), rig.station, ANNA)
        requests = len(rig.autopilot.received_commands(DO_SET_MODE))
        await sleep(3.0)
        assert len(rig.autopilot.received_commands(DO_SET_MODE)) == requests
        rig.testbed.loop.call_later(1.0, rig.autopilot.silent_commands.clear)
        await command_routes.rtl("1", rig.station, ANNA)
        assert rig.autopilot.mode == RTL_MODE
        rig.autopilot.silent_commands.add(DO_SET_MODE)
        rig.testbed.loop.call_later(1.0, rig.autopilot.silent_commands.clear)
        await command_routes.mode("1", models.ModeRequest(mode="hold"), rig.station, ANNA)
        assert rig.autopilot.mode == HOLD_MODE

    run_with_routes(run_simulated, scenario)


@pytest.mark.parametrize("call", [offboard_mission_routes.abort, offboard_mission_routes.pause])
def test_abort_and_pause_cancel_a_start(run_simulated, call):
    class SlowPlanWork(InlinePlanWork):
        async def run(self, task, arguments, **options):
            await sleep(5.0)
            return await super().run(task, arguments, **options)

    async def scenario(rig):
        rig.station.flights.plan_work = SlowPlanWork()
        rig.station.flights.missions.attach(rig.vehicle)
        rig.station.flights.missions.start()
        body = mission_models.StartMission.model_validate({"mission": MISSION})
        start = asyncio.ensure_future(offboard_mission_routes.start("1", body, rig.station, ANNA))
        await sleep(2.0)
        (operation,) = rig.station.operations.all()
        assert (operation.kind, operation.state, operation.client) == (
            "offboard_mission/start",
            "running",
            "anna",
        )
        answer = json_of(await call("1", rig.station, ANNA))
        assert answer["mission"] is None
        with pytest.raises(Interrupted, match=f"offboard_mission/{call.__name__}"):
            await start
        assert rig.station.operations.get(operation.id).state == "cancelled"
        await sleep(10.0)
        assert not arming_commands(rig.autopilot)

    run_with_routes(run_simulated, scenario, flying=False)
