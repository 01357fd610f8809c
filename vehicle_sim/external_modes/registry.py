"""External modes of one vehicle: registration, arming checks, replaced modes, executor in charge.

The registry has no clock and no transport: time is an argument, and the caller sends the messages. It follows
recordings of PX4 v1.16 over ROS 2.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from vehicle_sim.external_modes.arming_checks import NONE, ArmingCheckReply, ArmingChecks, ExternalHealth
from vehicle_sim.external_modes.requirements import BUILT_IN_REQUIREMENTS, Requirements
from vehicle_sim.external_modes.slots import (
    FIRST_MODE,
    LAST_MODE,
    Controllers,
    Executor,
    Executors,
    ExternalMode,
    ModeSlots,
    Overrides,
)

NAME_LENGTH = 24
"""Maximum length of a name; a longer name is cut."""
HOLD = 4
"""Navigation state of PX4's mode Hold."""
AUTOPILOT = 0
"""Id of the autopilot, which is in charge if no external executor is in charge."""
EXECUTOR_COMPONENT = 1000
"""The component id of executor N is EXECUTOR_COMPONENT + N."""
NO_OVERRIDES, NO_CONTROLLERS = Overrides(), Controllers()


@dataclass(frozen=True, slots=True)
class Registration:
    """A component's request to be registered (PX4's message RegisterExtComponentRequest)."""

    name: str
    arming_check: bool = False
    mode: bool = False
    executor: bool = False
    replaces: int = NONE
    """Navigation state of the mode that the external mode replaces."""
    activate: bool = False
    """Whether the external mode is selected immediately."""

    @property
    def is_consistent(self) -> bool:
        """Whether a mode comes with an arming check, and an executor comes with a mode."""
        return (self.mode or not self.executor) and (self.arming_check or not self.mode)


@dataclass(frozen=True, slots=True)
class RegistrationReply:
    """The ids of a registered component (PX4's message RegisterExtComponentReply); NONE: not registered."""

    success: bool = False
    arming_check: int = NONE
    mode: int = NONE
    executor: int = NONE


DENIED_WHILE_ARMED = RegistrationReply(False, 0, 0, 0)
"""PX4 leaves the ids of this reply at zero."""


