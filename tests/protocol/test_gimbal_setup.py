"""Set-up of a gimbal from factory settings, with packet loss."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import pytest

from gcs_server.errors import InvalidRequest, NoReply, Refused
from tests.protocol.described_vehicle import apply_values, run_with_vehicle


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
