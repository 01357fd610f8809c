"""External modes of several vehicles in the stream process, with a fake clock."""

from __future__ import annotations

from typing import Any

import pytest

from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import (
    CHECK_REPLY,
    CHECK_REQUEST,
    COMPLETED,
    CONTROLLERS,
    REGISTER,
    REGISTER_REPLY,
    SENT_TYPES,
    UNREGISTER,
    ModeDeclaration,
)
from gcs_server.ros2.message_types import MESSAGES
from gcs_server.ros2.mode_executor import COMMAND, MODE_COMPLETED, ExecutorCommand, ExecutorState
from gcs_server.ros2.topics import COMMAND_ACK, STATUS
from gcs_server.streamer.schedule.external_modes import MAX_MODES, READ_TYPES, ExternalModes
from tests.support.dds_samples import server_samples

RECORDED_SAMPLES = server_samples()
TRAJECTORY = "/fmu/in/trajectory_setpoint"
ADDRESS = DdsAddress(0, None, "px4_1")
HOLD, LAND, EXTERNAL_1, EXTERNAL_2 = 4, 18, 23, 24
"""PX4's nav_state of these modes."""
CHECK_PERIOD_S = 0.312
SET_NAV_STATE = 100_001


class Clock:
    now_s = 10.0

    def monotonic_s(self) -> float:
        return self.now_s

    def unix_s(self) -> float:
        return 1_700_000_000.0 + self.now_s

    async def sleep(self, seconds: float) -> None:
        raise AssertionError("the stream process must not sleep here")


