"""External modes over ROS 2: registration, arming, flight, loss, and replacement of an internal mode."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest

from tests.support.ros2_vehicle import Ros2Vehicle
from vehicle_sim.fleet import DEFAULT_BOOT_TIME_UNIX_S
from vehicle_sim.px4_version import V1_16, V1_17, Px4Version
from vehicle_sim.ros2.messages import MESSAGES

REGISTER, UNREGISTER = "/fmu/in/register_ext_component_request", "/fmu/in/unregister_ext_component"
CHECK_REQUEST, CHECK_REPLY = "/fmu/out/arming_check_request", "/fmu/in/arming_check_reply"
CONTROL_CONFIG, CONFIG_OVERRIDES = "/fmu/in/config_control_setpoints", "/fmu/in/config_overrides_request"
STATUS, COMPLETED = "/fmu/out/vehicle_status", "/fmu/out/mode_completed"
EXECUTOR_COMMAND = "/fmu/in/vehicle_command_mode_executor"
NAN3 = (math.nan, math.nan, math.nan)
EXTERNAL1, HOLD, RTL, TAKEOFF, LAND = 23, 4, 5, 17, 18
SET_MODE, ARM, SET_NAV_STATE = 176, 400, 100_001
TRAJECTORY_CONTROLLERS = {
    f"flag_control_{name}_enabled": True
    for name in [
        "position",
        "velocity",
        "altitude",
        "climb_rate",
        "acceleration",
        "attitude",
        "rates",
        "allocation",
    ]
}
POSITION_SETPOINT: tuple[str, Mapping[str, Any]] = (
    "/fmu/in/trajectory_setpoint",
    {"position": (3.0, 0.0, -4.0), "velocity": NAN3, "acceleration": NAN3, "yaw": 0.0, "yawspeed": math.nan},
)


class Component:
    """A program that has registered a mode and replies to the vehicle's arming checks.

    Args:
        controllers: `config_control_setpoints` of the mode.
        px4: the vehicle's version of PX4.
        age_s: age of the replies; None: their time is 0.
        synchronized: whether the vehicle's time is Unix time.
        request: other fields of the registration.
    """

    def __init__(
        self,
        *,
        controllers: Mapping[str, bool] = TRAJECTORY_CONTROLLERS,
        px4: Px4Version = V1_16,
        age_s: float | None = None,
        synchronized: bool = False,
        **request: Any,
    ) -> None:
        parameters = {"UXRCE_DDS_SYNCT": float(synchronized)}
        self.vehicle = Ros2Vehicle(
            px4=px4, parameters=parameters, time_since_boot_s=8.0 if synchronized else 4.0
        )
        self._age_s, self._offset_s = age_s, DEFAULT_BOOT_TIME_UNIX_S if synchronized else 0.0
        self.requires = "mode_req_local_position"
        self.can_run = self.replies_to_checks = True
        self._read_count = 0
        self.vehicle.send(
            REGISTER, {"name": "Mine", "register_arming_check": True, "register_mode": True} | request
        )
        self.run(0.1)
        self.vehicle.send(CONTROL_CONFIG, {"source_id": EXTERNAL1} | dict(controllers))
        self.run(1.0)

    def run(self, seconds: float, *setpoints: tuple[str, Mapping[str, Any]]) -> None:
        for _ in range(round(seconds / 0.02)):
            for _, topic, fields in self.vehicle.received_messages[self._read_count :]:
                if topic == CHECK_REQUEST and self.replies_to_checks:
                    self._reply(fields["request_id"])
            self._read_count = len(self.vehicle.received_messages)
            for topic, fields in setpoints:
                self.vehicle.send(topic, fields)
            self.vehicle.run(0.02)

    def _reply(self, request_id: int) -> None:
        reply = {"request_id": request_id, "can_arm_and_run": self.can_run, self.requires: True}
        if self._age_s is not None:
            reply["timestamp"] = int((self._offset_s + self.vehicle.sim.time_s - self._age_s) * 1e6)
        self.vehicle.send(CHECK_REPLY, reply)

    def select_mode(self, main_mode: float, sub_mode: float = 0.0) -> None:
        """Commands PX4's main and sub mode: 4, 3 is Hold; 4, 11 is the external mode; 6 is Offboard."""
        self.vehicle.command(SET_MODE, 1.0, main_mode, sub_mode)

    def fly_external_mode(self) -> None:
        """Takes off and flies in the external mode."""
        self.vehicle.command(ARM, 1.0)
        self.vehicle.command(22, *[math.nan] * 7)
        self.run(9.0)
        self.select_mode(4.0, 11.0)
        self.run(4.0, POSITION_SETPOINT)

    def send_executor_command(self, number: int, *parameters: float) -> None:
        """Sends a command of the mode's executor."""
        self.vehicle.command(
            number, *parameters, topic=EXECUTOR_COMMAND, source_component=1001, from_external=False
        )

    @property
    def status(self) -> dict[str, Any]:
        """The next VehicleStatus; the vehicle sends it twice a second."""
        self.run(0.6)
        return self.vehicle.newest_fields(STATUS)


