"""Arming checks of external components: PX4 requests replies every 0.312 s of vehicle time.

A component is unresponsive after four unanswered requests in a row, or after eleven if it has never replied.
The times come from recordings of PX4 v1.16.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from vehicle_sim.external_modes.requirements import BUILT_IN_REQUIREMENTS, Requirements, with_external_mode

SLOTS = 8
NONE = -1
"""No mode, no arming check, no executor."""
REQUEST_EVERY_US, REPLY_WITHIN_US = 312_000, 50_000
TOLERATED_MISSES, TOLERATED_MISSES_BEFORE_REPLY = 3, 10
"""Number of unanswered requests in a row that have no effect: after the first reply, and before it."""
RECOVERIES = 3
"""Number of times that a reply makes an unresponsive component responsive again."""
REPLY_QUEUE_LENGTH = 4
"""PX4's queue length; a further reply replaces the oldest reply in the queue."""
MAX_EVENTS = 5
REQUEST_IDS = 256

ExternalEvent = tuple[int, int, bytes]
"""Id, log levels and arguments of an event that a component reports; the bit mask of its modes replaces the
first four bytes of the arguments."""


@dataclass(frozen=True, slots=True)
class ArmingCheckReply:
    """A component's reply to a request (PX4's message ArmingCheckReply)."""

    request_id: int
    registration_id: int
    can_run: bool
    requires: frozenset[str] = frozenset()
    events: tuple[ExternalEvent, ...] = ()


NO_REPLY = ArmingCheckReply(request_id=0, registration_id=0, can_run=False)
"""Reply in a slot that has never had one, in PX4 a message of zeros: it counts for registration 0."""


@dataclass(slots=True)
class ArmingCheck:
    """One registered arming check."""

    mode: int = NONE
    """Navigation state of the component's mode; NONE: the check applies to every mode."""
    replaces: int = NONE
    reply: ArmingCheckReply = NO_REPLY
    """The last reply in this slot, which may be that of the component that was registered here before."""
    replied: bool = False
    """Whether this component has replied."""
    misses: int = 0
    unresponsive: bool = False
    times_unresponsive: int = 0

    @property
    def modes(self) -> int:
        """Bit mask of the component's mode and the mode that it replaces."""
        return sum(1 << mode for mode in (self.mode, self.replaces) if 0 <= mode < 32)

    def count_miss(self) -> bool:
        """Counts an unanswered request; True: the component has just become unresponsive."""
        self.misses += 1
        if self.unresponsive or self.misses <= (
            TOLERATED_MISSES if self.replied else TOLERATED_MISSES_BEFORE_REPLY
        ):
            return False
        self.unresponsive = True
        self.times_unresponsive += 1
        return True

    def store_reply(self, reply: ArmingCheckReply) -> None:
        """Stores a reply; an unresponsive component becomes responsive again, at most RECOVERIES times."""
        self.reply, self.replied, self.misses = reply, True, 0
        if self.times_unresponsive <= RECOVERIES:
            self.unresponsive = False


@dataclass(frozen=True, slots=True)
class ExternalHealth:
    """Requirements and results of the arming checks of all external components."""

    requirements: Requirements = BUILT_IN_REQUIREMENTS
    unresponsive: int = 0
    """Bit mask of the modes whose component is unresponsive."""
    not_armable: int = 0
    """Bit mask of the modes in which arming is not allowed."""
    registered: int = 0
    """Bit mask of the registered modes."""
    events: tuple[tuple[int, ExternalEvent], ...] = ()
    """Reported events, each with the bit mask of its modes."""


EVERY_MODE = 0xFFFFFFFF
"""Bit mask of all modes."""


