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
    OVERRIDES,
    REGISTER,
    REPLY,
    SENT_TYPES,
    UNREGISTER,
    ExternalMode,
    Message,
    ModeDeclaration,
    controllers_message,
)
from gcs_server.ros2.message_types import MESSAGES, Values
from tests.support.dds_samples import recorded

RECORDED = recorded()
NAME, REQUEST_ID = "Fly Mode", 2199029506047954537
"""Values of the recorded registration."""
REGISTERED: Values = MESSAGES["RegisterExtComponentReply"].decode(RECORDED[REPLY])
CHECK: Values = MESSAGES["ArmingCheckRequest"].decode(RECORDED[CHECK_REQUEST])
MASK = 1 << 23


def mode(now_s: float = 0.0) -> ExternalMode:
    return ExternalMode(ModeDeclaration(NAME, frozenset({"attitude", "local_position"})), REQUEST_ID, now_s)


def registered(now_s: float = 0.0) -> ExternalMode:
    made = mode(now_s)
    made.step(now_s)
    made.on_reply(REGISTERED, now_s)
    for _ in range(2):
        made.on_check_request(CHECK, now_s, can_run=True)
    return made


def fields(messages: list[Message], topic: str) -> dict[str, Any]:
    """Fields of the only message, which has this topic."""
    ((sent, data),) = messages
    assert sent == topic
    return dict(MESSAGES[SENT_TYPES[topic]].decode(data))


def test_the_registration_request_equals_the_recorded_one() -> None:
    ((topic, data),) = mode().step(0.0)
    assert topic == REGISTER
    assert RECORDED[REGISTER].removeprefix(data).strip(b"\0") == b"", (
        "differs in more than the padding of DDS"
    )


def test_a_mode_is_registered_once_px4_has_evaluated_an_answer() -> None:
    made = mode()
    made.step(0.0)
    controllers = fields(made.on_reply(REGISTERED, 0.02), CONTROLLERS)
    assert controllers["source_id"] == 23
    assert controllers["flag_control_position_enabled"]
    assert controllers["flag_control_allocation_enabled"]
    assert (made.registration.state, made.registration.mode) == ("registering", None)
    made.on_check_request(CHECK, 0.3, can_run=True)
    assert made.registration.state == "registering"
    made.on_check_request(CHECK, 0.6, can_run=True)
    assert (made.registration.state, made.registration.mode) == ("registered", "external_1")
    assert made.registration.nav_state == 23


def test_each_arming_check_is_answered_at_once_with_the_requirements() -> None:
    reply = fields(registered().on_check_request(CHECK, 0.9, can_run=True), CHECK_REPLY)
    assert (reply["request_id"], reply["registration_id"]) == (115, 0)
    needs = {name for name, value in reply.items() if name.startswith("mode_req_") and value}
    assert needs == {"mode_req_attitude", "mode_req_local_position", "mode_req_prevent_arming"}
    assert reply["can_arm_and_run"]
    assert not fields(registered().on_check_request(CHECK, 0.9, can_run=False), CHECK_REPLY)[
        "can_arm_and_run"
    ]


def test_a_mode_that_is_not_ready_prevents_arming_but_never_interrupts_a_flight() -> None:
    made = registered()
    made.ready = False
    status = {"nav_state": 4, "arming_state": 1, "failsafe_defer_state": 0, "can_set_nav_states_mask": MASK}
    for armed in (False, True):
        made.on_status({**status, "arming_state": 2 if armed else 1})
        reply = fields(made.on_check_request(CHECK, 0.9, can_run=True), CHECK_REPLY)
        assert reply["can_arm_and_run"] == armed


def test_a_check_reply_differs_from_the_recorded_one_only_in_the_declared_requirements() -> None:
    theirs = MESSAGES["ArmingCheckReply"].decode(RECORDED[CHECK_REPLY])
    ours = fields(
        registered().on_check_request({"request_id": theirs["request_id"]}, 0.9, can_run=True), CHECK_REPLY
    )
    assert {name for name in ours if ours[name] != theirs[name]} == {"mode_req_prevent_arming"}


