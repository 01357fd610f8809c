"""Slots of external modes and mode executors, as PX4 assigns them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

FIRST_MODE, LAST_MODE = 23, 30
"""Navigation states of external modes."""
MAX_EXECUTORS = 5
NONE = -1
"""No mode, no arming check, no executor."""
_FNV_OFFSET, _FNV_PRIME = 0x811C9DC5, 0x01000193


@dataclass(frozen=True, slots=True)
class Overrides:
    """Settings of a ConfigOverrides message; they apply while the mode or executor is active."""

    disable_auto_disarm: bool = False
    defer_failsafes: bool = False
    defer_timeout_s: int = 0
    """0: PX4's default, negative: no timeout."""


@dataclass(frozen=True, slots=True)
class Controllers:
    """Controllers that run in an external mode (`config_control_setpoints`); by default none."""

    position: bool = False
    velocity: bool = False
    altitude: bool = False
    climb_rate: bool = False
    acceleration: bool = False
    attitude: bool = False
    rates: bool = False
    allocation: bool = False

    @property
    def trajectory(self) -> bool:
        """Whether the position controller runs."""
        return self.position or self.velocity or self.altitude or self.climb_rate or self.acceleration


@dataclass(slots=True)
class ExternalMode:
    """One registered mode."""

    name: str
    replaces: int = NONE
    arming_check: int = NONE
    executor: int = NONE
    controllers: Controllers = Controllers()
    overrides: Overrides = Overrides()


@dataclass(slots=True)
class Executor:
    """One registered mode executor."""

    name: str
    overrides: Overrides = Overrides()


def name_hash(name: str) -> int:
    """FNV-1a hash of a mode's name as a signed 32-bit number, stored by PX4 in COM_MODEn_HASH; never 0."""
    value = _FNV_OFFSET
    for byte in name.encode():
        value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
    signed = value - (1 << 32) if value >= 1 << 31 else value
    return signed or 1


class ModeSlots:
    """Registered modes by navigation state.

    Args:
        hashes: for each slot the hash of the last mode's name; 0: never used. The hashes outlast a reboot.
        store_hash: `store_hash(slot, value)` changes the hash of a slot.
    """

    def __init__(self, hashes: Sequence[int], store_hash: Callable[[int, int], None]) -> None:
        self._hashes, self._store_hash = hashes, store_hash
        self.modes: dict[int, ExternalMode] = {}

    @property
    def is_full(self) -> bool:
        """Whether no slot is free."""
        return len(self.modes) > LAST_MODE - FIRST_MODE

    def add(self, mode: ExternalMode) -> int:
        """Stores a mode; returns its navigation state.

        A known name gets its old slot. A new name gets the first free slot that was never used, otherwise the
        first free slot. If a mode of the same name occupies the old slot, the slot is chosen as for a new
        name, and the hash of that slot is 0.
        """
        new_hash = name_hash(mode.name)
        free_slots = [n for n in range(LAST_MODE - FIRST_MODE + 1) if FIRST_MODE + n not in self.modes]
        never_used = next((n for n in free_slots if self._hashes[n] == 0), None)
        same_name = next((n for n, value in enumerate(self._hashes) if value == new_hash), None)
        if same_name in free_slots:
            slot = same_name
        elif same_name is not None and never_used is not None:
            slot = never_used
        elif same_name is not None:
            slot = free_slots[0]
            self._store_hash(slot, 0)
        else:
            slot = free_slots[0] if never_used is None else never_used
            self._store_hash(slot, new_hash)
        self.modes[FIRST_MODE + slot] = mode
        return FIRST_MODE + slot

    def remove(self, nav_state: int, name: str) -> bool:
        """Removes a mode if it has this name."""
        if nav_state not in self.modes or self.modes[nav_state].name != name:
            return False
        del self.modes[nav_state]
        return True

    def replacement(self, nav_state: int) -> int | None:
        """Navigation state of the external mode that replaces `nav_state`; None: no mode replaces it."""
        return next((external for external, mode in self.modes.items() if mode.replaces == nav_state), None)


class Executors:
    """Registered mode executors by id, from 1."""

    def __init__(self) -> None:
        self.executors: dict[int, Executor] = {}

    @property
    def is_full(self) -> bool:
        """Whether no id is free."""
        return len(self.executors) >= MAX_EXECUTORS

    def add(self, executor: Executor) -> int:
        """Stores an executor; returns its id."""
        executor_id = next(n for n in range(1, MAX_EXECUTORS + 1) if n not in self.executors)
        self.executors[executor_id] = executor
        return executor_id