class ExternalModes:
    """The external modes, arming checks and executors of a vehicle.

    Args:
        hashes: see `ModeSlots`.
        store_hash: see `ModeSlots`.
        requirements: requirements of PX4's own modes.
    """

    def __init__(
        self,
        hashes: Sequence[int],
        store_hash: Callable[[int, int], None],
        requirements: Requirements = BUILT_IN_REQUIREMENTS,
    ) -> None:
        self._slots = ModeSlots(hashes, store_hash)
        self._executors = Executors()
        self.checks = ArmingChecks(requirements)
        self._in_charge = AUTOPILOT
        self.failsafe_acts = False
        """Whether a failsafe had replaced the intended mode at the last update."""
        self.commanded_by_executor = False
        """Whether the current command came from an executor."""
        self.config_count = 0
        """Number of changes of `config_control_setpoints`."""
        self.mode_list_seq = 0
        """Number of changes to the list of modes (AVAILABLE_MODES_MONITOR.seq).

        As recorded, the number increases when a mode is registered, and when `vehicle_status` is published
        with a changed mask of the modes that can be set.
        """
        self.on_mode_list_change: Callable[[], None] = _no_listener
        self._published_settable = -1
        """Bit mask in the last `vehicle_status`; -1: not published yet."""

    # --- registration ----------------------------------------------------------------------------------

    def register(self, request: Registration) -> RegistrationReply:
        """Registers all parts of a component (arming check, mode, executor), or none of them."""
        if not request.is_consistent or not self._has_free_slots(request):
            return RegistrationReply()
        name = request.name[:NAME_LENGTH]
        nav_state = executor = check = NONE
        if request.mode:
            mode = ExternalMode(name, request.replaces)
            nav_state = self._slots.add(mode)
            self._report_list_change()
        if request.executor:
            executor = self._slots.modes[nav_state].executor = self._executors.add(Executor(name))
        if request.arming_check:
            check = self.checks.add(nav_state, request.replaces)
            if request.mode:
                self._slots.modes[nav_state].arming_check = check
        return RegistrationReply(True, check, nav_state, executor)

    def _has_free_slots(self, request: Registration) -> bool:
        if request.mode and request.replaces != NONE and self.is_replaced(request.replaces):
            return False
        return not (
            (request.arming_check and self.checks.is_full)
            or (request.mode and self._slots.is_full)
            or (request.executor and self._executors.is_full)
        )

    def _report_list_change(self) -> None:
        self.mode_list_seq += 1
        self.on_mode_list_change()

    def on_status_published(self, settable: int) -> None:
        """Called when `vehicle_status` is published, with its bit mask of the modes that can be set."""
        if settable != self._published_settable:
            previous, self._published_settable = self._published_settable, settable
            if previous >= 0:
                self._report_list_change()

    def unregister(self, name: str, arming_check: int, mode: int) -> bool:
        """Removes a component; returns whether its mode was removed.

        A mode with another name is not removed.
        """
        if arming_check != NONE:
            self.checks.remove(arming_check, mode)
        return mode != NONE and self._remove_mode(mode, name[:NAME_LENGTH])

    def _remove_mode(self, nav_state: int, name: str) -> bool:
        executor = self._slots.modes[nav_state].executor if nav_state in self._slots.modes else NONE
        if not self._slots.remove(nav_state, name):
            return False
        self._executors.executors.pop(executor, None)
        if self._in_charge == executor:
            self._in_charge = AUTOPILOT
        return True

    def remove_unresponsive(self, intended_mode: int) -> None:
        """Removes the modes whose component is unresponsive, except the intended mode."""
        for nav_state, mode in list(self._slots.modes.items()):
            if nav_state != intended_mode and self.checks.is_unresponsive(mode.arming_check):
                self.checks.remove(mode.arming_check, nav_state)
                self._remove_mode(nav_state, mode.name)

    # --- modes -----------------------------------------------------------------------------------------

    @property
    def has_modes(self) -> bool:
        """Whether an external mode is registered."""
        return bool(self._slots.modes)

    def mode(self, nav_state: int) -> ExternalMode | None:
        """The mode registered for a navigation state."""
        return self._slots.modes.get(nav_state)

    def health(self) -> ExternalHealth:
        """Requirements and results of the arming checks of all external components."""
        return self.checks.health()

    def replaced_mode(self, nav_state: int) -> int:
        """The mode that the external mode `nav_state` replaces; `nav_state` if it replaces none."""
        mode = self.mode(nav_state)
        return nav_state if mode is None or mode.replaces == NONE else mode.replaces

    def effective_mode(self, nav_state: int) -> int:
        """The external mode that replaces `nav_state`; `nav_state` if no responsive mode replaces it."""
        replacement = self._slots.replacement(nav_state) if self._slots.modes else None
        if replacement is None:
            return nav_state
        unresponsive = self.checks.is_unresponsive(self._slots.modes[replacement].arming_check)
        return nav_state if unresponsive else replacement

    def is_replaced(self, nav_state: int) -> bool:
        """Whether an external mode replaces `nav_state`."""
        return self._slots.replacement(nav_state) is not None

    def settable(self, built_in: int) -> int:
        """Bit mask of the modes that can be set.

        Args:
            built_in: bit mask of PX4's own modes.
        """
        for nav_state, mode in self._slots.modes.items():
            built_in |= 1 << nav_state
            if 0 <= mode.replaces <= LAST_MODE:
                built_in &= ~(1 << mode.replaces)
        return built_in

    def set_controllers(self, nav_state: int, controllers: Controllers) -> None:
        """Sets the controllers of a mode; ignored for a mode that is not registered."""
        mode = self.mode(nav_state)
        if mode is not None:
            mode.controllers = controllers
            self.config_count += 1

    def controllers(self, nav_state: int) -> Controllers:
        """Controllers that run in a mode."""
        mode = self.mode(nav_state)
        return NO_CONTROLLERS if mode is None else mode.controllers

    # --- executors and overrides -----------------------------------------------------------------------

    @property
    def executor_in_charge(self) -> int:
        """Id of the executor in charge; during a failsafe the autopilot is in charge."""
        return AUTOPILOT if self.failsafe_acts else self._in_charge

    def mode_after_disarming(self, stored: int) -> int:
        """The mode that disarming selects from v1.17 on: the one that the executor in charge owns, else the
        stored one; Hold instead of a mode whose component is unresponsive.

        Args:
            stored: the mode that earlier versions select.
        """
        in_charge = self.executor_in_charge
        owned = (
            nav_state
            for nav_state, mode in self._slots.modes.items()
            if in_charge != AUTOPILOT and mode.executor == in_charge
        )
        selected = next(owned, stored)
        mode = self.mode(selected)
        return HOLD if mode is not None and self.checks.is_unresponsive(mode.arming_check) else selected

    def on_mode_change(self, nav_state: int) -> None:
        """Called after a change of the intended mode; puts the executor of the new mode in charge.

        If the mode has no executor, the autopilot is in charge, unless the executor in charge selected the
        mode.
        """
        mode = self.mode(nav_state)
        if mode is not None and mode.executor != NONE:
            self._in_charge = mode.executor
        elif not self.commanded_by_executor:
            self._in_charge = AUTOPILOT

    def set_overrides(self, overrides: Overrides, *, mode: int = NONE, executor: int = NONE) -> None:
        """Sets the overrides of a mode or of an executor."""
        if mode in self._slots.modes:
            self._slots.modes[mode].overrides = overrides
        if executor in self._executors.executors:
            self._executors.executors[executor].overrides = overrides

    def overrides(self, active_mode: int) -> Overrides:
        """The combined overrides of the active mode and of the executor in charge."""
        if not self._slots.modes:
            return NO_OVERRIDES
        mode = self.mode(active_mode)
        mode_overrides = NO_OVERRIDES if mode is None else mode.overrides
        executor = self._executors.executors.get(self.executor_in_charge)
        if executor is None:
            return mode_overrides
        executor_overrides = executor.overrides
        deferring = executor_overrides if executor_overrides.defer_failsafes else mode_overrides
        return dataclasses.replace(
            deferring,
            disable_auto_disarm=mode_overrides.disable_auto_disarm or executor_overrides.disable_auto_disarm,
        )

    # --- arming checks ---------------------------------------------------------------------------------

    def receive(self, reply: ArmingCheckReply) -> None:
        """Queues an arming check reply for the next update."""
        self.checks.receive(reply)

    def update(self, now_us: int, *, failsafe_acts: bool) -> int | None:
        """Evaluates arming checks; call every 10 ms.

        Returns:
            Id of an arming check request to send now; None: no request is due.
        """
        self.failsafe_acts = failsafe_acts
        return self.checks.update(now_us)


def _no_listener() -> None:
    """Default listener without effect."""


def is_external(nav_state: int) -> bool:
    """Whether a navigation state belongs to an external mode."""
    return FIRST_MODE <= nav_state <= LAST_MODE
