"""External modes of one vehicle over ROS 2: received topics, their queues, and what PX4 publishes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, Final

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.external_modes.arming_checks import MAX_EVENTS, NONE, ArmingCheckReply
from vehicle_sim.external_modes.registry import (
    DENIED_WHILE_ARMED,
    NAME_LENGTH,
    Registration,
    RegistrationReply,
)
from vehicle_sim.external_modes.requirements import REPORTED
from vehicle_sim.external_modes.slots import Controllers, Overrides
from vehicle_sim.ros2.topics import topics_of

REGISTRATION_REPLY: Final = "/fmu/out/register_ext_component_reply"
ARMING_CHECK_REQUEST: Final = "/fmu/out/arming_check_request"
MODE_COMPLETED: Final = "/fmu/out/mode_completed"
API_VERSION: Final = 1
"""`px4_ros2_api_version` of PX4 v1.16 and v1.17, which accept requests of every version."""
MODE_SOURCE, EXECUTOR_SOURCE = 0, 1
"""ConfigOverrides.source_type."""
LAND_COMPLETED_EVERY_US: Final = 50_000
CONTROLLERS: Final = {f"flag_control_{each.name}_enabled": each.name for each in fields(Controllers)}
"""Field of `Controllers`, by field of `config_control_setpoints`."""
Values = Mapping[str, Any]
Publish = Callable[[str, Values], None]
"""`publish(topic, fields)`: publishes a message with the current time."""


class ExternalModeTopics:
    """PX4's side of registration, arming checks, configuration and completion of external modes.

    Args:
        autopilot: the vehicle's autopilot.
        publish: see `Publish`.
        offset_us: added to times since boot in the times that programs send and receive.
    """

    def __init__(self, autopilot: Autopilot, publish: Publish, offset_us: int) -> None:
        self._commander = autopilot.commander
        self._external = autopilot.commander.external
        self._view = autopilot.view
        self._publish, self._offset_us = publish, offset_us
        check_request = topics_of(autopilot.view.px4).messages["ArmingCheckRequest"]
        self._sends_mask = "valid_registrations_mask" in check_request.index
        # Received messages that wait for the commander; the queues are as long as PX4's.
        self._registrations: deque[Values] = deque(maxlen=2)
        self._removals: deque[Values] = deque(maxlen=1)
        self._overrides: deque[Values] = deque(maxlen=4)
        self._configurations: deque[Values] = deque(maxlen=1)
        self._completed_modes = _CompletedModes(autopilot)
        self.receivers: dict[str, Callable[[Values], None]] = {
            "/fmu/in/register_ext_component_request": self._registrations.append,
            "/fmu/in/unregister_ext_component": self._removals.append,
            "/fmu/in/config_overrides_request": self._overrides.append,
            "/fmu/in/config_control_setpoints": self._configurations.append,
            "/fmu/in/arming_check_reply": self._receive_check_reply,
            "/fmu/in/mode_completed": self._echo_completion,
        }

    def cycle(self) -> None:
        """Runs one cycle of the commander."""
        commander, external = self._commander, self._external
        request_id = external.update(self._view.time_boot_us(), failsafe_acts=commander.in_failsafe)
        if request_id is not None:
            mask = {"valid_registrations_mask": external.checks.valid_mask} if self._sends_mask else {}
            self._publish(ARMING_CHECK_REQUEST, {"request_id": request_id, **mask})
        if commander.armed and not self._view.choice("COM_MODE_ARM_CHK"):
            while self._registrations:
                self._reply(self._registrations.popleft(), DENIED_WHILE_ARMED)
        else:
            while self._registrations:
                self._register(self._registrations.popleft())
            while self._removals:
                self._remove(self._removals.popleft())
            external.remove_unresponsive(commander.intended_or_replacement)
        self._configure()
        for state in self._completed_modes.take():
            self._publish(MODE_COMPLETED, {"nav_state": state})

    def _receive_check_reply(self, values: Values) -> None:
        """Queues a reply, except one that is too old for this version of PX4.

        Time 0 means now, and a time in the future counts as now.
        """
        sent_us = values["timestamp"]
        age_us = self._view.time_boot_us() + self._offset_us - sent_us if sent_us else 0
        if age_us <= self._view.px4.reply_valid_s * 1e6:
            self._external.receive(_decode_reply(values))

    # --- registration ----------------------------------------------------------------------------------

    def _register(self, values: Values) -> None:
        request = Registration(
            values["name"], values["register_arming_check"], values["register_mode"],
            values["register_mode_executor"],
            values["replace_internal_mode"] if values["enable_replace_internal_mode"] else NONE,
        )  # fmt: skip
        reply = self._external.register(request)
        self._reply(values, reply)
        activate = values["activate_mode_immediately"] and values["register_mode_executor"]
        if reply.success and reply.mode != NONE and activate and not self._commander.armed:
            self._commander.set_mode(NavState(reply.mode))

    def _reply(self, request: Values, reply: RegistrationReply) -> None:
        self._publish(
            REGISTRATION_REPLY,
            {
                "request_id": request["request_id"], "name": request["name"][:NAME_LENGTH],
                "px4_ros2_api_version": API_VERSION, "success": reply.success,
                "arming_check_id": reply.arming_check, "mode_id": reply.mode,
                "mode_executor_id": reply.executor,
            },
        )  # fmt: skip

    def _remove(self, values: Values) -> None:
        mode = values["mode_id"]
        self._external.unregister(values["name"], values["arming_check_id"], mode)
        if mode == self._commander.intended and mode != NONE and not self._commander.armed:
            self._commander.set_mode(NavState.HOLD)

    # --- configuration ---------------------------------------------------------------------------------

    def _configure(self) -> None:
        while self._configurations:
            values = self._configurations.popleft()
            enabled = {name: values[flag] for flag, name in CONTROLLERS.items()}
            self._external.set_controllers(values["source_id"], Controllers(**enabled))
        while self._overrides:
            values = self._overrides.popleft()
            overrides = Overrides(
                values["disable_auto_disarm"], values["defer_failsafes"], values["defer_failsafes_timeout_s"]
            )
            source_type, source = values["source_type"], values["source_id"]
            self._external.set_overrides(
                overrides,
                mode=source if source_type == MODE_SOURCE else NONE,
                executor=source if source_type == EXECUTOR_SOURCE else NONE,
            )

    def _echo_completion(self, values: Values) -> None:
        """Publishes the completion of an external mode on the topic on which PX4 reports its own modes."""
        self._publish(MODE_COMPLETED, {"result": values["result"], "nav_state": values["nav_state"]})


class _CompletedModes:
    """Finds completed modes of PX4: take-off, return and mission once, landing repeatedly."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._commander, self._navigator = autopilot.commander, autopilot.navigator
        self._view = autopilot.view
        self._previous_mode = self._commander.active
        self._reported_mode: NavState | None = None
        """Mode whose completion was reported last; disarming and later mode changes clear this value."""
        self._next_landing_at_us = 0

    def take(self) -> list[NavState]:
        """Modes completed since the last call."""
        active, previous = self._commander.active, self._previous_mode
        self._previous_mode = active
        if not self._commander.armed:
            self._reported_mode = None
            return []
        if (
            previous is NavState.TAKEOFF
            and self._reported_mode is not previous
            and self._takeoff_completed(active)
        ):
            self._reported_mode = previous
            return [previous]
        if active is not previous:
            self._reported_mode = None
        if active is NavState.LAND and self._commander.landed:
            return [active] if self._landing_due() else []
        if self._reported_mode is active or not self._has_completed(active):
            return []
        self._reported_mode = active
        return [active]

    def _takeoff_completed(self, active: NavState) -> bool:
        in_air = not self._commander.landed and active in (NavState.TAKEOFF, NavState.HOLD)
        return in_air and self._navigator.takeoff_finished(NavState.TAKEOFF)

    def _has_completed(self, active: NavState) -> bool:
        if active is NavState.RTL:
            return self._commander.landed and self._navigator.lands_in(active)
        return active is NavState.MISSION and self._navigator.mission.finished

    def _landing_due(self) -> bool:
        now_us = self._view.time_boot_us()
        if now_us < self._next_landing_at_us:
            return False
        self._next_landing_at_us = (now_us // LAND_COMPLETED_EVERY_US + 1) * LAND_COMPLETED_EVERY_US
        return True


def _decode_reply(values: Values) -> ArmingCheckReply:
    """An ArmingCheckReply with its first `MAX_EVENTS` events."""
    events = tuple(
        (
            values[f"events[{n}].id"],
            values[f"events[{n}].log_levels"],
            bytes(values[f"events[{n}].arguments"]),
        )
        for n in range(min(values["num_events"], MAX_EVENTS))
    )
    requires = frozenset(name for name in REPORTED if values.get(f"mode_req_{name}"))
    return ArmingCheckReply(
        values["request_id"], values["registration_id"], values["can_arm_and_run"], requires, events
    )
