"""The parameter protocol as in PX4.

The float field of PARAM_VALUE contains the bytes of an integer. A requested list starts with `_HASH_CHECK`.
An invalid request gets no reply.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from vehicle_sim.autopilot.announcer import Announcer
from vehicle_sim.mavlink.context import Context
from vehicle_sim.mavlink.dialect import Message
from vehicle_sim.mavlink.link import Link
from vehicle_sim.parameters import Change, Parameters, ParameterValue

HASH_NAME = "_HASH_CHECK"
HASH_INDEX = 65535
UINT32, INT32, REAL32 = 5, 6, 9
"""MAV_PARAM_TYPE."""
VALUES_PER_STEP = 5
"""With 250 steps per second, 930 values take 0.8 s."""
SEND_DELAY_S = 0.01
SEND_AT_BOOT_S = 1.0
SAVE_AFTER_S, SAVE_EVERY_S = 0.3, 2.0
"""Delay between a change and PX4's saving, and minimum interval between two savings."""
MIN_CHANGE = 1.19e-7
"""A value counts as changed if the difference is larger; NaN as stored or new value counts as unchanged."""
CRITICAL = 2
"""MAV_SEVERITY_CRITICAL."""
TILT_MAX_DEG = 89.0


@dataclass(frozen=True, slots=True)
class _Limit:
    """The parameter `name` may not exceed the parameter `maximum`."""

    name: str
    maximum: str
    text: str
    event: str


_LIMITS = (
    _Limit("MPC_TILTMAX_LND", "MPC_TILTMAX_AIR", "Land tilt has been constrained by max tilt",
           "mc_pos_ctrl_land_tilt_set"),
    _Limit("MPC_XY_CRUISE", "MPC_XY_VEL_MAX", "Cruise speed has been constrained by max speed",
           "mc_pos_ctrl_cruise_set"),
    _Limit("MPC_VEL_MANUAL", "MPC_XY_VEL_MAX", "Manual speed has been constrained by max speed",
           "mc_pos_ctrl_man_vel_set"),
    _Limit("MPC_VEL_MAN_BACK", "MPC_VEL_MANUAL",
           "Manual backward speed has been constrained by forward speed", "mc_pos_ctrl_man_vel_back_set"),
    _Limit("MPC_VEL_MAN_SIDE", "MPC_VEL_MANUAL",
           "Manual sideways speed has been constrained by forward speed", "mc_pos_ctrl_man_vel_side_set"),
    _Limit("MPC_Z_V_AUTO_UP", "MPC_Z_VEL_MAX_UP", "Ascent speed has been constrained by max speed",
           "mc_pos_ctrl_up_vel_set"),
    _Limit("MPC_Z_V_AUTO_DN", "MPC_Z_VEL_MAX_DN", "Descent speed has been constrained by max speed",
           "mc_pos_ctrl_down_vel_set"),
)  # fmt: skip


class ParameterLimits:
    """Enforces the limits of one vehicle; call `apply` after each parameter change by a client."""

    def __init__(self, parameters: Parameters, announcer: Announcer) -> None:
        self._parameters = parameters
        self._announcer = announcer

    def apply(self) -> None:
        """Sets values outside their limits to the limit, and reports each change."""
        value = self._parameters.get
        if value("MPC_TILTMAX_AIR") > TILT_MAX_DEG:
            self._parameters.set("MPC_TILTMAX_AIR", TILT_MAX_DEG)
            self._report("Tilt constrained to safe value", "mc_pos_ctrl_tilt_set", TILT_MAX_DEG)
        for limit in _LIMITS:
            highest = value(limit.maximum)
            if value(limit.name) > highest:
                self._parameters.set(limit.name, highest)
                self._report(limit.text, limit.event, highest)
        low, high = value("MPC_THR_MIN"), value("MPC_THR_MAX")
        hover = value("MPC_THR_HOVER")
        if low <= high and not low <= hover <= high and not math.isnan(hover):
            limited = max(low, min(high, hover))
            self._parameters.set("MPC_THR_HOVER", limited)
            self._report(
                "Hover thrust has been constrained by min/max", "mc_pos_ctrl_hover_thrust_set", limited
            )

    def _report(self, text: str, event: str, value: float) -> None:
        self._announcer.announce(CRITICAL, text, event, "f", value)