def test_another_version_of_px4s_interface_is_refused_and_named() -> None:
    made = mode()
    made.step(0.0)
    removal = fields(made.on_reply({**REGISTERED, "px4_ros2_api_version": 2}, 0.02), UNREGISTER)
    assert removal["mode_id"] == 23
    assert made.registration.state == "refused"
    assert "has version 2, but this server knows version 1; use PX4 v1.16" in made.registration.why


def test_without_a_reply_registration_is_refused_after_five_requests() -> None:
    made, sent, now_s = mode(), 0, 0.0
    while made.registration.state == "registering" and now_s < 20.0:
        sent += len(made.step(now_s))
        now_s += 0.02
    assert sent == ATTEMPTS
    assert now_s == pytest.approx(5.0, abs=0.1)
    assert made.registration.state == "refused"
    assert "did not answer" in made.registration.why
    assert made.step(now_s + 10) == []
    assert made.on_check_request(CHECK, now_s, can_run=True) == []


@pytest.mark.parametrize(
    "refusal",
    [
        {"success": False, "arming_check_id": -1, "mode_id": -1},
        {"success": False, "arming_check_id": 0, "mode_id": 0},
        {"mode_id": 4},
    ],
)
def test_a_refusal_ends_the_registration(refusal: dict[str, Any]) -> None:
    made = mode()
    made.step(0.0)
    assert made.on_reply({**REGISTERED, **refusal}, 0.02) == []
    assert made.registration.state == "refused"
    assert "COM_MODE_ARM_CHK" in made.registration.why
    assert made.step(5.0) == []


@pytest.mark.parametrize("other", [{"request_id": 7}, {"name": (79, *[0] * 24)}])
def test_a_reply_to_another_program_is_ignored(other: dict[str, Any]) -> None:
    made = mode()
    made.step(0.0)
    assert made.on_reply({**REGISTERED, **other}, 0.02) == []
    assert made.registration.nav_state is None


def test_a_second_registration_by_a_repeated_request_is_removed() -> None:
    made = registered()
    again = {**REGISTERED, "arming_check_id": 1, "mode_id": 24}
    removal = fields(made.on_reply(again, 1.2), UNREGISTER)
    assert (removal["arming_check_id"], removal["mode_id"], removal["mode_executor_id"]) == (1, 24, -1)
    assert made.registration.mode == "external_1"


def test_without_arming_check_requests_the_mode_is_lost() -> None:
    made = registered()
    assert made.step(LOST_S - 0.01) == []
    assert made.registration.state == "registered"
    made.step(LOST_S + 0.01)
    assert made.registration.state == "lost"
    assert "restarted" in made.registration.why
    assert made.registration.mode is None
    assert made.on_check_request(CHECK, 5.0, can_run=True) == []
    assert made.completed(success=True) == []


def test_a_mode_that_px4_has_removed_is_lost() -> None:
    made = registered()
    made.on_status({"arming_state": 1, "can_set_nav_states_mask": 0, "nav_state": 4})
    assert made.registration.state == "registered", "the status is older than the registration"
    made.on_status({"arming_state": 1, "can_set_nav_states_mask": MASK, "nav_state": 4})
    made.on_status({"arming_state": 1, "can_set_nav_states_mask": MASK, "nav_state": 4})
    assert made.registration.state == "registered"
    made.on_status({"arming_state": 1, "can_set_nav_states_mask": 0, "nav_state": 4})
    assert made.registration.state == "lost"
    assert "no answers in time" in made.registration.why


def test_success_and_failure_of_a_mode_are_reported() -> None:
    made = registered()
    assert fields(made.completed(success=True), COMPLETED) == {
        "timestamp": 0, "result": 0, "nav_state": 23,
    }  # fmt: skip
    assert fields(made.completed(success=False), COMPLETED)["result"] == 100
    assert mode().completed(success=True) == []


def test_a_removed_mode_is_unregistered_as_recorded_and_answers_nothing() -> None:
    made = registered()
    ((topic, data),) = made.remove()
    assert (topic, data) == (UNREGISTER, RECORDED[UNREGISTER])
    assert made.on_check_request(CHECK, 2.0, can_run=True) == []
    assert made.remove() == []
    assert mode().remove() == []


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
def test_each_level_enables_its_controller_and_all_below(level: str, enabled: str) -> None:
    values = fields([controllers_message(23, level)], CONTROLLERS)
    flags = {name for name, value in values.items() if name.startswith("flag_") and value}
    assert flags == {f"flag_control_{each}_enabled" for each in enabled.split()}


