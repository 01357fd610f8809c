"""Converts a SimpleItem of a .plan file to a mission item, and back."""

from __future__ import annotations

import math
from typing import Any

from pydantic import ValidationError

from missions import bounded_json
from missions.errors import PlanError, from_validation
from missions.formats.mavlink_items import FILE_FRAME, frame_of, item_from_params, params_of
from missions.items import CommandItem, PlacedItem
from missions.plan import SimpleItem
from missions.values import Altitude, Reference

_RELATIVE, _ABSOLUTE, _CALCULATED_ABOVE_TERRAIN, _TERRAIN_FRAME = 1, 2, 3, 4
"""QGroundControl's AltitudeMode."""
_MODE: dict[Reference, int] = {"home": _RELATIVE, "amsl": _ABSOLUTE, "terrain": _TERRAIN_FRAME}
_MAV_FRAME_GLOBAL = 0


def require_object(raw: Any, place: str) -> dict[str, Any]:
    """Returns the value if it is a JSON object.

    Raises:
        PlanError: The value is not an object.
    """
    if not isinstance(raw, dict):
        raise PlanError(place, "it is missing or not an object", "Export the plan again.")
    return raw


def require_list(raw: Any, place: str) -> list[Any]:
    """Returns the value if it is a JSON list.

    Raises:
        PlanError: The value is not a list.
    """
    if not isinstance(raw, list):
        raise PlanError(place, "it is missing or not a list", "Export the plan again.")
    return raw


def optional_list(parent: dict[str, Any], key: str, name: str) -> list[Any]:
    """A list inside an object; empty if the key is missing.

    Raises:
        PlanError: The value is not a list.
    """
    return require_list(parent.get(key, []), f"field {name}.{key}")


def require_number(raw: Any, place: str) -> float:
    """Returns the value if it is a finite number.

    Raises:
        PlanError: The value is not a finite number.
    """
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        raise PlanError(place, "it is missing or not a number", "Write a number.")
    if not math.isfinite(raw) or abs(raw) > 1e9:
        raise PlanError(place, "it is out of range", "Correct this value.")
    return float(raw)


def _integer(part: dict[str, Any], key: str, place: str) -> int:
    value = require_number(part.get(key), f"{place}, field {key}")
    if not value.is_integer():
        raise PlanError(f"{place}, field {key}", "it is not a whole number", "Write a whole number.")
    return int(value)


def read_simple(part: dict[str, Any], place: str) -> SimpleItem:
    """Reads a SimpleItem; the target of a jump remains the doJumpId of the file.

    Raises:
        PlanError: A value is wrong; the message starts with `place`.
    """
    command, frame = _integer(part, "command", place), _integer(part, "frame", place)
    raw_params = require_list(part.get("params"), f"{place}, field params")
    if len(raw_params) != 7:
        raise PlanError(
            f"{place}, field params", f"it has {len(raw_params)} values, not 7", "Write seven values."
        )
    params = tuple(
        None if raw is None else require_number(raw, f"{place}, field params[{n}]")
        for n, raw in enumerate(raw_params)
    )
    autocontinue = part.get("autoContinue", True)
    if not isinstance(autocontinue, bool):
        raise PlanError(
            f"{place}, field autoContinue", "it is neither true nor false", "Write true or false."
        )
    try:
        item = item_from_params(
            command, frame, params, autocontinue=autocontinue, original=bounded_json.dump(part)
        )
    except PlanError as error:
        raise PlanError(f"{place}, {error.place}", error.reason, error.fix) from None
    altitude = part.get("Altitude")
    if (
        isinstance(item, PlacedItem)
        and part.get("AltitudeMode") == _CALCULATED_ABOVE_TERRAIN
        and item.altitude.reference == "amsl"
        and altitude is not None
    ):
        return item.model_copy(update={"altitude": _above_terrain(altitude, item.altitude.value_m, place)})
    return item


def _above_terrain(altitude: Any, amsl_m: float, place: str) -> Altitude:
    try:
        value_m = require_number(altitude, f"{place}, field Altitude")
        return Altitude(value_m=value_m, reference="terrain", resolved_amsl_m=amsl_m)
    except ValidationError as error:
        invalid = from_validation(error)
        raise PlanError(f"{place}, field Altitude", invalid.reason, invalid.fix) from None


def jump_id(part: dict[str, Any], index: int) -> int:
    """The doJumpId of an item; without a doJumpId, the number of the item, counted from 1."""
    value = part.get("doJumpId")
    return value if isinstance(value, int) and not isinstance(value, bool) else index + 1


def original_jump_id(item: SimpleItem) -> int | None:
    """The doJumpId of an item in the file that it was read from."""
    if item.original is None:
        return None
    value = require_object(bounded_json.load(item.original), "field original").get("doJumpId")
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def simple_object(item: SimpleItem, item_jump_id: int) -> dict[str, Any]:
    """A SimpleItem as QGroundControl writes it."""
    params = [_int_if_whole(value) for value in params_of(item)]
    frame = frame_of(item, FILE_FRAME)
    command = item.command if isinstance(item, CommandItem) else item.COMMAND
    altitude: dict[str, Any] = {}
    if isinstance(item, PlacedItem):
        amsl_m = item.altitude.resolved_amsl_m
        mode = _MODE[item.altitude.reference]
        if amsl_m is not None:
            frame, mode, params[6] = _MAV_FRAME_GLOBAL, _CALCULATED_ABOVE_TERRAIN, _int_if_whole(amsl_m)
        altitude = {
            "AMSLAltAboveTerrain": None if amsl_m is None else _int_if_whole(amsl_m),
            "Altitude": _int_if_whole(item.altitude.value_m),
            "AltitudeMode": mode,
        }
    return {
        **altitude,
        "autoContinue": item.autocontinue,
        "command": command,
        "doJumpId": item_jump_id,
        "frame": frame,
        "params": params,
        "type": "SimpleItem",
    }


def _int_if_whole(value: float | None) -> float | int | None:
    """Converts whole numbers to int, so that they are written without a decimal point."""
    return int(value) if value is not None and float(value).is_integer() else value
