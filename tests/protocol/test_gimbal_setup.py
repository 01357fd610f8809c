"""Set-up of a gimbal from factory settings, and reviewed changes of parameters, with packet loss."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import pytest

from gcs_server.api import gimbal_setup_routes, param_change_routes
from gcs_server.errors import ChangesRefused, InvalidRequest, NoReply, NotInControl, Refused, Rejected
from gcs_server.vehicle.param_review import WantedParam
from gcs_server.vehicle.services.gimbal_setup import GimbalSetupService
from gcs_server.vehicle.services.param_changes import ParamChange, ParamChanges
from tests.protocol.api_calls import ANNA, BOB, json_of, new_station
from tests.protocol.offboard_testbed import OffboardTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot

PARAM_SET, REBOOT_COMMAND = 23, 246
FACTORY = {"MNT_MODE_IN": -1}
Scenario = Callable[[Any], Awaitable[None]]


def run_with_vehicle(run_simulated: Any, scenario: Scenario, *, loss: float = 0.0, seed: int = 0) -> None:
    """Runs a test with a simulated PX4 with factory settings, whose parameters have been read."""

    async def run() -> None:
        testbed = OffboardTestbed()
        autopilot = SimulatedAutopilot(testbed.link(), seed=seed, parameters=FACTORY)
        try:
            vehicle = await testbed.wait_for_vehicle()
            await asyncio.sleep(1.0)
            vehicle.metadata.read = _read_here
            vehicle.metadata.run_in_thread = _run_here
            await vehicle.params.refresh()
            autopilot.loss = loss
            rig = SimpleNamespace(testbed=testbed, autopilot=autopilot, vehicle=vehicle)
            rig.changes, rig.setup = vehicle.service(ParamChanges), vehicle.service(GimbalSetupService)
            await scenario(rig)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


async def _read_here(kind: int, packed: bytes, crc: int) -> Any:
    from gcs_server.vehicle import metadata_files

    return metadata_files.decode_document(kind, metadata_files.encode_document(kind, packed, crc))


async def _run_here(work: Callable[[], Any]) -> Any:
    return work()


async def apply_values(rig: Any, values: dict[str, float], **options: Any) -> Any:
    """Reviews values and writes them."""
    rows = await rig.changes.review([WantedParam(*each) for each in values.items()])
    return await rig.changes.apply([ParamChange(r.name, r.old, r.new) for r in rows], **options)


@pytest.mark.parametrize(("loss", "seed"), [(0.0, 0), (0.2, 1)])
def test_from_factory_settings_to_a_turning_gimbal(run_simulated: Any, loss: float, seed: int) -> None:
    async def scenario(rig: Any) -> None:
        setup = await rig.setup.read()
        assert setup.module.state == "unknown"
        assert [finding.code for finding in setup.findings] == ["input_none", "no_outputs", "prearm_off"]
        outputs = {output.name: output for output in setup.outputs}
        assert len(outputs) == 16
        assert (outputs["MAIN 1"].function_label, outputs["MAIN 1"].axis) == ("Motor 1", None)
        written = await apply_values(
            rig,
            {
                "MNT_MODE_IN": setup.findings[0].changes[0].value,
                outputs["MAIN 7"].function_param: setup.functions["roll"],
                outputs["MAIN 8"].function_param: setup.functions["pitch"],
                "PWM_MAIN_REV": 1 << outputs["MAIN 8"].reverse_bit,
                "COM_PREARM_MODE": 2,
            },
        )
        assert {row.state for row in written.rows} == {"set"}
        assert written.waiting == ("MNT_MODE_IN",)
        gimbal = rig.autopilot.sim.autopilots[0].gimbal
        assert not gimbal.running, "PX4 reads MNT_MODE_IN when the module starts"
        setup = await rig.setup.read()
        assert [finding.code for finding in setup.findings] == ["not_started"]
        for _ in range(6):  # at this loss an echo of the console may be missing
            try:
                module = await rig.setup.start()
                break
            except NoReply:
                assert loss, "without loss the console answers"
        assert module.state == "input_mavlink"
        assert gimbal.enabled
        await asyncio.sleep(4.0)
        setup = await rig.setup.read()
        assert (setup.findings, setup.waiting) == ((), ())
        assert {o.name: o.axis for o in setup.outputs if o.axis} == {"MAIN 7": "roll", "MAIN 8": "pitch"}
        await rig.vehicle.gimbal.take_control()
        await rig.vehicle.gimbal.try_axis("roll", 30.0)
        assert gimbal.actual.roll_rad == pytest.approx(math.radians(30.0), abs=0.01)
        await rig.vehicle.gimbal.try_axis("pitch", -20.0)
        await asyncio.sleep(2.0)
        pwm_us = rig.vehicle.topic("motors").value.pwm_us
        # 20 of 45° to the one side; MAIN 8 is reversed
        assert pwm_us[6:8] == (1500, pytest.approx(1500 + 500 * 20 / 45, abs=1))
        assert all(pulse == 900 for pulse in pwm_us[:4]), "the motors do not turn"
        for pose in ("neutral", "retract", "centre"):
            await rig.vehicle.gimbal.try_axis("pitch", -20.0)
            await rig.vehicle.gimbal.set_pose(pose)
            assert gimbal.setpoint.pitch_rad == pytest.approx(0.0, abs=0.01)

    run_with_vehicle(run_simulated, scenario, loss=loss, seed=seed)


def test_an_axis_is_not_tried_while_armed_unless_said_and_not_without_control(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        await rig.setup.start()
        await apply_values(rig, {"MNT_MODE_IN": 4})
        await rig.setup.start()
        with pytest.raises(Refused, match="not controlled"):
            await rig.vehicle.gimbal.try_axis("pitch", -10.0)
        await rig.vehicle.gimbal.take_control()
        with pytest.raises(InvalidRequest, match="angle_deg"):
            await rig.vehicle.gimbal.try_axis("roll", 200.0)
        await asyncio.sleep(15)
        await rig.vehicle.command.arm()
        with pytest.raises(Refused, match="is armed"):
            await rig.vehicle.gimbal.try_axis("pitch", -10.0)
        with pytest.raises(Refused, match="is armed"):
            await rig.setup.start()
        await rig.vehicle.gimbal.try_axis("pitch", -10.0, while_armed=True)

    run_with_vehicle(run_simulated, scenario)


def test_changes_are_written_as_reviewed_or_not_at_all_and_undone(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        parameters = rig.autopilot.sim.autopilots[0].view.parameters
        sets = rig.autopilot.count(PARAM_SET)
        wanted = [
            WantedParam("MNT_RANGE_YAW", 5000.0),
            WantedParam("NO_SUCH", 1.0),
            WantedParam("MNT_MODE_IN", 1.5),
            WantedParam("MNT_DO_STAB", 1.0, is_integer=False),
            WantedParam("MNT_RATE_YAW", 40.0),
            WantedParam("MNT_RATE_YAW", 50.0),
            WantedParam("MNT_RATE_PITCH", 30.0),
            WantedParam("MNT_OFF_YAW", 4.0),
        ]
        rows = await rig.changes.review(wanted)
        assert [row.state for row in rows] == [*["refused"] * 6, "same", "change"]
        assert all(row.problem for row in rows[:6])
        assert (rows[7].old, rows[7].new, rows[7].unit) == (0.0, 4.0, "deg")
        with pytest.raises(ChangesRefused, match="Nothing was written") as refusal:
            await rig.changes.apply([ParamChange("MNT_OFF_YAW", 0.0, 4.0), ParamChange("NO_SUCH", 0.0, 1.0)])
        assert "NO_SUCH" in str(refusal.value.details())
        parameters.set("MNT_OFF_YAW", 7.0)  # meanwhile, another station
        with pytest.raises(ChangesRefused) as refusal:
            await rig.changes.apply([ParamChange("MNT_OFF_YAW", 0.0, 4.0)])
        assert "now has 7" in str(refusal.value.details())
        assert rig.autopilot.count(PARAM_SET) == sets, "nothing was sent"
        await apply_values(rig, {"MNT_OFF_YAW": 4.0, "MNT_RATE_YAW": 44.0})
        await apply_values(rig, {"MNT_OFF_YAW": 5.0})
        for expected in ((4.0, 44.0), (7.0, 30.0)):
            undo = await rig.changes.review(rig.changes.undone())
            await rig.changes.apply([ParamChange(r.name, r.old, r.new) for r in undo], undoes=True)
            assert (parameters.get("MNT_OFF_YAW"), parameters.get("MNT_RATE_YAW")) == expected
        with pytest.raises(Refused, match="no change"):
            rig.changes.undone()

    run_with_vehicle(run_simulated, scenario)


def test_a_value_that_was_not_taken_is_named_and_the_rest_is_written(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        parameters = rig.autopilot.sim.autopilots[0].view.parameters
        store = parameters.set

        def limit(name: str, value: float) -> Any:
            return store(name, min(value, 3.0) if name == "MNT_OFF_YAW" else value)

        parameters.set = limit
        written = await apply_values(rig, {"MNT_OFF_YAW": 9.0, "MNT_OFF_ROLL": 2.0})
        assert [(row.name, row.state, row.now) for row in written.rows] == [
            ("MNT_OFF_YAW", "not_taken", 3.0),
            ("MNT_OFF_ROLL", "set", 2.0),
        ]
        assert "still has MNT_OFF_YAW = 3" in str(written.rows[0].problem)
        assert [each.name for each in rig.changes.undone()] == ["MNT_OFF_ROLL"]

    run_with_vehicle(run_simulated, scenario)


def test_only_the_client_in_control_writes_and_losing_it_ends_the_writing(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        station = new_station(rig.testbed)

        def body(**values: float) -> param_change_routes.ApplyRequest:
            rows = [{"name": name, "old": 0.0, "value": value} for name, value in values.items()]
            return param_change_routes.ApplyRequest.model_validate({"changes": rows})

        answer = json_of(await param_change_routes.apply("1", body(MNT_OFF_YAW=2.0), station, ANNA))
        assert (answer["last"]["rows"][0]["state"], answer["undo_count"]) == ("set", 1)
        with pytest.raises(NotInControl):
            await param_change_routes.apply("1", body(MNT_OFF_ROLL=2.0), station, BOB)
        checks = iter([None, NotInControl("1", holder="bob", holder_key="bob", can_be_asked=True)])

        def may_go_on() -> None:
            problem = next(checks)
            if problem is not None:
                raise problem

        changes = [ParamChange("MNT_OFF_ROLL", 0.0, 2.0), ParamChange("MNT_OFF_PITCH", 0.0, 2.0)]
        written = await rig.changes.apply(changes, may_go_on=may_go_on)
        assert [row.state for row in written.rows] == ["set", "not_written"]
        assert "bob has control" in str(written.stopped)

    run_with_vehicle(run_simulated, scenario)


def test_a_restart_is_confirmed_disarmed_only_and_refused_by_a_simulated_px4(run_simulated: Any) -> None:
    async def scenario(rig: Any) -> None:
        station = new_station(rig.testbed)
        request = param_change_routes.RestartRequest
        with pytest.raises(InvalidRequest, match="confirmation"):
            await param_change_routes.restart("1", request(confirm="yes"), station, ANNA)
        confirmed = request(confirm="vehicle 1 restarts")
        with pytest.raises(Rejected, match="refuses to restart") as refusal:
            await param_change_routes.restart("1", confirmed, station, ANNA)
        assert "start it again" in str(refusal.value.remedy)
        await asyncio.sleep(15)
        await rig.vehicle.command.arm()
        with pytest.raises(Refused, match="is armed"):
            await param_change_routes.restart("1", confirmed, station, ANNA)
        with pytest.raises(Refused, match="is armed"):
            await rig.changes.apply([ParamChange("MNT_OFF_YAW", 0.0, 4.0)])
        shown = json_of(await gimbal_setup_routes.show_setup(rig.vehicle))
        assert shown["setup"]["findings"][0]["code"] == "input_none"
        assert shown["params"][0] | {"facts": None} == {
            "name": "MNT_MODE_IN",
            "value": -1,
            "is_integer": True,
            "is_default": True,
            "facts": None,
        }

    run_with_vehicle(run_simulated, scenario)
