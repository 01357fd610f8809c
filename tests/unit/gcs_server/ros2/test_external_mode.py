"""Registration, arming checks and end of an external mode, with recorded messages of a real PX4."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_server.ros2.external_mode import (
    ATTEMPTS,
    CHECK_REPLY,
    CHECK_REQUEST,
    COMPLETED,
    CONTROLLERS,
    LOST_S,
    MAX_IGNORED,
    OVERRIDES,
    REGISTER,
    REGISTER_REPLY,
    SENT_TYPES,
    UNREGISTER,
    ExternalMode,
    Message,
    ModeDeclaration,
    controllers_message,
)
from gcs_server.ros2.message_types import MESSAGES, Values
from tests.support.dds_samples import server_samples

RECORDED = server_samples()
NAME, REQUEST_ID = "Fly Mode", 2199029506047954537
"""Values of the recorded registration."""
ACCEPTING_REPLY: Values = MESSAGES["RegisterExtComponentReply"].decode(RECORDED[REGISTER_REPLY])
ARMING_CHECK: Values = MESSAGES["ArmingCheckRequest"].decode(RECORDED[CHECK_REQUEST])
EXTERNAL_1, HOLD = 23, 4
"""Values of nav_state."""
MODE_MASK = 1 << EXTERNAL_1
"""can_set_nav_states_mask of VehicleStatus while only external_1 is registered."""


def new_mode(now_s: float = 0.0) -> ExternalMode:
    return ExternalMode(ModeDeclaration(NAME, frozenset({"attitude", "local_position"})), REQUEST_ID, now_s)


def registered_mode(now_s: float = 0.0) -> ExternalMode:
    external_mode = new_mode(now_s)
    external_mode.step(now_s)
    external_mode.on_reply(ACCEPTING_REPLY, now_s)
    for _ in range(2):
        external_mode.on_check_request(ARMING_CHECK, now_s, can_run=True)
    return external_mode


def fields(messages: list[Message], topic: str) -> dict[str, Any]:
    """Fields of the only message; the message must have this topic."""
    ((sent_topic, data),) = messages
    assert sent_topic == topic
    return dict(MESSAGES[SENT_TYPES[topic]].decode(data))


def test_the_registration_request_equals_the_recorded_request() -> None:
    ((topic, data),) = new_mode().step(0.0)
    assert topic == REGISTER
    assert RECORDED[REGISTER].removeprefix(data).strip(b"\0") == b"", (
        "the request differs in more than the padding of DDS"
    )


def test_a_mode_is_registered_once_px4_has_evaluated_a_check_reply() -> None:
    external_mode = new_mode()
    external_mode.step(0.0)
    controllers = fields(external_mode.on_reply(ACCEPTING_REPLY, 0.02), CONTROLLERS)
    assert controllers["source_id"] == EXTERNAL_1
    assert controllers["flag_control_position_enabled"]
    assert controllers["flag_control_allocation_enabled"]
    assert (external_mode.registration.state, external_mode.registration.mode) == ("registering", None)
    external_mode.on_check_request(ARMING_CHECK, 0.3, can_run=True)
    assert external_mode.registration.state == "registering"
    external_mode.on_check_request(ARMING_CHECK, 0.6, can_run=True)
    assert (external_mode.registration.state, external_mode.registration.mode) == ("registered", "external_1")
    assert external_mode.registration.nav_state == EXTERNAL_1


def test_each_arming_check_gets_an_immediate_reply_with_the_requirements() -> None:
    reply = fields(registered_mode().on_check_request(ARMING_CHECK, 0.9, can_run=True), CHECK_REPLY)
    assert (reply["request_id"], reply["registration_id"]) == (115, 0)
    requirements = {name for name, value in reply.items() if name.startswith("mode_req_") and value}
    assert requirements == {"mode_req_attitude", "mode_req_local_position", "mode_req_prevent_arming"}
    assert reply["can_arm_and_run"]
    assert not fields(registered_mode().on_check_request(ARMING_CHECK, 0.9, can_run=False), CHECK_REPLY)[
        "can_arm_and_run"
    ]


def test_a_mode_that_is_not_ready_prevents_arming_but_never_interrupts_a_flight() -> None:
    external_mode = registered_mode()
    external_mode.ready = False
    status = status_of(HOLD, 0)
    for armed in (False, True):
        external_mode.on_status({**status, "arming_state": 2 if armed else 1})
        reply = fields(external_mode.on_check_request(ARMING_CHECK, 0.9, can_run=True), CHECK_REPLY)
        assert reply["can_arm_and_run"] == armed


def test_a_check_reply_differs_from_the_recorded_reply_only_in_the_declared_requirements() -> None:
    recorded_reply = MESSAGES["ArmingCheckReply"].decode(RECORDED[CHECK_REPLY])
    sent_reply = fields(
        registered_mode().on_check_request(
            {**ARMING_CHECK, "request_id": recorded_reply["request_id"]}, 0.9, can_run=True
        ),
        CHECK_REPLY,
    )
    assert {name for name in sent_reply if sent_reply[name] != recorded_reply[name]} == {
        "mode_req_prevent_arming"
    }


def test_another_version_of_px4s_interface_is_refused_and_the_reason_names_it() -> None:
    external_mode = new_mode()
    external_mode.step(0.0)
    removal = fields(external_mode.on_reply({**ACCEPTING_REPLY, "px4_ros2_api_version": 2}, 0.02), UNREGISTER)
    assert removal["mode_id"] == EXTERNAL_1
    assert external_mode.registration.state == "refused"
    reason = external_mode.registration.reason
    assert "has version 2, but this server knows version 1; use PX4 v1.15 to v1.17" in reason


def test_without_a_reply_registration_is_refused_after_five_requests() -> None:
    external_mode, request_count, now_s = new_mode(), 0, 0.0
    while external_mode.registration.state == "registering" and now_s < 20.0:
        request_count += len(external_mode.step(now_s))
        now_s += 0.02
    assert request_count == ATTEMPTS
    assert now_s == pytest.approx(5.0, abs=0.1)
    assert external_mode.registration.state == "refused"
    assert "did not answer" in external_mode.registration.reason
    assert external_mode.step(now_s + 10) == []
    assert external_mode.on_check_request(ARMING_CHECK, now_s, can_run=True) == []


@pytest.mark.parametrize(
    "refusal",
    [
        {"success": False, "arming_check_id": -1, "mode_id": -1},
        {"success": False, "arming_check_id": 0, "mode_id": 0},
        {"mode_id": 4},
    ],
)
def test_a_refusal_ends_the_registration(refusal: dict[str, Any]) -> None:
    external_mode = new_mode()
    external_mode.step(0.0)
    assert external_mode.on_reply({**ACCEPTING_REPLY, **refusal}, 0.02) == []
    assert external_mode.registration.state == "refused"
    assert "COM_MODE_ARM_CHK" in external_mode.registration.reason
    assert external_mode.step(5.0) == []


@pytest.mark.parametrize("changes", [{"request_id": 7}, {"name": (79, *[0] * 24)}])
def test_a_reply_to_another_program_is_ignored(changes: dict[str, Any]) -> None:
    external_mode = new_mode()
    external_mode.step(0.0)
    assert external_mode.on_reply({**ACCEPTING_REPLY, **changes}, 0.02) == []
    assert external_mode.registration.nav_state is None


def test_a_second_registration_by_a_repeated_request_is_removed() -> None:
    external_mode = registered_mode()
    second_reply = {**ACCEPTING_REPLY, "arming_check_id": 1, "mode_id": 24}
    removal = fields(external_mode.on_reply(second_reply, 1.2), UNREGISTER)
    assert (removal["arming_check_id"], removal["mode_id"], removal["mode_executor_id"]) == (1, 24, -1)
    assert external_mode.registration.mode == "external_1"


@pytest.mark.parametrize("active", [False, True])
def test_a_mode_whose_replies_px4_does_not_accept_is_lost_unless_the_vehicle_flies_in_it(
    active: bool,
) -> None:
    """PX4 v1.17 reports in each request whose replies it has; it may accept later replies again in flight."""
    external_mode = registered_mode()
    if active:
        external_mode.on_status({**status_of(EXTERNAL_1, 1 << EXTERNAL_1), "arming_state": 2})
    dropped = {**ARMING_CHECK, "valid_registrations_mask": 0}
    for number in range(MAX_IGNORED - 1):
        assert external_mode.on_check_request(dropped, 0.3 * number, can_run=True)
    assert external_mode.on_check_request(ARMING_CHECK, 1.5, can_run=True), "its bit has returned"
    for number in range(MAX_IGNORED):
        external_mode.on_check_request(dropped, 2.0 + 0.3 * number, can_run=True)
    assert external_mode.registration.state == ("registered" if active else "lost")
    assert active or "does not accept the server's replies" in external_mode.registration.reason


def test_without_arming_check_requests_the_mode_is_lost() -> None:
    external_mode = registered_mode()
    assert external_mode.step(LOST_S - 0.01) == []
    assert external_mode.registration.state == "registered"
    external_mode.step(LOST_S + 0.01)
    assert external_mode.registration.state == "lost"
    assert "restarted" in external_mode.registration.reason
    assert external_mode.registration.mode is None
    assert external_mode.on_check_request(ARMING_CHECK, 5.0, can_run=True) == []
    assert external_mode.completed(success=True) == []


def test_a_mode_that_px4_has_removed_is_lost() -> None:
    external_mode = registered_mode()
    external_mode.on_status({"arming_state": 1, "can_set_nav_states_mask": 0, "nav_state": HOLD})
    assert external_mode.registration.state == "registered", (
        "an old status, from before the registration, has removed the mode"
    )
    external_mode.on_status({"arming_state": 1, "can_set_nav_states_mask": MODE_MASK, "nav_state": HOLD})
    external_mode.on_status({"arming_state": 1, "can_set_nav_states_mask": MODE_MASK, "nav_state": HOLD})
    assert external_mode.registration.state == "registered"
    external_mode.on_status({"arming_state": 1, "can_set_nav_states_mask": 0, "nav_state": HOLD})
    assert external_mode.registration.state == "lost"
    assert "no replies in time" in external_mode.registration.reason


def test_success_and_failure_of_a_mode_are_reported() -> None:
    external_mode = registered_mode()
    assert fields(external_mode.completed(success=True), COMPLETED) == {
        "timestamp": 0, "result": 0, "nav_state": EXTERNAL_1,
    }  # fmt: skip
    assert fields(external_mode.completed(success=False), COMPLETED)["result"] == 100
    assert new_mode().completed(success=True) == []


def test_a_removed_mode_is_unregistered_and_does_not_reply_to_checks() -> None:
    external_mode = registered_mode()
    ((topic, data),) = external_mode.remove()
    assert (topic, data) == (UNREGISTER, RECORDED[UNREGISTER])
    assert external_mode.on_check_request(ARMING_CHECK, 2.0, can_run=True) == []
    assert external_mode.remove() == []
    assert new_mode().remove() == []


@pytest.mark.parametrize(
    ("level", "enabled"),
    [
        ("velocity", "position velocity altitude climb_rate acceleration attitude rates allocation"),
        ("attitude", "attitude rates allocation"),
        ("body_rate", "rates allocation"),
        ("thrust_and_torque", "allocation"),
        ("direct_actuator", ""),
    ],
)
def test_each_level_enables_its_controller_and_all_controllers_below(level: str, enabled: str) -> None:
    values = fields([controllers_message(EXTERNAL_1, level)], CONTROLLERS)
    flags = {name for name, value in values.items() if name.startswith("flag_") and value}
    assert flags == {f"flag_control_{controller}_enabled" for controller in enabled.split()}


def deferring_mode() -> ExternalMode:
    """A mode that lets PX4 defer failsafes for 6 s; PX4 has not yet replied to the registration."""
    external_mode = ExternalMode(ModeDeclaration(NAME, frozenset(), 6), REQUEST_ID, 0.0)
    external_mode.step(0.0)
    return external_mode


def test_a_registered_mode_sends_px4_the_time_for_deferred_failsafes() -> None:
    _, overrides = deferring_mode().on_reply(ACCEPTING_REPLY, 0.02)
    values = fields([overrides], OVERRIDES)
    assert (values["defer_failsafes"], values["defer_failsafes_timeout_s"]) == (True, 6)
    assert (values["source_type"], values["source_id"]) == (0, EXTERNAL_1)
    assert not values["disable_auto_disarm"]
    without_deferral = new_mode()
    without_deferral.step(0.0)
    assert {topic for topic, _ in without_deferral.on_reply(ACCEPTING_REPLY, 0.02)} == {CONTROLLERS}


def status_of(nav_state: int, defer_state: int) -> dict[str, int]:
    """VehicleStatus of an armed vehicle; `defer_state` as in PX4: 0 disabled, 1 enabled, 2 would failsafe."""
    return {
        "arming_state": 2,
        "can_set_nav_states_mask": MODE_MASK,
        "nav_state": nav_state,
        "failsafe_defer_state": defer_state,
    }


def test_the_overrides_are_sent_again_if_they_are_missing_while_the_mode_is_active() -> None:
    external_mode = deferring_mode()
    external_mode.on_reply(ACCEPTING_REPLY, 0.02)
    assert external_mode.on_status(status_of(HOLD, 0)) == []
    assert fields(external_mode.on_status(status_of(EXTERNAL_1, 0)), OVERRIDES)["defer_failsafes"]
    assert external_mode.on_status(status_of(EXTERNAL_1, 1)) == []
    assert registered_mode().on_status(status_of(EXTERNAL_1, 0)) == []


def test_a_deferred_failsafe_is_reported_only_for_the_active_mode() -> None:
    external_mode = deferring_mode()
    external_mode.on_reply(ACCEPTING_REPLY, 0.02)
    deferred: list[bool] = []
    for nav_state, defer_state in ((EXTERNAL_1, 1), (EXTERNAL_1, 2), (24, 2), (EXTERNAL_1, 2), (HOLD, 0)):
        external_mode.on_status(status_of(nav_state, defer_state))
        deferred.append(external_mode.registration.failsafe_deferred)
    assert deferred == [False, True, False, True, False]


def test_a_lost_mode_reports_no_deferred_failsafe() -> None:
    external_mode = deferring_mode()
    external_mode.on_reply(ACCEPTING_REPLY, 0.02)
    external_mode.on_status(status_of(EXTERNAL_1, 2))
    external_mode.step(10.0)
    assert (external_mode.registration.state, external_mode.registration.failsafe_deferred) == ("lost", False)


def mode_with_executor(executor_id: int = 1) -> ExternalMode:
    """A mode whose registration PX4 has answered with this executor id; -1: no executor."""
    external_mode = ExternalMode(ModeDeclaration(NAME, frozenset(), executor=True), REQUEST_ID, 0.0)
    assert fields(external_mode.step(0.0), REGISTER)["register_mode_executor"]
    external_mode.on_reply({**ACCEPTING_REPLY, "mode_executor_id": executor_id}, 0.02)
    for _ in range(2):
        external_mode.on_check_request(ARMING_CHECK, 0.3, can_run=True)
    return external_mode


def test_a_mode_with_an_executor_permits_arming_and_is_removed_with_the_executor() -> None:
    external_mode = mode_with_executor()
    assert not fields(external_mode.on_check_request(ARMING_CHECK, 0.6, can_run=True), CHECK_REPLY)[
        "mode_req_prevent_arming"
    ]
    assert external_mode.registration.executor is not None
    assert fields(external_mode.remove(), UNREGISTER)["mode_executor_id"] == 1
    assert external_mode.registration.executor is None


def test_without_a_free_executor_the_registration_is_refused() -> None:
    external_mode = mode_with_executor(-1)
    assert (external_mode.registration.state, external_mode.executor) == ("refused", None)
    assert "executor" in external_mode.registration.reason


def test_the_registration_shows_whether_its_executor_is_in_charge() -> None:
    external_mode = mode_with_executor()
    for in_charge in (1, 0):
        external_mode.on_status(
            {**status_of(EXTERNAL_1, 0), "executor_in_charge": in_charge, "arming_state": 2}
        )
        assert external_mode.registration.executor is not None
        assert external_mode.registration.executor.in_charge == bool(in_charge)
    assert registered_mode().registration.executor is None
