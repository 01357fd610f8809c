"""The mission runner in a mode with a mode executor: take-off, and an executor that loses control."""

from __future__ import annotations

import pytest

from missions.offboard.compiler import compile_mission
from missions.runner.parts import HOVERS_AFTER_S
from missions.runner.reading import Reading
from missions.runner.requests import Request, SetMode, StopStream, StreamScript, TakeOff
from missions.runner.runner import Runner
from missions.runner.watch import CONFIRM_S, REPLACED, ExecutorControl
from tests.support.mission_vehicle import ALL_ESTIMATES
from tests.support.offboard_missions import flight_steps, mission

FLY = "step: fly, points: [{offset_ned_m: [8, 0, -5]}]"
MODE = "external_1"
ARMED = Reading(
    mode=MODE, armed=True, landed="on_ground", position_ned_m=(0.0, 0.0, 0.0),
    velocity_ned_m_s=(0.0, 0.0, 0.0), yaw_ned_rad=0.0, estimates=ALL_ESTIMATES, battery_share=0.9,
    executor_in_charge=True,
)  # fmt: skip
CLIMBING = ARMED._replace(mode="takeoff", landed="taking_off")
AT_HEIGHT = CLIMBING._replace(landed="in_air", position_ned_m=(0.0, 0.0, -10.0))


def runner_in_take_off() -> Runner:
    """A mission whose executor has commanded the take-off."""
    runner = Runner(compile_mission(mission(flight_steps(FLY))), "M", mode=MODE)
    assert [type(each) for each in runner.start(0.0, ARMED)] == [TakeOff]
    assert runner.tick(0.1, CLIMBING) == []
    return runner


def command_types(requests: list[Request]) -> list[type]:
    return [
        type(each) for each in requests if isinstance(each, TakeOff | StreamScript | SetMode | StopStream)
    ]


def test_the_take_off_is_complete_when_px4_reports_completion_to_the_executor() -> None:
    runner = runner_in_take_off()
    assert command_types(runner.tick(1.0, AT_HEIGHT)) == []
    assert command_types(runner.tick(1.1, AT_HEIGHT._replace(take_off_complete=True))) == [StreamScript]


def test_the_take_off_is_complete_after_hovering_if_the_report_is_lost() -> None:
    runner = runner_in_take_off()
    assert command_types(runner.tick(1.0, AT_HEIGHT)) == []
    assert command_types(runner.tick(0.9 + HOVERS_AFTER_S, AT_HEIGHT)) == []
    assert command_types(runner.tick(1.0 + HOVERS_AFTER_S, AT_HEIGHT)) == [StreamScript]


def test_a_take_off_without_an_executor_is_complete_only_in_hold() -> None:
    runner = runner_in_take_off()
    without_executor = AT_HEIGHT._replace(executor_in_charge=None, take_off_complete=True)
    assert command_types(runner.tick(1.0, without_executor)) == []
    assert command_types(runner.tick(20.0, without_executor)) == []
    assert command_types(
        runner.tick(20.1, without_executor._replace(mode="hold", mode_source="vehicle"))
    ) == [StreamScript]


def test_a_mission_whose_executor_is_not_in_charge_requests_nothing_and_is_suspended() -> None:
    runner = runner_in_take_off()
    not_in_charge = AT_HEIGHT._replace(executor_in_charge=False, take_off_complete=True)
    assert runner.tick(1.0, not_in_charge) == []
    assert command_types(runner.tick(1.0 + CONFIRM_S, not_in_charge)) == [StopStream]
    assert runner.status(not_in_charge).reason == REPLACED
    assert runner.tick(9.0, not_in_charge) == []


def test_an_executor_that_is_briefly_not_in_charge_does_not_suspend_the_mission() -> None:
    runner = runner_in_take_off()
    assert runner.tick(1.0, AT_HEIGHT._replace(executor_in_charge=False)) == []
    assert runner.tick(1.5, AT_HEIGHT) == []
    assert runner.tick(2.1, AT_HEIGHT._replace(executor_in_charge=False)) == []
    assert runner.in_charge


@pytest.mark.parametrize("failed_request", [TakeOff(5.0), SetMode("land")])
def test_a_command_that_fails_while_the_executor_is_not_in_charge_suspends_the_mission(
    failed_request: Request,
) -> None:
    runner = runner_in_take_off()
    not_in_charge = CLIMBING._replace(executor_in_charge=False)
    assert command_types(runner.request_failed(failed_request, not_in_charge, "PX4 refused.")) == [StopStream]
    assert runner.status(not_in_charge).reason == REPLACED


def test_control_is_lost_only_while_armed_and_if_the_executor_was_in_charge() -> None:
    control = ExecutorControl()
    assert not control.is_lost(ARMED._replace(executor_in_charge=False))
    assert not control.is_lost(ARMED)
    assert control.is_lost(ARMED._replace(executor_in_charge=False))
    assert not control.is_lost(ARMED._replace(executor_in_charge=False, armed=False))
    assert not control.is_lost(ARMED._replace(executor_in_charge=None))
    control.begin_part(ARMED._replace(executor_in_charge=False))
    assert not control.is_lost(ARMED._replace(executor_in_charge=False))
