"""The mission runner in a mode with an executor: take-off, and the executor no longer in charge."""

from __future__ import annotations

import pytest

from missions.offboard.compiler import compile_mission
from missions.runner.executor_control import CONFIRM_S, REPLACED, ExecutorControl
from missions.runner.parts import HOVERS_AFTER_S
from missions.runner.reading import Reading
from missions.runner.requests import Request, SetMode, StopStream, StreamScript, TakeOff
from missions.runner.runner import Runner
from tests.support.mission_vehicle import ALL
from tests.support.offboard_missions import flight_of, mission

FLY = "step: fly, points: [{offset_ned_m: [8, 0, -5]}]"
MODE = "external_1"
ARMED = Reading(
    mode=MODE, armed=True, landed="on_ground", position_ned_m=(0.0, 0.0, 0.0),
    velocity_ned_m_s=(0.0, 0.0, 0.0), yaw_ned_rad=0.0, estimates=ALL, battery_share=0.9,
    executor_in_charge=True,
)  # fmt: skip
CLIMBING = ARMED._replace(mode="takeoff", landed="taking_off")
UP = CLIMBING._replace(landed="in_air", position_ned_m=(0.0, 0.0, -10.0))


def taking_off() -> Runner:
    """A mission during the take-off by its executor."""
    runner = Runner(compile_mission(mission(flight_of(FLY))), "M", mode=MODE)
    assert [type(each) for each in runner.start(0.0, ARMED)] == [TakeOff]
    assert runner.tick(0.1, CLIMBING) == []
    return runner


def commands(requests: list[Request]) -> list[type]:
    return [
        type(each) for each in requests if isinstance(each, TakeOff | StreamScript | SetMode | StopStream)
    ]


def test_the_take_off_is_done_when_px4_reports_it_to_the_executor() -> None:
    runner = taking_off()
    assert commands(runner.tick(1.0, UP)) == []
    assert commands(runner.tick(1.1, UP._replace(take_off_complete=True))) == [StreamScript]


def test_the_take_off_is_done_after_a_while_at_its_height_if_the_report_is_lost() -> None:
    runner = taking_off()
    assert commands(runner.tick(1.0, UP)) == []
    assert commands(runner.tick(0.9 + HOVERS_AFTER_S, UP)) == []
    assert commands(runner.tick(1.0 + HOVERS_AFTER_S, UP)) == [StreamScript]


def test_without_an_executor_a_take_off_is_done_in_hold_only() -> None:
    runner = taking_off()
    without = UP._replace(executor_in_charge=None, take_off_complete=True)
    assert commands(runner.tick(1.0, without)) == []
    assert commands(runner.tick(20.0, without)) == []
    assert commands(runner.tick(20.1, without._replace(mode="hold", mode_source="vehicle"))) == [StreamScript]


def test_without_its_executor_in_charge_the_mission_requests_nothing_and_is_then_suspended() -> None:
    runner = taking_off()
    lost = UP._replace(executor_in_charge=False, take_off_complete=True)
    assert runner.tick(1.0, lost) == []
    assert commands(runner.tick(1.0 + CONFIRM_S, lost)) == [StopStream]
    assert runner.status(lost).reason == REPLACED
    assert runner.tick(9.0, lost) == []


def test_an_executor_that_is_briefly_not_in_charge_is_no_takeover() -> None:
    runner = taking_off()
    assert runner.tick(1.0, UP._replace(executor_in_charge=False)) == []
    assert runner.tick(1.5, UP) == []
    assert runner.tick(2.1, UP._replace(executor_in_charge=False)) == []
    assert runner.in_charge


@pytest.mark.parametrize("request_", [TakeOff(5.0), SetMode("land")])
def test_a_command_that_fails_while_the_executor_is_not_in_charge_is_a_takeover(request_: Request) -> None:
    runner = taking_off()
    lost = CLIMBING._replace(executor_in_charge=False)
    assert commands(runner.request_failed(request_, lost, "PX4 refused.")) == [StopStream]
    assert runner.status(lost).reason == REPLACED


def test_control_is_lost_only_while_armed_and_if_the_executor_was_in_charge() -> None:
    control = ExecutorControl()
    assert not control.is_lost(ARMED._replace(executor_in_charge=False))
    assert not control.is_lost(ARMED)
    assert control.is_lost(ARMED._replace(executor_in_charge=False))
    assert not control.is_lost(ARMED._replace(executor_in_charge=False, armed=False))
    assert not control.is_lost(ARMED._replace(executor_in_charge=None))
    control.begin_part(ARMED._replace(executor_in_charge=False))
    assert not control.is_lost(ARMED._replace(executor_in_charge=False))
