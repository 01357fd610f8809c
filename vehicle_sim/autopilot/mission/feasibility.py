"""PX4's feasibility checks of a mission; they run after an upload, and when home or geofence change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vehicle_sim.autopilot.geofence import Cylinder, Zone, breaches
from vehicle_sim.autopilot.mission.items import (
    DELAY,
    GATE,
    JUMP,
    LAND,
    SUPPORTED,
    TAKEOFF,
    VTOL_LAND,
    VTOL_TAKEOFF,
    VTOL_TRANSITION,
    Item,
)


@dataclass(frozen=True, slots=True)
class FeasibilityInputs:
    """State, fence and parameters on which the feasibility of a mission depends."""

    home_valid: bool
    home_alt_amsl_m: float
    altitude_acceptance_m: float
    """NAV_MC_ALT_RAD."""
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
    """All findings about a mission, in PX4's order."""
    findings: list[Finding] = []
    for seq, item in enumerate(items):
        findings += _item_findings(seq, item, inputs)
    findings += _takeoff_findings(items, inputs)
    findings += _vtol_findings(items)
    findings += _missing_item_findings(items, inputs)
    findings += _fence_findings(items, inputs)
    return tuple(findings)


def _item_findings(seq: int, item: Item, inputs: FeasibilityInputs) -> list[Finding]:
    if item.command not in SUPPORTED:
        return [Finding("navigator_mis_unsup_cmd", "HH", (seq + 1, item.command))]
    if item.is_position and item.relative and not inputs.home_valid:
        return [Finding("navigator_mis_no_home_rel_alt", "h", (seq + 1,))]
    return []


def _takeoff_findings(items: Sequence[Item], inputs: FeasibilityInputs) -> list[Finding]:
    findings: list[Finding] = []
    for seq, item in enumerate(items):
        if item.command not in (TAKEOFF, VTOL_TAKEOFF):
            continue
        height_m = item.alt_m if item.relative else item.alt_m - inputs.home_alt_amsl_m
        min_height_m = inputs.altitude_acceptance_m + 1.0
        if inputs.home_valid and height_m < min_height_m:
            findings.append(Finding("navigator_mis_takeoff_too_low", "f", (min_height_m,)))
        previous_items = items[:seq]
        if any(each.is_position or each.command in (DELAY, JUMP, GATE) for each in previous_items):
            findings.append(Finding("navigator_mis_takeoff_not_first"))
    return findings


def _vtol_findings(items: Sequence[Item]) -> list[Finding]:
    if any(item.command in (VTOL_TAKEOFF, VTOL_LAND, VTOL_TRANSITION) for item in items):
        return [Finding("navigator_mis_vtol_items")]
    return []


def _missing_item_findings(items: Sequence[Item], inputs: FeasibilityInputs) -> list[Finding]:
    has_takeoff = any(item.command == TAKEOFF for item in items)
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