def test_a_mode_flies_its_setpoints_and_keeps_the_last_setpoint():
    component = Component()
    component.fly_external_mode()
    assert component.status["nav_state"] == EXTERNAL1
    component.run(3.0)
    north, east, down = component.vehicle.position_ned_m
    assert math.dist((north, east, down), (3.0, 0.0, -4.0)) < 0.3
    assert component.status["nav_state"] == EXTERNAL1


def test_a_mode_that_stops_replying_is_replaced_by_return_until_it_replies_again():
    component = Component()
    component.fly_external_mode()
    component.replies_to_checks = False
    component.run(1.6)
    status = component.status
    assert (status["nav_state"], status["nav_state_user_intention"], status["failsafe"]) == (
        RTL,
        EXTERNAL1,
        True,
    )
    component.replies_to_checks = True
    assert component.status["nav_state"] == EXTERNAL1


@pytest.mark.story
def test_the_vehicle_returns_if_a_mode_cannot_run_and_the_mode_cannot_be_selected_again():
    component = Component()
    component.fly_external_mode()
    component.can_run = False
    component.run(0.5)
    assert component.status["nav_state"] == RTL
    component.select_mode(4.0, 3.0)
    component.run(0.2)
    component.select_mode(4.0, 11.0)
    component.run(0.2)
    assert component.vehicle.acks()[-1] == (SET_MODE, 1)
    assert component.status["nav_state"] == HOLD


@pytest.mark.story
def test_the_vehicle_returns_if_its_mode_is_unregistered_in_flight():
    component = Component()
    component.fly_external_mode()
    component.vehicle.send(UNREGISTER, name="Mine", mode_id=EXTERNAL1, mode_executor_id=-1)
    assert component.status["nav_state"] == RTL


def test_arming_is_denied_in_a_mode_that_does_not_reply():
    component = Component()
    component.select_mode(4.0, 11.0)
    component.replies_to_checks = False
    component.run(2.0)
    component.vehicle.command(ARM, 1.0)
    component.run(0.1)
    assert component.vehicle.acks()[-1] == (ARM, 1)


@pytest.mark.story
def test_without_controllers_the_motors_keep_their_signals():
    component = Component(controllers={})
    component.vehicle.command(ARM, 1.0)
    component.vehicle.command(22, *[math.nan] * 7)
    component.run(9.0)
    component.select_mode(4.0, 11.0)
    component.run(0.2)
    simulation = component.vehicle.sim.simulation
    before = simulation.motors_us[0].copy()
    component.run(0.2)
    assert (simulation.motors_us[0] == before).all()
    flags = component.vehicle.newest_fields("/fmu/out/vehicle_control_mode")
    assert not flags["flag_control_allocation_enabled"]


def test_after_an_external_mode_offboard_has_its_own_setpoint_type():
    component = Component()
    offboard = ("/fmu/in/offboard_control_mode", {"body_rate": True})
    for messages, rates in (((), False), ((offboard,), True)):
        component.select_mode(4.0, 11.0)
        component.run(0.4, *messages)
        flags = component.vehicle.newest_fields("/fmu/out/vehicle_control_mode")
        assert flags["flag_control_position_enabled"]
        component.select_mode(6.0)
        component.run(0.6)
        flags = component.vehicle.newest_fields("/fmu/out/vehicle_control_mode")
        assert flags["flag_control_offboard_enabled"]
        assert (flags["flag_control_rates_enabled"], flags["flag_control_attitude_enabled"]) == (rates, False)


@pytest.mark.story
def test_a_mode_that_replaces_return_is_flown_until_it_stops_replying():
    component = Component(enable_replace_internal_mode=True, replace_internal_mode=RTL)
    component.vehicle.command(ARM, 1.0)
    component.vehicle.command(22, *[math.nan] * 7)
    component.run(9.0)
    component.vehicle.command(20)  # NAV_RETURN_TO_LAUNCH
    assert component.status["nav_state"] == EXTERNAL1
    component.replies_to_checks = False
    component.run(1.5)
    status = component.status
    assert (status["nav_state"], status["nav_state_user_intention"]) == (RTL, RTL)
    assert not status["can_set_nav_states_mask"] >> EXTERNAL1 & 1


def test_an_executor_takes_off_and_stays_in_the_take_off_mode():
    component = Component(register_mode_executor=True)
    component.send_executor_command(ARM, 1.0)
    component.run(0.1)
    assert component.vehicle.acks()[-1] == (ARM, 1), "armed although the executor is not in charge"
    component.select_mode(4.0, 11.0)
    component.run(0.1)
    component.send_executor_command(ARM, 1.0)
    component.send_executor_command(22, *[math.nan] * 7)
    component.run(12.0)
    status = component.status
    assert (status["nav_state"], status["executor_in_charge"]) == (TAKEOFF, 1)
    assert [message["nav_state"] for message in component.vehicle.all_fields(COMPLETED)] == [TAKEOFF]
    component.select_mode(4.0, 3.0)
    assert component.status["executor_in_charge"] == 0


