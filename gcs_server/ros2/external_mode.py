"""One flight mode of this server in PX4: registration, arming checks, completion, removal.

PX4 gives a registered mode one of eight navigation states and shows the mode's name to every ground
station. About three times a second it sends an arming check request: the reply states whether the mode can
run. PX4 removes a mode without replies; if the vehicle flies in the mode, PX4 then returns (RTL). The times
in this module come from recordings of PX4 and from its interface library. No I/O and no clock: the caller
passes the time and sends the messages.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final, Literal

from gcs_server.ros2.message_types import MESSAGES, Values
from gcs_server.ros2.mode_executor import ARMED, COMMAND, ExecutorState, Message, ModeExecutor

REGISTER: Final = "/fmu/in/register_ext_component_request"
UNREGISTER: Final = "/fmu/in/unregister_ext_component"
CHECK_REPLY: Final = "/fmu/in/arming_check_reply"
COMPLETED: Final = "/fmu/in/mode_completed"
CONTROLLERS: Final = "/fmu/in/config_control_setpoints"
OVERRIDES: Final = "/fmu/in/config_overrides_request"
REGISTER_REPLY: Final = "/fmu/out/register_ext_component_reply"
CHECK_REQUEST: Final = "/fmu/out/arming_check_request"
SENT_TYPES: Final = {
    REGISTER: "RegisterExtComponentRequest",
    UNREGISTER: "UnregisterExtComponent",
    CHECK_REPLY: "ArmingCheckReply",
    COMPLETED: "ModeCompleted",
    CONTROLLERS: "VehicleControlMode",
    OVERRIDES: "ConfigOverrides",
    COMMAND: "VehicleCommand",
}
"""Message type of each topic to which this server sends for a mode, without the topics of setpoints."""
API_VERSION: Final = 1
NAME_BYTES: Final = 24
"""Maximum length of a mode's name [bytes]."""
FIRST_NAV_STATE, LAST_NAV_STATE = 23, 30
"""Navigation states of external modes."""
NO_ID: Final = -1
ATTEMPTS, ATTEMPT_EVERY_S = 5, 1.0
CONNECT_TIMEOUT_S: Final = 10.0
"""Time within which DDS must connect PX4's topics [s]; it needs up to a few seconds."""
MIN_CHECKS: Final = 2
"""Number of arming check requests after which the mode counts as registered. PX4 can select a mode only after
it has evaluated the first reply; it does this before the second request."""
MAX_IGNORED: Final = 5
"""Number of consecutive arming check requests without this mode's bit after which the mode is lost. PX4 v1.17
and later report there whose replies it has; the bit of a mode whose replies were late returns with the next
reply, so a vehicle that flies in the mode is answered on."""
LOST_S: Final = 1.5
"""Time without a request after which the mode is lost [s]. PX4 sends a request every 0.31 s, and removes a
mode at most 1.25 s after the last reply."""
REPLIES_ENDED: Final = "the server's process that replies to PX4 ended"
IF_SILENT: Final = "after about 1 s the vehicle returns (RTL): PX4 receives no more replies for the mode."
"""Text: what a vehicle that flies in an external mode does when the mode's component ends."""
NOT_DEFERRED, WOULD_FAILSAFE = 0, 2
"""VehicleStatus.failsafe_defer_state: deferring is disabled; PX4 defers a failsafe now."""
FAILED: Final = 100
"""ModeCompleted.RESULT_FAILURE_OTHER."""
RegistrationState = Literal["registering", "registered", "refused", "lost"]


@dataclass(frozen=True, slots=True)
class ModeDeclaration:
    """Name and requirements of a mode, as declared to PX4."""

    name: str
    """ASCII, at most `NAME_BYTES`."""
    requires: frozenset[str]
    """Names of fields `mode_req_*` of ArmingCheckReply. PX4 checks these requirements when the mode is
    selected, and executes a failsafe if one is not met."""
    defer_failsafes_s: int = 0
    """How long PX4 may defer a failsafe while the vehicle flies in the mode [s]; 0: never. PX4 defers its
    reaction to a lost ground station connection, lost manual control or a low battery, but never to a missing
    requirement or a geofence breach."""
    executor: bool = False
    """Whether the mode has an executor. Without an executor, PX4 does not arm the vehicle in this mode."""


@dataclass(frozen=True, slots=True)
class Registration:
    """State of a mode's registration."""

    name: str
    state: RegistrationState
    nav_state: int | None
    """Navigation state in PX4; None: PX4 has not assigned one."""
    reason: str = ""
    """Why the registration was refused or lost."""
    failsafe_deferred: bool = False
    """Whether PX4 defers a failsafe now, because the vehicle flies in this mode."""
    executor: ExecutorState | None = None
    """State of the mode's executor; None: the mode has no executor, or is not registered."""

    @property
    def mode(self) -> str | None:
        """The mode as in `Status.mode` (`external_1` …); None while it is not registered."""
        if self.state != "registered" or self.nav_state is None:
            return None
        return f"external_{self.nav_state - FIRST_NAV_STATE + 1}"