def deferring() -> ExternalMode:
    """Registered as mode 23; PX4 may defer failsafes for 6 s."""
    made = ExternalMode(ModeDeclaration(NAME, frozenset(), 6), REQUEST_ID, 0.0)
    made.step(0.0)
    return made


def test_a_registered_mode_sends_px4_the_time_for_deferred_failsafes() -> None:
    _, overrides = deferring().on_reply(REGISTERED, 0.02)
    values = fields([overrides], OVERRIDES)
    assert (values["defer_failsafes"], values["defer_failsafes_timeout_s"]) == (True, 6)
    assert (values["source_type"], values["source_id"]) == (0, 23)
    assert not values["disable_auto_disarm"]
    plain = mode()
    plain.step(0.0)
    assert {topic for topic, _ in plain.on_reply(REGISTERED, 0.02)} == {CONTROLLERS}


def status_of(nav_state: int, defer_state: int) -> dict[str, int]:
    mask = 1 << 23
    return {
        "arming_state": 2,
        "can_set_nav_states_mask": mask,
        "nav_state": nav_state,
        "failsafe_defer_state": defer_state,
    }


def test_the_overrides_are_repeated_if_px4_flies_the_mode_without_them() -> None:
    made = deferring()
    made.on_reply(REGISTERED, 0.02)
    assert made.on_status(status_of(4, 0)) == []
    assert fields(made.on_status(status_of(23, 0)), OVERRIDES)["defer_failsafes"]
    assert made.on_status(status_of(23, 1)) == []
    assert registered().on_status(status_of(23, 0)) == []


def test_a_deferred_failsafe_is_reported_only_for_the_mode_that_flies() -> None:
    made = deferring()
    made.on_reply(REGISTERED, 0.02)
    seen: list[bool] = []
    for nav_state, defer_state in ((23, 1), (23, 2), (24, 2), (23, 2), (4, 0)):
        made.on_status(status_of(nav_state, defer_state))
        seen.append(made.registration.failsafe_deferred)
    assert seen == [False, True, False, True, False]


def test_a_lost_mode_defers_nothing() -> None:
    made = deferring()
    made.on_reply(REGISTERED, 0.02)
    made.on_status(status_of(23, 2))
    made.step(10.0)
    assert (made.registration.state, made.registration.failsafe_deferred) == ("lost", False)


def with_executor(executor_id: int = 1) -> ExternalMode:
    """The answer to a registration with an executor of this id."""
    made = ExternalMode(ModeDeclaration(NAME, frozenset(), executor=True), REQUEST_ID, 0.0)
    assert fields(made.step(0.0), REGISTER)["register_mode_executor"]
    made.on_reply({**REGISTERED, "mode_executor_id": executor_id}, 0.02)
    for _ in range(2):
        made.on_check_request(CHECK, 0.3, can_run=True)
    return made


def test_a_mode_with_an_executor_permits_arming_and_is_removed_with_it() -> None:
    made = with_executor()
    assert not fields(made.on_check_request(CHECK, 0.6, can_run=True), CHECK_REPLY)["mode_req_prevent_arming"]
    assert made.registration.executor is not None
    assert fields(made.remove(), UNREGISTER)["mode_executor_id"] == 1
    assert made.registration.executor is None


def test_without_a_free_executor_the_registration_is_refused() -> None:
    made = with_executor(-1)
    assert (made.registration.state, made.executor) == ("refused", None)
    assert "executor" in made.registration.why


def test_the_status_shows_whether_its_executor_is_in_charge() -> None:
    made = with_executor()
    for in_charge in (1, 0):
        made.on_status({**status_of(23, 0), "executor_in_charge": in_charge, "arming_state": 2})
        assert made.registration.executor is not None
        assert made.registration.executor.in_charge == bool(in_charge)
    assert registered().registration.executor is None
