"""Commands of the executor of an external mode, with acknowledgements as a real PX4 sends them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from gcs_server.ros2.message_types import MESSAGES
from gcs_server.ros2.mode_executor import (
    ATTEMPT_EVERY_S,
    ATTEMPTS,
    COMMAND,
    ExecutorCommand,
    Message,
    ModeExecutor,
)

SET_NAV_STATE, TAKE_OFF_COMMAND, IN_PROGRESS = 100_001, 22, 5
"""Commands of VehicleCommand, and a result of VehicleCommandAck."""
TAKE_OFF, LAND, EXTERNAL_1 = 17, 18, 23
"""Values of nav_state."""
UNUSED = (math.nan,) * 6
LAND_COMMAND = ExecutorCommand(1, SET_NAV_STATE, (18.0, *UNUSED))


def status(nav_state: int = EXTERNAL_1, *, in_charge: int = 1, armed: bool = True) -> dict[str, int]:
    return {"nav_state": nav_state, "executor_in_charge": in_charge, "arming_state": 2 if armed else 1}


def ack(result: int, *, command: int = SET_NAV_STATE, component: int = 1001) -> dict[str, int]:
    return {"command": command, "result": result, "target_component": component}


def make_executor(**changes: Any) -> ModeExecutor:
    """Executor 1 after `status(**changes)`; by default in charge of an armed vehicle in its own mode."""
    mode_executor = ModeExecutor(1)
    mode_executor.on_status(status(**changes))
    return mode_executor


def fields(messages: list[Message]) -> dict[str, Any]:
    ((topic, data),) = messages
    assert topic == COMMAND
    return dict(MESSAGES["VehicleCommand"].decode(data))


def test_a_command_has_the_executors_component_as_its_source() -> None:
    assert ModeExecutor(3).execute(LAND_COMMAND, 0.0) == [], "the executor is not in charge"
    sent = fields(make_executor().execute(LAND_COMMAND, 0.0))
    assert (sent["command"], sent["param1"], sent["source_component"]) == (SET_NAV_STATE, 18.0, 1001)
    assert math.isnan(sent["param7"])
    assert not sent["from_external"]


@pytest.mark.parametrize(("result", "outcome"), [(0, "accepted"), (1, "rejected"), (4, "rejected")])
def test_an_acknowledgement_ends_the_command(result: int, outcome: str) -> None:
    mode_executor = make_executor()
    mode_executor.execute(LAND_COMMAND, 0.0)
    mode_executor.on_ack(ack(result))
    assert (mode_executor.state.command, mode_executor.state.outcome) == (1, outcome)
    assert mode_executor.step(10.0) == []


@pytest.mark.parametrize(
    "acknowledgement", [ack(0, command=TAKE_OFF_COMMAND), ack(0, component=1002), ack(IN_PROGRESS)]
)
def test_a_command_stays_pending_after_other_acknowledgements_and_after_progress(
    acknowledgement: dict[str, int],
) -> None:
    mode_executor = make_executor()
    mode_executor.execute(LAND_COMMAND, 0.0)
    mode_executor.on_ack(acknowledgement)
    assert mode_executor.state.outcome == "pending"


def test_a_command_without_an_acknowledgement_is_sent_three_times() -> None:
    mode_executor, now_s = make_executor(), 0.0
    sent_count = len(mode_executor.execute(LAND_COMMAND, now_s))
    while mode_executor.state.outcome == "pending" and now_s < 5.0:
        now_s += 0.02
        sent_count += len(mode_executor.step(now_s))
    assert sent_count == ATTEMPTS
    assert mode_executor.state.outcome == "no_answer"
    assert now_s == pytest.approx(ATTEMPTS * ATTEMPT_EVERY_S, abs=0.05)


@pytest.mark.parametrize(
    "status_changes", [{"in_charge": 0}, {"in_charge": 2}, {"armed": False}, {"nav_state": 5, "in_charge": 0}]
)
def test_the_executor_sends_nothing_while_it_is_not_in_charge_or_the_vehicle_is_disarmed(
    status_changes: dict[str, Any],
) -> None:
    mode_executor = make_executor(**status_changes)
    assert mode_executor.execute(LAND_COMMAND, 0.0) == []
    assert mode_executor.state.outcome == "rejected"
    pending_executor = make_executor()
    pending_executor.execute(LAND_COMMAND, 0.0)
    pending_executor.on_status(status(**status_changes))
    assert pending_executor.step(ATTEMPT_EVERY_S + 0.01) == []
    assert pending_executor.state.outcome == "rejected"


def test_a_new_command_replaces_a_pending_command() -> None:
    mode_executor = make_executor()
    mode_executor.execute(LAND_COMMAND, 0.0)
    mode_executor.execute(ExecutorCommand(2, TAKE_OFF_COMMAND, (*UNUSED, 500.0)), 0.1)
    mode_executor.on_ack(ack(0))
    assert (mode_executor.state.command, mode_executor.state.outcome) == (2, "pending")
    mode_executor.on_ack(ack(0, command=TAKE_OFF_COMMAND))
    assert mode_executor.state.outcome == "accepted"


def test_the_executor_is_in_charge_if_px4_reports_it_also_while_disarmed() -> None:
    mode_executor = ModeExecutor(1)
    assert not mode_executor.state.in_charge
    mode_executor.on_status(status(armed=False))
    assert mode_executor.state.in_charge
    mode_executor.on_status(status(5, in_charge=0))
    assert not mode_executor.state.in_charge


def test_a_completed_mode_is_reported_until_the_mode_changes() -> None:
    mode_executor = make_executor(nav_state=TAKE_OFF)
    mode_executor.on_completed({"result": 0, "nav_state": LAND})
    mode_executor.on_completed({"result": 100, "nav_state": TAKE_OFF})
    assert mode_executor.state.completed_nav_state is None
    mode_executor.on_completed({"result": 0, "nav_state": TAKE_OFF})
    mode_executor.on_status(status(TAKE_OFF))
    assert mode_executor.state.completed_nav_state == TAKE_OFF
    mode_executor.on_status(status(EXTERNAL_1))
    assert mode_executor.state.completed_nav_state is None
