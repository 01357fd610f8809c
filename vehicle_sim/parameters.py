"""One vehicle's parameters, with the names, types and order of PX4.

The values at boot were read from PX4 v1.16 (SIH quadrotor, gimbal on) and are in `data/parameters.json`; a
newer version adds its differences. As in PX4, the store accepts any value without a range check.
"""

from __future__ import annotations

import json
import math
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path
from typing import Literal

from vehicle_sim.px4_version import DATA_FOLDER, DEFAULT, Px4Version

ParameterType = Literal["INT32", "FLOAT"]
ParameterValue = int | float
Listener = Callable[[str, ParameterValue], None]

DATA_FILE = DATA_FOLDER / "parameters.json"

_VOLATILE_NAMES = frozenset(
    {
        "ASPD_SCALE_1",
        "COM_FLIGHT_UUID",
        "EKF2_MAG_DECL",
        "LND_FLIGHT_T_HI",
        "LND_FLIGHT_T_LO",
        "SENS_DPRES_OFF",
    }
)
EXTERNAL_MODE_SLOTS = 8
NO_PRIORITY = -1
"""CAL_*_PRIO of a sensor without a priority."""
_NOT_VOLATILE_CALIBRATION_SUFFIXES = ("_ID", "_PRIO", "_ROT", "_ROLL", "_PITCH", "_YAW")


_SET_AT_BOOT = frozenset(
    {
        "CAL_ACC0_ID", "CAL_ACC1_ID", "CAL_ACC2_ID", "CAL_BARO0_ID", "CAL_BARO0_OFF", "CAL_BARO0_PRIO",
        "CAL_GYRO0_ID", "CAL_GYRO1_ID", "CAL_GYRO2_ID", "CAL_MAG0_ID", "CAL_MAG0_PRIO", "CAL_MAG1_ID",
        "CAL_MAG1_PRIO", "SENS_BOARD_X_OFF", "SENS_DPRES_OFF", "SYS_AUTOCONFIG", "SYS_AUTOSTART",
        "UXRCE_DDS_KEY", "UXRCE_DDS_PTCFG",
    }
)  # fmt: skip
"""Parameters that PX4 or its start script sets at the first boot, for example ids of detected sensors."""
_DEFAULTS = {"SENS_BOARD_X_OFF": 0.0, "SENS_DPRES_OFF": 0.0, "UXRCE_DDS_KEY": 1, "UXRCE_DDS_PTCFG": 0}
"""Defaults of parameters that PX4 sets at boot, except sensor ids (0) and priorities (-1)."""

_UNLISTED: dict[str, tuple[ParameterType, ParameterValue]] = {"MIS_TKO_LAND_REQ": ("INT32", 0)}
"""Parameters that PX4 knows but does not list, because no module has used them at boot; with defaults."""
UNLISTED_INDEX = 65535


class Change(Enum):
    """Kind of a change; PX4 reports set values, but not resets and statistics."""

    SET = "set"
    RESET = "reset"
    STATISTIC = "statistic"


class UnknownParameterError(KeyError):
    """The vehicle has no parameter with this name."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.name = name

    def __str__(self) -> str:
        return f"there is no parameter {self.name!r}; names are PX4's, upper case, up to 16 characters"


@dataclass(frozen=True, slots=True)
class BootParameter:
    """A parameter, and its value at boot."""

    name: str
    type: ParameterType
    value: ParameterValue
    index: int


@lru_cache(maxsize=4)
def load_boot_parameters(px4: Px4Version = DEFAULT) -> tuple[BootParameter, ...]:
    """The values at boot, in the order of PX4's list, which is that of the names."""
    entries: dict[str, tuple[str, ParameterValue]] = json.loads(DATA_FILE.read_text(encoding="utf-8"))
    entries |= px4.differences.get("added", {})
    entries |= {name: (entries[name][0], value) for name, value in px4.differences.get("values", {}).items()}
    for name in px4.differences.get("removed", ()):
        del entries[name]
    parameters: list[BootParameter] = []
    for index, (name, (json_type, value)) in enumerate(sorted(entries.items())):
        type_: ParameterType = "INT32" if json_type == "int32" else "FLOAT"
        parameters.append(BootParameter(name, type_, coerce(name, type_, value), index))
    return tuple(parameters)


def coerce(name: str, type_: ParameterType, value: ParameterValue) -> ParameterValue:
    """The value as PX4 stores it: a 32-bit integer (wrapping) or a single-precision float.

    Raises:
        ValueError: NaN or infinity for an integer parameter.
    """
    if type_ == "FLOAT":
        try:
            return struct.unpack("<f", struct.pack("<f", float(value)))[0]
        except OverflowError:
            return math.copysign(math.inf, value)
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{name} is an integer parameter and cannot hold {value}; give a whole number")
    return (int(value) + 2**31) % 2**32 - 2**31