class ArmingChecks:
    """All registered arming checks of a vehicle, by registration id.

    Args:
        requirements: requirements of PX4's own modes.
    """

    def __init__(self, requirements: Requirements = BUILT_IN_REQUIREMENTS) -> None:
        self._built_in = requirements
        self._nothing_registered = ExternalHealth(requirements)
        self._checks: dict[int, ArmingCheck] = {}
        self._slots: dict[int, ArmingCheck] = {}
        """The newest check of each slot, also after its removal."""
        self._replies: deque[ArmingCheckReply] = deque(maxlen=REPLY_QUEUE_LENGTH)
        self._answered: set[int] = set()
        self._request_id = 0
        self._requested_at_us: int | None = None
        self._misses_counted = False
        """Whether unanswered requests of this period have been counted."""

    @property
    def valid_mask(self) -> int:
        """Bit mask of the registration ids whose component is not unresponsive."""
        return sum(1 << slot for slot, check in self._checks.items() if not check.unresponsive)

    @property
    def is_full(self) -> bool:
        """Whether no slot is free."""
        return len(self._checks) >= SLOTS

    def add(self, mode: int, replaces: int) -> int:
        """Registers a check in the first free slot; returns its registration id."""
        registration_id = next(slot for slot in range(SLOTS) if slot not in self._checks)
        previous = self._slots.get(registration_id)
        check = ArmingCheck(mode, replaces, NO_REPLY if previous is None else previous.reply)
        self._checks[registration_id] = self._slots[registration_id] = check
        return registration_id

    def remove(self, registration_id: int, mode: int) -> None:
        """Removes a check if it is registered for this mode."""
        if registration_id in self._checks and self._checks[registration_id].mode == mode:
            del self._checks[registration_id]

    def is_unresponsive(self, registration_id: int) -> bool:
        """Whether a check is registered and its component is unresponsive."""
        return registration_id in self._checks and self._checks[registration_id].unresponsive

    def receive(self, reply: ArmingCheckReply) -> None:
        """Queues a reply; as in PX4, replies stay in the queue while no check is registered."""
        self._replies.append(reply)

    def update(self, now_us: int) -> int | None:
        """Evaluates replies and timeouts.

        Returns:
            Id of a request to send to all components now; None: no request is due.
        """
        if not self._checks:
            return None
        self._take_replies()
        if self._requested_at_us is not None:
            waited_us = now_us - self._requested_at_us
            all_answered = self._answered == self._checks.keys()
            if waited_us > REPLY_WITHIN_US and not self._misses_counted and not all_answered:
                self._misses_counted = True
                self._count_misses()
            if waited_us < REQUEST_EVERY_US:
                return None
        self._requested_at_us, self._misses_counted = now_us, False
        self._answered.clear()
        self._request_id = (self._request_id + 1) % REQUEST_IDS
        return self._request_id

    def _take_replies(self) -> None:
        while self._replies:
            reply = self._replies.popleft()
            check = self._checks.get(reply.registration_id)
            if check is not None and reply.request_id == self._request_id:
                self._answered.add(reply.registration_id)
                check.store_reply(reply)

    def _count_misses(self) -> None:
        for registration_id, check in list(self._checks.items()):
            unanswered = registration_id not in self._answered
            if unanswered and check.count_miss() and check.mode == NONE:
                del self._checks[registration_id]

    def health(self) -> ExternalHealth:
        """Requirements and results of all checks.

        As in PX4, the reply in a slot counts for the registration that it names, also before the component of
        the slot has replied. So a component alone prevents arming until its first reply; the second and later
        ones do not, nor does one in a slot in which another has replied that the vehicle can arm.
        """
        if not self._checks:
            return self._nothing_registered
        requirements, unresponsive, not_armable, registered = self._built_in, 0, 0, 0
        events: list[tuple[int, ExternalEvent]] = []
        for slot in self._checks.values():
            registered |= 0 if slot.mode == NONE else 1 << slot.mode
            reply = slot.reply
            check = self._slots[reply.registration_id]
            if check.unresponsive:
                unresponsive |= 0 if check.mode == NONE else 1 << check.mode
                continue
            modes = check.modes if check.mode != NONE else EVERY_MODE
            if check.mode != NONE and slot.replied:
                requirements = with_external_mode(requirements, modes, reply.requires, can_run=reply.can_run)
            not_armable |= 0 if reply.can_run else modes
            events += [(modes, event) for event in reply.events]
        return ExternalHealth(requirements, unresponsive, not_armable, registered, tuple(events))