class ExternalMode:
    """The registration of one mode with one vehicle.

    Args:
        declaration: name and requirements of the mode.
        request_id: distinguishes this mode's requests from those of other programs.
        now_s: current time [s, monotonic].
    """

    def __init__(self, declaration: ModeDeclaration, request_id: int, now_s: float) -> None:
        self.declaration, self._request_id = declaration, request_id
        self._state: RegistrationState = "registering"
        self._reason = ""
        self._check_id = self._mode_id = NO_ID
        self.executor: ModeExecutor | None = None
        """The mode's executor, once PX4 has registered it."""
        self._began_s = now_s
        self._attempts, self.due_s = 0, now_s
        """Number of registration requests, and the time at which `step` must be called [s, monotonic]."""
        self._checked_s, self._checks = now_s, 0
        """Time of PX4's last arming check request, and number of these requests."""
        self._ignored = 0
        """Number of consecutive requests in which PX4 reports this mode's replies as missing."""
        self._was_settable = self._armed = self._active = False
        self._failsafe_deferred = False
        self.ready = True
        """Whether the vehicle may be armed in the mode; without effect once it is armed."""

    @property
    def registration(self) -> Registration:
        """State of the registration."""
        nav_state = None if self._mode_id == NO_ID else self._mode_id
        selectable = self._state != "registered" or self._checks >= MIN_CHECKS
        state = self._state if selectable else "registering"
        executor = self.executor.state if self.executor is not None and state == "registered" else None
        name = self.declaration.name
        return Registration(name, state, nav_state, self._reason, self._failsafe_deferred, executor)

    def step(self, now_s: float) -> list[Message]:
        """The requests that are due now; call this at `due_s`."""
        if self._state == "registered" and now_s - self._checked_s > LOST_S:
            self._set_lost(
                "PX4 no longer sends requests for the mode (PX4 restarted, or ROS 2 was interrupted)"
            )
        if self._state != "registering":
            self.due_s = self._checked_s + LOST_S + 0.01 if self._state == "registered" else float("inf")
            return []
        if now_s < self.due_s:
            return []
        if self._attempts >= ATTEMPTS:
            self._state, self.due_s = "refused", float("inf")
            self._reason = (
                f"PX4 did not answer {ATTEMPTS} requests to register the mode, although it has confirmed the "
                "layouts of their topics; check the uXRCE-DDS client and its agent"
            )
            return []
        self._attempts += 1
        self.due_s = now_s + ATTEMPT_EVERY_S
        fields = {
            "request_id": self._request_id,
            "name": _encode_name(self.declaration.name),
            "px4_ros2_api_version": API_VERSION,
            "register_arming_check": True,
            "register_mode": True,
            "register_mode_executor": self.declaration.executor,
        }
        return [_message(REGISTER, fields)]

    def wait_for_connection(self, now_s: float) -> None:
        """Called instead of `step` while DDS has not connected PX4's topics; a request would be lost."""
        if self._state == "registering" and not self._attempts and now_s - self._began_s > CONNECT_TIMEOUT_S:
            self._state, self.due_s = "refused", float("inf")
            self._reason = (
                f"DDS did not connect PX4's topics for flight modes within {CONNECT_TIMEOUT_S:g} s; check "
                "the uXRCE-DDS client and its agent"
            )

    def on_reply(self, values: Values, now_s: float) -> list[Message]:
        """Handles a RegisterExtComponentReply; ignores a reply to another program."""
        if values["request_id"] != self._request_id or _decode_name(values["name"]) != self.declaration.name:
            return []
        executor_id = values["mode_executor_id"]
        valid = values["success"] and FIRST_NAV_STATE <= values["mode_id"] <= LAST_NAV_STATE
        valid = valid and (executor_id > 0 or not self.declaration.executor)
        if self._state != "registering":
            # a late reply to an earlier request: PX4 has registered the mode twice
            ids = (values["arming_check_id"], values["mode_id"], executor_id)
            return [self._unregistration(*ids)] if valid else []
        if not valid:
            self._state, self.due_s = "refused", float("inf")
            self._reason = (
                "PX4 refused the registration: all eight of its mode slots or all five of its executor slots "
                "are used, or it is armed and COM_MODE_ARM_CHK is 0"
            )
            return []
        if values["px4_ros2_api_version"] != API_VERSION:
            self._state, self.due_s = "refused", float("inf")
            self._reason = (
                f"PX4's interface for flight modes has version {values['px4_ros2_api_version']}, but this "
                f"server knows version {API_VERSION}; use PX4 v1.15 to v1.17"
            )
            return [self._unregistration(values["arming_check_id"], values["mode_id"], executor_id)]
        self._state, self._checked_s, self.due_s = "registered", now_s, now_s + LOST_S
        self._check_id, self._mode_id = values["arming_check_id"], values["mode_id"]
        if self.declaration.executor:
            self.executor = ModeExecutor(executor_id)
        return [controllers_message(self._mode_id, "position"), *self._overrides()]

    def on_check_request(self, values: Values, now_s: float, *, can_run: bool) -> list[Message]:
        """The reply to an ArmingCheckRequest.

        Args:
            values: the request.
            now_s: current time [s, monotonic].
            can_run: whether the mode may be started or continued. Arming in the mode also requires `ready`.
        """
        if self._state != "registered":
            return []
        self._checked_s, self._checks = now_s, self._checks + 1
        is_valid = bool(values["valid_registrations_mask"] >> self._check_id & 1)
        self._ignored = 0 if is_valid else self._ignored + 1
        if self._ignored >= MAX_IGNORED and not self._active:
            self._set_lost("PX4 dropped the mode: it does not accept the server's replies, or restarted")
            return []
        fields = {
            "request_id": values["request_id"],
            "registration_id": self._check_id,
            "can_arm_and_run": can_run and (self.ready or self._armed),
            # Without an executor, the mission does not contain the take-off: it must begin in the air.
            "mode_req_prevent_arming": not self.declaration.executor,
            **{f"mode_req_{name}": True for name in self.declaration.requires},
        }
        return [_message(CHECK_REPLY, fields)]

    def on_status(self, values: Values) -> list[Message]:
        """Handles a VehicleStatus, which shows whether PX4 has removed the mode. Returns the message with the
        overrides if PX4 does not apply them."""
        self._armed = values["arming_state"] == ARMED
        active = self._active = self._state == "registered" and values["nav_state"] == self._mode_id
        self._failsafe_deferred = active and values["failsafe_defer_state"] == WOULD_FAILSAFE
        if self._state != "registered":
            return []
        if self.executor is not None:
            self.executor.on_status(values)
        settable = bool(values["can_set_nav_states_mask"] >> self._mode_id & 1)
        if self._was_settable and not settable:
            self._set_lost("PX4 removed the mode, because it received no replies in time")
        self._was_settable = settable
        return self._overrides() if active and values["failsafe_defer_state"] == NOT_DEFERRED else []

    def completed(self, *, success: bool) -> list[Message]:
        """The message with which PX4 learns that the mode is complete, or has failed."""
        if self._state != "registered":
            return []
        return [_message(COMPLETED, {"result": 0 if success else FAILED, "nav_state": self._mode_id})]

    def remove(self) -> list[Message]:
        """Unregisters the mode. If this message is lost, PX4 removes the mode because it receives no more
        replies."""
        registered, self._state, self.due_s = self._state == "registered", "lost", float("inf")
        executor_id = NO_ID if self.executor is None else self.executor.id
        return [self._unregistration(self._check_id, self._mode_id, executor_id)] if registered else []

    def _set_lost(self, reason: str) -> None:
        self._state, self._reason = "lost", reason
        self._failsafe_deferred = False

    def _overrides(self) -> list[Message]:
        """The message with the mode's overrides (deferred failsafes); empty if the mode has no overrides."""
        if not self.declaration.defer_failsafes_s:
            return []
        fields = {
            "defer_failsafes": True,
            "defer_failsafes_timeout_s": self.declaration.defer_failsafes_s,
            "source_id": self._mode_id,
        }
        return [_message(OVERRIDES, fields)]

    def _unregistration(self, check_id: int, mode_id: int, executor_id: int) -> Message:
        fields = {
            "name": _encode_name(self.declaration.name),
            "arming_check_id": check_id,
            "mode_id": mode_id,
            "mode_executor_id": executor_id,
        }
        return _message(UNREGISTER, fields)