class Px4:
    """A fake PX4: answers registrations, and sends an arming check request every 0.3 s."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, dict[str, Any]]] = []
        self.dds_is_open, self.sends_replies, self.next_check_s = True, True, 0.0
        self.is_connected = True
        self.modes: dict[int, str] = {}
        self._to_server: list[tuple[str, bytes]] = []

    def send(self, topic: str, data: bytes) -> None:
        if not self.dds_is_open:
            raise OSError("DDS is not open yet")
        kind = SENT_TYPES.get(topic, "TrajectorySetpoint")
        values = dict(MESSAGES[kind].decode(data))
        # a reply to an arming check has no time, so that it is never too old for PX4
        earliest_us = 0 if topic == CHECK_REPLY else 1_700_000_000_000_000
        assert earliest_us <= values["timestamp"] <= (earliest_us and 2_000_000_000_000_000)
        self.sent.append((topic, values))
        if topic == REGISTER and self.sends_replies:
            nav_state = EXTERNAL_1 + len(self.modes)
            self.modes[nav_state] = bytes(values["name"]).rstrip(b"\0").decode()
            recorded_reply = MESSAGES[READ_TYPES[REGISTER_REPLY]].decode(RECORDED_SAMPLES[REGISTER_REPLY])
            executor = 1 if values["register_mode_executor"] else -1
            reply_fields = {
                "request_id": values["request_id"], "name": values["name"], "mode_executor_id": executor,
                "arming_check_id": nav_state - EXTERNAL_1, "mode_id": nav_state,
            }  # fmt: skip
            self.publish(REGISTER_REPLY, {**recorded_reply, **reply_fields})

    def connected(self) -> bool:
        return self.dds_is_open and self.is_connected

    def take(self) -> list[tuple[str, bytes]]:
        messages, self._to_server = self._to_server, []
        return messages

    def publish(self, topic: str, fields: dict[str, Any]) -> None:
        self._to_server.append((topic, MESSAGES[READ_TYPES[topic]].encode(fields)))

    def publish_bytes(self, topic: str, data: bytes) -> None:
        self._to_server.append((topic, data))

    def send_check_request(self, now_s: float) -> None:
        if self.modes and now_s >= self.next_check_s:
            self.next_check_s = now_s + CHECK_PERIOD_S
            valid = sum(1 << mode - EXTERNAL_1 for mode in self.modes)
            request = {"request_id": int(now_s * 10) % 256, "valid_registrations_mask": valid}
            self.publish(CHECK_REQUEST, request)

    def report_status(self, nav_state: int, *, armed: bool = True) -> None:
        mask = sum(1 << mode for mode in self.modes)
        fields = {"nav_state": nav_state, "arming_state": 2 if armed else 1, "can_set_nav_states_mask": mask}
        self.publish(STATUS, fields)

    def take_sent_topics(self) -> list[str]:
        """The topics of the messages that the server sent since the last call."""
        sent, self.sent = self.sent, []
        return [topic for topic, _ in sent]


class ModesSetup:
    """External modes with a fake PX4, run step by step."""

    def __init__(self) -> None:
        self.clock, self.px4 = Clock(), Px4()
        self.modes = ExternalModes(self.clock, lambda _: self.px4)
        self.server_alive, self.has_stream = True, False

    def register(self, name: str = "Line", vehicle: str = "1", address: DdsAddress = ADDRESS) -> None:
        self.modes.register(vehicle, address, ModeDeclaration(name, frozenset({"attitude"})))

    def run(self, seconds: float) -> None:
        until_s = self.clock.now_s + seconds
        while self.clock.now_s < until_s:
            self.px4.send_check_request(self.clock.now_s)
            self.modes.step(self.clock.now_s, server_alive=self.server_alive, flown=lambda _: self.has_stream)
            self.clock.now_s = round(self.clock.now_s + 0.01, 3)

    def states(self) -> list[tuple[str, str]]:
        return [(mode.name, mode.state) for mode in self.modes.states().get("1", ())]

    def check_replies(self) -> list[bool]:
        """For each check reply that was sent, whether the mode can run."""
        return [values["can_arm_and_run"] for topic, values in self.px4.sent if topic == CHECK_REPLY]


@pytest.fixture
def setup() -> ModesSetup:
    setup = ModesSetup()
    setup.register()
    setup.run(1.0)
    assert setup.states() == [("Line", "registered")]
    setup.px4.sent.clear()
    return setup


def test_without_modes_no_step_is_due() -> None:
    assert ModesSetup().modes.step(10.0, server_alive=True, flown=lambda _: False) == float("inf")


def test_every_check_request_gets_a_reply_within_0_03_s(setup: ModesSetup) -> None:
    setup.run(5.0)
    assert len(setup.check_replies()) == pytest.approx(5.0 / CHECK_PERIOD_S, abs=1.5)
    setup.px4.sent.clear()
    setup.px4.next_check_s = float("inf")
    setup.px4.publish(CHECK_REQUEST, {"request_id": 3})
    setup.run(0.03)
    assert setup.check_replies() == [True]


def test_while_the_event_loop_is_blocked_the_replies_report_that_the_mode_cannot_run(
    setup: ModesSetup,
) -> None:
    setup.server_alive = False
    setup.run(1.0)
    assert set(setup.check_replies()) == {False}
    setup.px4.sent.clear()
    setup.server_alive = True
    setup.run(1.0)
    assert set(setup.check_replies()) == {True}


def test_without_a_stream_the_vehicle_is_stopped_in_the_mode(setup: ModesSetup) -> None:
    setup.px4.report_status(EXTERNAL_1)
    setup.run(0.2)
    assert {CONTROLLERS, TRAJECTORY} <= set(setup.px4.take_sent_topics())
    setup.has_stream = True
    setup.px4.report_status(EXTERNAL_1)
    setup.run(1.0)
    assert set(setup.px4.take_sent_topics()) == {CHECK_REPLY}


@pytest.mark.parametrize(("nav_state", "armed"), [(HOLD, True), (EXTERNAL_1, False), (EXTERNAL_2, True)])
def test_in_other_modes_or_while_disarmed_no_setpoint_is_sent(
    setup: ModesSetup, nav_state: int, armed: bool
) -> None:
    setup.px4.report_status(nav_state, armed=armed)
    setup.run(1.0)
    assert set(setup.px4.take_sent_topics()) == {CHECK_REPLY}


def test_modes_are_registered_and_removed_one_after_another(setup: ModesSetup) -> None:
    setup.register("Square")
    setup.register("Circle")
    setup.run(3.0)
    assert [state for _, state in setup.states()] == ["registered"] * 3
    setup.px4.sent.clear()
    for name in ("Line", "Square", "Circle"):
        setup.modes.unregister("1", name)
    setup.run(0.02)
    assert setup.px4.take_sent_topics().count(UNREGISTER) == 1
    setup.run(1.0)
    assert setup.px4.take_sent_topics().count(UNREGISTER) == 2
    assert setup.modes.states() == {}


def test_a_repeated_name_a_second_ros_2_link_and_too_many_modes_are_refused(setup: ModesSetup) -> None:
    with pytest.raises(ValueError, match="already registered"):
        setup.register()
    with pytest.raises(ValueError, match="another ROS 2 link"):
        setup.register("Other", address=DdsAddress(1, None, ""))
    for n in range(MAX_MODES - 1):
        setup.register(f"Mode {n}")
    with pytest.raises(ValueError, match="4 modes"):
        setup.register("One more")


def test_a_lost_mode_can_be_registered_again(setup: ModesSetup) -> None:
    setup.px4.modes.clear()
    setup.run(2.0)
    assert setup.states() == [("Line", "lost")]
    setup.register()
    setup.run(1.0)
    assert setup.states() == [("Line", "registered")]


def test_a_registration_is_requested_only_when_dds_has_connected_px4() -> None:
    setup = ModesSetup()
    setup.px4.is_connected = False
    setup.register()
    setup.run(8.0)
    assert setup.states() == [("Line", "registering")]
    assert setup.px4.sent == []
    setup.px4.is_connected = True
    setup.run(1.0)
    assert setup.states() == [("Line", "registered")]


def test_a_registration_that_dds_never_connects_is_refused_with_the_reason() -> None:
    setup = ModesSetup()
    setup.px4.is_connected = False
    setup.register()
    setup.run(12.0)
    (mode,) = setup.modes.states()["1"]
    assert mode.state == "refused"
    assert "DDS did not connect" in mode.reason
    assert setup.px4.sent == []


def test_a_registration_waits_for_dds_and_is_refused_without_a_reply() -> None:
    setup = ModesSetup()
    setup.px4.dds_is_open = setup.px4.sends_replies = False
    setup.register()
    setup.run(2.0)
    setup.px4.dds_is_open = True
    setup.run(4.5)
    assert setup.states() == [("Line", "registering")]
    setup.run(1.0)
    assert setup.states() == [("Line", "refused")]


def test_the_completion_of_a_mode_is_sent_only_for_its_vehicle_and_external_mode(setup: ModesSetup) -> None:
    setup.modes.complete("1", "external_2", success=True)
    setup.modes.complete("2", "external_1", success=True)
    assert setup.px4.take_sent_topics() == []
    setup.modes.complete("1", "external_1", success=False)
    assert [(topic, fields["result"]) for topic, fields in setup.px4.sent] == [(COMPLETED, 100)]  # failure


def test_a_malformed_message_is_skipped(setup: ModesSetup) -> None:
    setup.px4.publish_bytes(CHECK_REQUEST, b"\0\1")
    setup.px4.publish_bytes(STATUS, b"")
    setup.run(1.0)
    assert setup.states() == [("Line", "registered")]


def test_a_fault_of_one_vehicle_does_not_affect_the_other_vehicles(
    setup: ModesSetup, caplog: pytest.LogCaptureFixture
) -> None:
    class BrokenPx4(Px4):
        def take(self) -> list[tuple[str, bytes]]:
            raise RuntimeError("broken")

    broken_px4 = BrokenPx4()
    setup.modes._open_port = lambda _: broken_px4
    setup.register("Other", vehicle="2", address=DdsAddress(0, None, "px4_2"))
    setup.run(2.0)
    assert setup.modes.states().keys() == {"1"}
    assert "the modes of vehicle 2 failed" in caplog.text
    assert len(setup.check_replies()) >= 5


def test_closing_unregisters_all_modes(setup: ModesSetup) -> None:
    setup.modes.close()
    assert setup.px4.take_sent_topics() == [UNREGISTER]
    assert setup.modes.states() == {}


def test_the_modes_of_a_forgotten_vehicle_are_unregistered(setup: ModesSetup) -> None:
    setup.modes.forget("1")
    setup.modes.forget("unknown")
    setup.run(0.5)
    assert setup.px4.take_sent_topics() == [UNREGISTER]


def test_the_command_of_an_executor_is_sent_and_its_outcome_reported() -> None:
    setup = ModesSetup()
    setup.modes.forget("1")
    setup.px4.modes.clear()
    setup.run(0.5)
    setup.modes.register("1", ADDRESS, ModeDeclaration("Line", frozenset(), executor=True))
    setup.run(1.0)
    land = ExecutorCommand(7, SET_NAV_STATE, (float(LAND), *(float("nan"),) * 6))
    executor_status = {
        "nav_state": EXTERNAL_1,
        "arming_state": 2,
        "executor_in_charge": 1,
        "can_set_nav_states_mask": 1 << EXTERNAL_1,
    }
    setup.px4.publish(STATUS, executor_status)
    setup.run(0.1)
    setup.px4.sent.clear()
    setup.modes.execute("1", "external_1", land)
    setup.modes.execute("1", "external_2", land)
    setup.modes.execute("2", "external_1", land)
    setup.run(0.35)
    commands = [fields for topic, fields in setup.px4.sent if topic == COMMAND]
    assert [fields["source_component"] for fields in commands] == [1001, 1001]
    setup.px4.publish(COMMAND_ACK, {"command": SET_NAV_STATE, "target_component": 1001})
    setup.px4.publish(STATUS, {**executor_status, "nav_state": LAND})
    setup.px4.publish(MODE_COMPLETED, {"nav_state": LAND})
    setup.run(0.1)
    setup.px4.sent.clear()
    setup.run(1.0)
    (registration,) = setup.modes.states()["1"]
    assert registration.executor == ExecutorState(True, LAND, 7, "accepted")
    assert COMMAND not in setup.px4.take_sent_topics()
