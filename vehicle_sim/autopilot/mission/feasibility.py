"""PX4's feasibility checks of a mission; they run after an upload, and when home or geofence change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vehicle_sim.autopilot.geofence import Cylinder, Zone, breaches
from vehicle_sim.autopilot.mission.items import (
    GATE,
    GRIPPER,
    LAND,
    POSITION_ITEMS,
    RETURN,
    SET_ACTUATOR,
    SUPPORTED,
    TAKEOFF,
    VTOL_LAND,
    VTOL_TAKEOFF,
    VTOL_TRANSITION,
    WINCH,
    Item,
)

_NOT_BEFORE_TAKEOFF = POSITION_ITEMS | {RETURN, GATE, SET_ACTUATOR, GRIPPER, WINCH}
"""Items after which PX4 finds that a take-off is not the first item."""
_MIN_TAKEOFF_HEIGHT_M = 1.2e-7
"""Smallest single-precision step at 1: a take-off must be above home."""


@dataclass(frozen=True, slots=True)
class FeasibilityInputs:
    """State, fence and parameters on which the feasibility of a mission depends."""

    home_valid: bool
    home_alt_amsl_m: float
    zones: tuple[Zone, ...]
    cylinder: Cylinder
    landed: bool
    required_items: int
    """MIS_TKO_LAND_REQ: 1 take-off, 2 landing, 3 both, 4 both or none, 5 as 4, but in the air a landing."""
    fence_active: bool
    """GF_ACTION is not 0."""


@dataclass(frozen=True, slots=True)
class Finding:
    """An event about a mission, and whether PX4 rejects the mission because of this finding."""

    event: str
    argument_format: str = ""
    arguments: tuple[float, ...] = ()
    rejects: bool = True


def check(items: Sequence[Item], inputs: FeasibilityInputs) -> tuple[Finding, ...]:
    """All findings about a mission, in PX4's order.

    PX4 reports one finding of each kind. After an item that it cannot use, it checks only the fence.
    """
    findings: list[Finding] = []
    has_position = has_vtol_finding = has_takeoff_finding = False
    for seq, item in enumerate(items):
        unusable = _unusable_item(seq, item, inputs)
        if unusable is not None:
            return (*findings, unusable, *_fence_findings(items, inputs))
        if item.command in (TAKEOFF, VTOL_TAKEOFF) and not has_takeoff_finding:
            takeoff = _takeoff_finding(item, inputs, is_first=not has_position)
            findings += [takeoff] if takeoff is not None else []
            has_takeoff_finding = takeoff is not None
        has_position |= item.command in _NOT_BEFORE_TAKEOFF
        if item.command in (VTOL_TAKEOFF, VTOL_LAND, VTOL_TRANSITION) and not has_vtol_finding:
            has_vtol_finding = True
            findings.append(Finding("navigator_mis_vtol_items"))
    findings += _missing_item_findings(items, inputs)
    findings += _fence_findings(items, inputs)
    return tuple(findings)


def _unusable_item(seq: int, item: Item, inputs: FeasibilityInputs) -> Finding | None:
    if item.is_position and item.relative and not inputs.home_valid:
        return Finding("navigator_mis_no_home_rel_alt", "h", (seq + 1,))
    if item.command not in SUPPORTED:
        return Finding("navigator_mis_unsup_cmd", "HH", (seq + 1, item.command))
    if seq == 0 and item.command == LAND and inputs.landed:
        return Finding("navigator_mis_starts_w_landing")
    return None


def _takeoff_finding(item: Item, inputs: FeasibilityInputs, *, is_first: bool) -> Finding | None:
    if _too_low(item, inputs):
        return Finding("navigator_mis_takeoff_too_low", "f", (_lowest_m(item, inputs),))
    return None if is_first else Finding("navigator_mis_takeoff_not_first")


def _too_low(takeoff: Item, inputs: FeasibilityInputs) -> bool:
    """Whether a take-off does not end above home; False for an altitude of NaN, as in PX4."""
    return takeoff.alt_m - _lowest_m(takeoff, inputs) < _MIN_TAKEOFF_HEIGHT_M


def _lowest_m(takeoff: Item, inputs: FeasibilityInputs) -> float:
    return 0.0 if takeoff.relative else inputs.home_alt_amsl_m


def _missing_item_findings(items: Sequence[Item], inputs: FeasibilityInputs) -> list[Finding]:
    first_takeoff = next((item for item in items if item.command in (TAKEOFF, VTOL_TAKEOFF)), None)
    has_takeoff = first_takeoff is not None and not _too_low(first_takeoff, inputs)
    has_landing = any(item.command == LAND for item in items)
    match inputs.required_items:
        case 1 if not has_takeoff:
            return [Finding("navigator_mis_takeoff_missing")]
        case 2 if not has_landing:
            return [Finding("navigator_mis_land_missing")]
        case 3 if not (has_takeoff and has_landing):
            return [Finding("navigator_mis_takeoff_or_land_missing")]
        case 5 if not inputs.landed:
            return [] if has_landing else [Finding("feasibility_mis_in_air_landing_req")]
        case 4 | 5 if has_takeoff != has_landing:
            name = "navigator_mis_add_land_or_rm_to" if has_takeoff else "navigator_mis_add_to_or_rm_land"
            return [Finding(name)]
        case _:
            return []


def _fence_findings(items: Sequence[Item], inputs: FeasibilityInputs) -> list[Finding]:
    if not inputs.fence_active:
        return []
    if not inputs.home_valid and max(inputs.cylinder.radius_m, inputs.cylinder.height_m) > 0.0:
        return [Finding("navigator_mis_geofence_no_home")]
    for seq, item in enumerate(items):
        if not item.is_position or not math.isfinite(item.lat_deg):
            continue
        alt = item.alt_amsl_m(inputs.home_alt_amsl_m)
        if breaches(inputs.zones, inputs.cylinder, item.lat_deg, item.lon_deg, alt):
            return [Finding("navigator_mis_geofence_violation", "h", (seq + 1,))]
    return []