def is_volatile(name: str) -> bool:
    """Whether PX4 changes the parameter by itself; such values are not part of the hash."""
    if name.startswith("CAL_"):
        return not name.endswith(_NOT_VOLATILE_CALIBRATION_SUFFIXES)
    return name in _VOLATILE_NAMES


class Parameters:
    """The parameter store of one vehicle.

    Args:
        overrides: values set at construction, as if stored before boot.
        storage: a JSON file that keeps changed values over restarts; read at construction, written at each
            change.
        px4: the version of PX4 that the vehicle simulates.
    """

    def __init__(
        self,
        overrides: Mapping[str, ParameterValue] | None = None,
        *,
        storage: Path | None = None,
        px4: Px4Version = DEFAULT,
    ) -> None:
        self.px4 = px4
        boot_parameters = load_boot_parameters(px4)
        self._names = tuple(each.name for each in boot_parameters)
        self._by_name = {each.name: each for each in boot_parameters} | {
            name: BootParameter(name, type_, value, UNLISTED_INDEX)
            for name, (type_, value) in _UNLISTED.items()
        }
        self._values: dict[str, ParameterValue] = {each.name: each.value for each in self._by_name.values()}
        self.mode_hashes = [0] * EXTERNAL_MODE_SLOTS
        """COM_MODE0_HASH to COM_MODE7_HASH, which PX4 lists only after an external mode has used them."""
        self._listeners: list[Listener] = []
        self.change = Change.SET
        """Kind of the current change, for the listeners."""
        self._storage: Path | None = None
        if storage is not None and storage.exists():
            self._load(storage)
            set_names = frozenset(overrides or ())
        else:
            set_names = _SET_AT_BOOT.union(overrides or ())
        for name, value in (overrides or {}).items():
            self.set(name, value)
        self.set_at_boot = tuple(name for name in self._names if name in set_names)
        """Names of parameters set at this boot by PX4, its start script or `overrides`."""
        self._storage = storage

    def __len__(self) -> int:
        return len(self._names)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._by_name

    @property
    def names(self) -> tuple[str, ...]:
        """All names in PX4's list order."""
        return self._names

    def items(self) -> Iterator[tuple[str, ParameterValue]]:
        """Name and value in PX4's list order."""
        return ((name, self._values[name]) for name in self._names)

    def get(self, name: str) -> ParameterValue:
        """The value: int for INT32, float for FLOAT.

        Raises:
            UnknownParameterError: no such name.
        """
        try:
            return self._values[name]
        except KeyError:
            raise UnknownParameterError(name) from None

    def finite_value(self, name: str) -> float:
        """The value that the simulation uses: the stored value, or the boot value instead of NaN or infinity.

        PX4 also stores NaN, but a NaN gain would stay in every integrator even after the gain was corrected.
        """
        value = float(self.get(name))
        return value if math.isfinite(value) else float(self._boot_parameter(name).value)

    def type_of(self, name: str) -> ParameterType:
        """INT32 or FLOAT."""
        return self._boot_parameter(name).type

    def index_of(self, name: str) -> int:
        """Position in PX4's list; `UNLISTED_INDEX` of a parameter that is not listed."""
        return self._boot_parameter(name).index

    def name_at(self, index: int) -> str | None:
        """The name at a position in PX4's list; None: no such position."""
        return self._names[index] if 0 <= index < len(self._names) else None

    def default_of(self, name: str) -> ParameterValue:
        """The boot value, which the log contains as the parameter's default."""
        return self._boot_parameter(name).value

    def set(self, name: str, value: ParameterValue) -> ParameterValue:
        """Stores a value and notifies the listeners if it changed; returns the stored value.

        Raises:
            UnknownParameterError: no such name.
            ValueError: NaN or infinity for an integer parameter.
        """
        stored = coerce(name, self._boot_parameter(name).type, value)
        if not _unchanged(self._values[name], stored):
            self._values[name] = stored
            self._save()
            for listener in tuple(self._listeners):
                listener(name, stored)
        return stored

    def reset(self, name: str) -> None:
        """Resets a parameter to its default, which differs from the boot value if PX4 or its start script
        sets the parameter at boot."""
        self._change(name, _reset_value(name, self._boot_parameter(name).value), Change.RESET)

    def reset_all(self, *, only: Sequence[str] = ("*",), keep: Sequence[str] = ()) -> None:
        """Resets all parameters that match a pattern of `only` and none of `keep`."""
        for name in self._names:
            if _matches(name, only) and not _matches(name, keep):
                self.reset(name)
        for slot in range(EXTERNAL_MODE_SLOTS):
            if _matches(_hash_name(slot), only) and not _matches(_hash_name(slot), keep):
                self.store_mode_hash(slot, 0)

    def store_mode_hash(self, slot: int, value: int) -> None:
        """Stores the hash of the name of the external mode in a slot; slots start at 0."""
        self.mode_hashes[slot] = value
        self._save()

    def store_statistic(self, name: str, value: ParameterValue) -> None:
        """Stores a statistic that PX4 itself counts; PX4 sends the value only on request."""
        self._change(name, value, Change.STATISTIC)

    def _change(self, name: str, value: ParameterValue, change: Change) -> None:
        self.change = change
        try:
            self.set(name, value)
        finally:
            self.change = Change.SET

    def changed_names(self) -> tuple[str, ...]:
        """Names of parameters that differ from the boot value, in PX4's list order."""
        return tuple(
            name for name, each in self._by_name.items() if not _unchanged(each.value, self._values[name])
        )

    def add_listener(self, listener: Listener) -> Callable[[], None]:
        """Calls `listener(name, value)` after each change; the returned function removes the listener."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def hash(self) -> int:
        """PX4's `_HASH_CHECK`: a raw CRC32 over names and values of all parameters that are not volatile."""
        content = bytearray()
        for name, value in self.items():
            if not is_volatile(name):
                content += name.encode("ascii")
                content += struct.pack("<i" if self._by_name[name].type == "INT32" else "<f", value)
        return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF

    def file(self) -> bytes:
        """PX4's parameter file: a BSON document of the parameters that were set at boot or changed, with
        floats as doubles."""
        set_names = {*self.set_at_boot, *self.changed_names()}
        content = bytearray()
        for name in sorted(set_names):
            is_integer = self._by_name[name].type == "INT32"
            content += (b"\x10" if is_integer else b"\x01") + name.encode("ascii") + b"\0"
            content += struct.pack("<i" if is_integer else "<d", self._values[name])
        return struct.pack("<i", len(content) + 5) + bytes(content) + b"\0"

    def _boot_parameter(self, name: str) -> BootParameter:
        try:
            return self._by_name[name]
        except KeyError:
            raise UnknownParameterError(name) from None

    def _load(self, storage: Path) -> None:
        try:
            stored = json.loads(storage.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ValueError(
                f"the parameter file {storage} cannot be read ({error}); repair or remove it"
            ) from error
        if not isinstance(stored, dict):
            raise ValueError(
                f"the parameter file {storage} does not contain an object of names and values; remove it"
            )
        for slot in range(EXTERNAL_MODE_SLOTS):
            self.mode_hashes[slot] = int(coerce(_hash_name(slot), "INT32", stored.get(_hash_name(slot), 0)))
        for name, value in stored.items():
            # A stored 0 means that the parameter was reset; PX4 sets sensor ids and airframe at each boot.
            if name in self._by_name and (value or not _is_set_at_every_boot(name)):
                number = float(value) if isinstance(value, str) else value
                self._values[name] = coerce(name, self._by_name[name].type, number)

    def _save(self) -> None:
        if self._storage is None:
            return
        values = {name: _to_json(self._values[name]) for name in self.changed_names()}
        values |= {_hash_name(slot): value for slot, value in enumerate(self.mode_hashes) if value}
        temporary = self._storage.with_name(self._storage.name + ".new")
        temporary.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("w", encoding="utf-8") as file:
            json.dump(values, file, indent=0)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(self._storage)


def _hash_name(slot: int) -> str:
    return f"COM_MODE{slot}_HASH"


def _matches(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _reset_value(name: str, boot_value: ParameterValue) -> ParameterValue:
    """The default; differs from the boot value if PX4 or its start script sets the parameter at boot."""
    if name.startswith("CAL_") and name.endswith("_PRIO"):
        return NO_PRIORITY
    return 0 if _is_set_at_every_boot(name) else _DEFAULTS.get(name, boot_value)


def _is_set_at_every_boot(name: str) -> bool:
    return name == "SYS_AUTOSTART" or (name.startswith("CAL_") and name.endswith("_ID"))


def _unchanged(old: ParameterValue, new: ParameterValue) -> bool:
    return old == new or (math.isnan(old) and math.isnan(new))


def _to_json(value: ParameterValue) -> ParameterValue | str:
    return value if math.isfinite(value) else str(value)
