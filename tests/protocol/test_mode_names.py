"""Names of flight modes that another program has registered with PX4, on simulated time."""

from __future__ import annotations

from typing import Any

from gcs_server.ros2.external_mode import CHECK_REPLY, CHECK_REQUEST, REGISTER, UNREGISTER
from gcs_server.ros2.message_types import MESSAGES
from tests.protocol.ros2_testbed import Ros2Testbed
from tests.protocol.simulated_testbed import until
from tests.support.dds_samples import base_name

MODE_NAME = "Inspect bridge"


class ModeProgram:
    """A program that registers a mode over ROS 2 and replies to the arming checks."""

    def __init__(self, testbed: Ros2Testbed) -> None:
        self._topics = testbed.topics[0]
        self._publish, self._topics.publish = self._topics.publish, self._publish_and_reply  # type: ignore[method-assign]

    def _send(self, topic: str, message_type: str, **fields: Any) -> None:
        self._topics.send_setpoint(topic, MESSAGES[message_type].encode(fields))

    def _publish_and_reply(self, topic: str, data: bytes) -> None:
        self._publish(topic, data)
        if base_name(topic) == CHECK_REQUEST:
            request = MESSAGES["ArmingCheckRequest"].decode(data)
            self._send(
                CHECK_REPLY, "ArmingCheckReply", request_id=request["request_id"], can_arm_and_run=True
            )

    def register(self) -> None:
        name = tuple(MODE_NAME.encode().ljust(25, b"\0"))
        parts = {"register_arming_check": True, "register_mode": True}
        self._send(REGISTER, "RegisterExtComponentRequest", request_id=7, name=name, **parts)

    def unregister(self) -> None:
        name = tuple(MODE_NAME.encode().ljust(25, b"\0"))
        ids = {"arming_check_id": 0, "mode_id": 23, "mode_executor_id": -1}
        self._send(UNREGISTER, "UnregisterExtComponent", name=name, **ids)


def test_a_mode_of_another_program_has_the_name_that_the_program_gave_it(run_simulated: Any) -> None:
    async def run() -> None:
        testbed = Ros2Testbed(mavlink=True)
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        await until(lambda: "MAVLink" in vehicle.reach.protocols, 10)
        program, names = ModeProgram(testbed), vehicle.mode_names.announced
        program.register()
        await until(lambda: names == {"external_1": MODE_NAME}, 10)
        await vehicle.command.set_mode("external_1")
        assert (vehicle.status.mode, vehicle.status.mode_label) == ("external_1", MODE_NAME)
        assert f"Mode {MODE_NAME}" in "\n".join(event.text for event in vehicle.events.since())
        await vehicle.command.set_mode("hold")
        program.unregister()
        await until(lambda: not names, 10)
        await testbed.close()

    run_simulated(run)


def test_a_mode_that_was_registered_before_the_server_connected_has_its_name_when_the_vehicle_enters_it(
    run_simulated: Any,
) -> None:
    async def run() -> None:
        testbed = Ros2Testbed(mavlink=True)
        vehicle = await testbed.wait_for_vehicle_ready_to_arm()
        await until(lambda: "MAVLink" in vehicle.reach.protocols, 10)
        ModeProgram(testbed).register()
        names = vehicle.mode_names.announced
        await until(lambda: bool(names), 10)
        names.clear()
        await vehicle.command.set_mode("external_1")
        await until(lambda: vehicle.status.mode_label == MODE_NAME, 3)
        await testbed.close()

    run_simulated(run)