@pytest.mark.story
def test_the_override_of_auto_disarm_keeps_a_landed_vehicle_armed_until_it_is_withdrawn():
    component = Component(register_mode_executor=True)
    component.vehicle.send(CONFIG_OVERRIDES, disable_auto_disarm=True, source_type=1, source_id=1)
    component.fly_external_mode()
    component.send_executor_command(SET_NAV_STATE, float(LAND))
    component.run(20.0)
    assert component.status["arming_state"] == 2
    component.vehicle.send(CONFIG_OVERRIDES, source_type=1, source_id=1)
    component.run(1.0)
    assert component.status["arming_state"] == 2
    component.run(0.6)
    status = component.status
    assert (status["arming_state"], status["nav_state"]) == (1, EXTERNAL1)


# --- PX4 v1.17 -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("px4", "age_s", "counts"),
    [(V1_16, 3.0, True), (V1_17, 3.0, False), (V1_17, 0.35, False), (V1_17, 0.25, True),
     (V1_17, -3600.0, True), (V1_17, None, True)],
)  # fmt: skip
def test_a_reply_that_is_too_old_for_the_version_of_px4_does_not_count(px4, age_s, counts):
    component = Component(px4=px4, age_s=age_s)
    component.run(4.0)
    assert bool(component.vehicle.newest_fields(STATUS)["can_set_nav_states_mask"] >> EXTERNAL1 & 1) is counts


def test_the_times_of_replies_are_the_programs_unix_time_if_time_is_synchronized():
    component = Component(px4=V1_17, age_s=0.2, synchronized=True)
    component.run(4.0)
    assert component.vehicle.newest_fields(STATUS)["can_set_nav_states_mask"] >> EXTERNAL1 & 1


def test_a_request_names_the_registrations_that_answer():
    component = Component(px4=V1_17)
    component.vehicle.send(REGISTER, {"name": "Silent", "register_arming_check": True, "register_mode": True})
    component.run(1.0)
    assert component.vehicle.newest_fields(CHECK_REQUEST)["valid_registrations_mask"] == 0b11
    component.run(4.0)
    assert component.vehicle.newest_fields(CHECK_REQUEST)["valid_registrations_mask"] == 0b01
    component.fly_external_mode()
    component.replies_to_checks = False
    component.run(2.0)
    assert component.vehicle.newest_fields(CHECK_REQUEST)["valid_registrations_mask"] == 0
    component.replies_to_checks = True
    component.run(1.0)
    assert component.vehicle.newest_fields(CHECK_REQUEST)["valid_registrations_mask"] == 1
    assert component.status["nav_state"] == EXTERNAL1


def test_a_program_for_v1_16_registers_with_success_and_is_dropped_by_v1_17():
    component = Component(px4=V1_17)
    component.replies_to_checks = False
    old_reply = MESSAGES["1.16"]["ArmingCheckReply"]
    answered = 0
    for _ in range(80):
        for _, topic, fields in component.vehicle.received_messages[answered:]:
            if topic == CHECK_REQUEST:
                reply = old_reply.encode({"request_id": fields["request_id"], "can_arm_and_run": True})
                component.vehicle.send_bytes("/fmu/in/arming_check_reply", reply)
        answered = len(component.vehicle.received_messages)
        component.vehicle.run(0.05)
    assert not component.status["can_set_nav_states_mask"] >> EXTERNAL1 & 1
    assert not component.vehicle.reports


def test_a_mode_can_require_a_relaxed_global_position():
    component = Component(px4=V1_17)
    component.requires = "mode_req_global_position_relaxed"
    component.run(1.0)
    flags = component.vehicle.newest_fields("/fmu/out/failsafe_flags")
    assert flags["mode_req_global_position_relaxed"] == 1 << EXTERNAL1
    assert flags["mode_req_local_position"] >> EXTERNAL1 & 1 == 0


@pytest.mark.parametrize(("px4", "expected"), [(V1_16, HOLD), (V1_17, EXTERNAL1)])
def test_disarming_selects_the_mode_that_the_executor_in_charge_owns(px4, expected):
    component = Component(px4=px4, register_mode_executor=True)
    component.select_mode(4.0, 11.0)
    component.run(0.5)
    component.send_executor_command(ARM, 1.0)
    component.run(0.5)
    component.send_executor_command(SET_MODE, 1.0, 4.0, 3.0)
    component.run(0.5)
    assert (component.status["nav_state"], component.status["executor_in_charge"]) == (HOLD, 1)
    component.send_executor_command(ARM, 0.0)
    component.run(0.5)
    status = component.status
    assert (status["arming_state"], status["nav_state"]) == (1, expected)