_CONTROL_CASCADE: Final = ("position", "attitude", "body_rate", "thrust_and_torque")
_CONTROLLER_FLAGS: Final = {
    "position": ("position", "velocity", "altitude", "climb_rate", "acceleration"),
    "attitude": ("attitude",),
    "body_rate": ("rates",),
    "thrust_and_torque": ("allocation",),
}
"""Flags of VehicleControlMode by the level of the control cascade."""


@cache
def controllers_message(nav_state: int, level: str) -> Message:
    """The message with the controllers that PX4 runs in a mode: the controller of the setpoint and all lower
    controllers of the cascade.

    Args:
        nav_state: the mode's navigation state.
        level: flag of OffboardControlMode for the mode's setpoints. Position, velocity and acceleration need
            the same controllers; direct actuators need none.
    """
    level = "position" if level in ("velocity", "acceleration") else level
    levels = _CONTROL_CASCADE[_CONTROL_CASCADE.index(level) :] if level in _CONTROL_CASCADE else ()
    flags = {f"flag_control_{flag}_enabled": True for each in levels for flag in _CONTROLLER_FLAGS[each]}
    return _message(CONTROLLERS, {"source_id": nav_state, **flags})


def _message(topic: str, fields: Values) -> Message:
    return topic, MESSAGES[SENT_TYPES[topic]].encode(fields)


def _encode_name(name: str) -> tuple[int, ...]:
    return tuple(name.encode("ascii").ljust(NAME_BYTES + 1, b"\0"))


def _decode_name(text: tuple[int, ...]) -> str:
    return bytes(text).split(b"\0", 1)[0].decode("ascii", "replace")
