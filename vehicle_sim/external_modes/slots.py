"""Slots of external modes and mode executors, as PX4 assigns them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

FIRST_MODE, LAST_MODE = 23, 30
"""Navigation states of external modes."""
EXECUTORS = 5
NONE = -1
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
        hashes: for each slot the hash of the last mode's name; 0: never used. They are kept over restarts.
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

        A known name gets its old slot; a new name gets the first free slot that was never used, otherwise the
        first free slot. A second mode of the same name gets its slot in the same way, and its hash is 0.
        """
        hashed = name_hash(mode.name)
        free = [n for n in range(LAST_MODE - FIRST_MODE + 1) if FIRST_MODE + n not in self.modes]
        unused = next((n for n in free if self._hashes[n] == 0), None)
        known = next((n for n, value in enumerate(self._hashes) if value == hashed), None)
        if known in free:
            slot = known
        elif known is not None and unused is not None:
            slot = unused
        elif known is not None:
            slot = free[0]
            self._store_hash(slot, 0)
        else:
            slot = free[0] if unused is None else unused
            self._store_hash(slot, hashed)
        self.modes[FIRST_MODE + slot] = mode
        return FIRST_MODE + slot

    def remove(self, state: int, name: str) -> bool:
        """Removes a mode if it has this name."""
        if state not in self.modes or self.modes[state].name != name:
            return False
        del self.modes[state]
        return True

    def replacement(self, state: int) -> int | None:
        """Navigation state of the external mode that replaces a mode; None: no replacement."""
        return next((number for number, mode in self.modes.items() if mode.replaces == state), None)


class Executors:
    """Registered mode executors by id, from 1."""

    def __init__(self) -> None:
        self.executors: dict[int, Executor] = {}

    @property
    def is_full(self) -> bool:
        """Whether no id is free."""
        return len(self.executors) >= EXECUTORS

    def add(self, executor: Executor) -> int:
        """Stores an executor; returns its id."""
        number = next(number for number in range(1, EXECUTORS + 1) if number not in self.executors)
        self.executors[number] = executor
        return number