class ParamService:
    """Handles PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._parameters = context.view.parameters
        self._requested_lists: dict[str, deque[str]] = {}
        self._unsaved: set[str] = set()
        self._save_at_s = math.inf
        self._saved_at_s = -math.inf
        self._send_at_s = math.inf
        self._limits = ParameterLimits(self._parameters, context.autopilot.announcer)
        self._parameters.add_listener(self._on_change)
        if self._parameters.set_at_boot:
            self._unsaved.update(self._parameters.set_at_boot)
            self._send_at_s = SEND_AT_BOOT_S
            self._save_at_s = SEND_AT_BOOT_S + SAVE_AFTER_S
        self.handlers = {
            "PARAM_REQUEST_LIST": self.request_list,
            "PARAM_REQUEST_READ": self.request_read,
            "PARAM_SET": self.set,
        }

    def request_list(self, link: Link, message: Message) -> None:
        """Starts sending all values; `step` limits the rate."""
        if message.target_system == self._context.system_id and message.target_component in (0, 1):
            self._requested_lists[link.name] = deque((HASH_NAME, *self._parameters.names))

    def request_read(self, link: Link, message: Message) -> None:
        """Sends one value, by name or index."""
        if not self._context.addresses_autopilot(message):
            return
        name = (
            message.param_id if message.param_index == -1 else self._parameters.name_at(message.param_index)
        )
        if name:
            self._send_value(link, name)

    def set(self, link: Link, message: Message) -> None:
        """Stores a value if its type is correct; replies with the stored value."""
        name = message.param_id
        if not self._context.addresses_autopilot(message):
            return
        if name == HASH_NAME:  # the ground station has all values and ends the list
            self._requested_lists.pop(link.name, None)
            return
        if name not in self._parameters:
            return
        is_integer = self._parameters.type_of(name) == "INT32"
        if message.param_type != (INT32 if is_integer else REAL32):
            return
        raw = struct.pack("<f", message.param_value)
        value: ParameterValue = struct.unpack("<i", raw)[0] if is_integer else message.param_value
        self._mark_unsaved(name)
        previous_send_at_s = self._send_at_s
        changed = abs(value - self._parameters.get(name)) > MIN_CHANGE
        self._parameters.set(name, value)
        if not changed:
            self._send_at_s = previous_send_at_s
        self._send_value(link, name)
        self._limits.apply()

    def _on_change(self, name: str, _value: ParameterValue) -> None:
        if self._parameters.change is Change.STATISTIC:  # the simulation does not use statistics
            return
        problem = self._context.view.simulation.reload_parameters(self._context.view.row)
        if problem is not None:
            self._context.autopilot.announcer.text(4, f"{name} stored but not applied: {problem}"[:200])
        if self._parameters.change is Change.RESET:
            self._unsaved.discard(name)
        else:
            self._mark_unsaved(name)
        self._send_at_s = min(self._send_at_s, self._context.view.time_s + SEND_DELAY_S)

    def _mark_unsaved(self, name: str) -> None:
        self._unsaved.add(name)
        self._context.wake()
        now_s = self._context.view.time_s
        if self._save_at_s == math.inf:
            self._save_at_s = max(now_s + SAVE_AFTER_S, self._saved_at_s + SAVE_EVERY_S)

    def send_as_changed(self, names: Iterable[str]) -> None:
        """Sends values on every link as if they had changed."""
        for name in names:
            self._mark_unsaved(name)
        self._send_at_s = min(self._send_at_s, self._context.view.time_s + SEND_DELAY_S)

    @property
    def unsaved(self) -> frozenset[str]:
        """Names of parameters that are not saved yet."""
        return frozenset(self._unsaved)

    @property
    def busy(self) -> bool:
        """Whether values must still be sent or saved."""
        return bool(self._unsaved or any(self._requested_lists.values()))

    def step(self) -> None:
        """After a change sends all unsaved values on every link; continues the requested lists."""
        now_s = self._context.view.time_s
        if now_s >= self._send_at_s:
            self._send_at_s = math.inf
            for name in sorted(self._unsaved, key=self._parameters.index_of):
                for link in self._context.links:
                    self._send_value(link, name)
        if now_s >= self._save_at_s:
            self._unsaved.clear()
            self._save_at_s, self._saved_at_s = math.inf, now_s
        for link in self._context.links:
            pending = self._requested_lists.get(link.name)
            if not pending:
                continue
            for _ in range(min(VALUES_PER_STEP, len(pending))):
                self._send_value(link, pending.popleft())

    def _send_value(self, link: Link, name: str) -> None:
        parameters = self._parameters
        if name == HASH_NAME:
            value = struct.unpack("<f", struct.pack("<I", parameters.hash()))[0]
            index, type_code = HASH_INDEX, UINT32
        elif name in parameters:
            stored = parameters.get(name)
            is_integer = parameters.type_of(name) == "INT32"
            value = struct.unpack("<f", struct.pack("<i", int(stored)))[0] if is_integer else stored
            index, type_code = parameters.index_of(name), INT32 if is_integer else REAL32
        else:
            return
        link.send(
            "PARAM_VALUE", param_id=name, param_value=value, param_type=type_code,
            param_count=len(parameters), param_index=index,
        )  # fmt: skip
