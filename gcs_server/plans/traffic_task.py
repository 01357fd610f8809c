"""Predicts the flight of a waypoint plan that starts now, and compares it with the flights of other
vehicles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.plan import Plan
from missions.traffic.conflict import FIX, conflicts
from missions.traffic.path import PredictedPath
from missions.traffic.waypoints import ends_with_landing, predict_plan
from missions.values import HomePosition
from missions.vehicle import VehicleModel
from missions.waypoints.planned import PlannedPasses, estimate_passes
from missions.waypoints.resume import remaining_plan, resume_point

SEPARATION, SEPARATION_UNKNOWN = "separation", "separation_unknown"


@dataclass(frozen=True, slots=True)
class PlanStart:
    """Where and how the vehicle starts the plan."""

    vehicle: str
    model: VehicleModel
    origin: LocalOrigin
    home: LocalOrigin
    position_ned_m: Vector3
    in_air: bool
    item: int
    """Index of the item at which the vehicle starts."""


@dataclass(frozen=True, slots=True)
class Traffic:
    """The start of a plan, and the other vehicles in flight."""

    start: PlanStart | None
    """None: the vehicle's position is not known."""
    vehicle: str
    others: tuple[PredictedPath, ...]
    not_compared: tuple[str, ...]
    """Sentences about flying vehicles that cannot be compared."""


def predicted_path(
    start: PlanStart, plan: Plan, dry_run_passes: PlannedPasses | None
) -> PredictedPath | None:
    """The predicted path of the plan's flight; None: the plan has no path.

    Args:
        start: the start of the plan.
        plan: the plan.
        dry_run_passes: the path of a dry run of the plan; None: straight lines with estimated times.
    """
    item, flown_plan = start.item, plan
    home = HomePosition(
        lat_deg=start.home.lat_deg, lon_deg=start.home.lon_deg, alt_amsl_m=start.home.alt_amsl_m
    )
    if not start.in_air and item > 0:
        if isinstance(resume_point(plan, item), str):
            item = 0  # PX4 begins again at the first item
        else:
            flown_plan, dry_run_passes = remaining_plan(plan, item, home), None
    planned = dry_run_passes or estimate_passes(flown_plan, start.model, home, start.origin)
    if planned is None:
        return None
    index = 0
    if start.in_air:
        index = next((i for i, each in enumerate(planned.passes) if max(each.items) >= item), 0)
    return predict_plan(
        start.vehicle, start.origin, planned, ends_in_air=not ends_with_landing(flown_plan), index=index,
        current_position_ned_m=start.position_ned_m if start.in_air else None,
        speed_m_s=start.model.cruise_m_s,
    )  # fmt: skip


def path_not_known(vehicle: str) -> str:
    """The sentence about a vehicle whose path is not known."""
    return f"The path of vehicle {vehicle} is not known, so it is not compared with other vehicles."


def separation_findings(plan: Plan, traffic: Traffic) -> list[dict[str, Any]]:
    """Separation findings of a plan that starts now, as `FindingModel`; they are warnings, because the real
    time of the start is not known."""
    path = None if traffic.start is None else predicted_path(traffic.start, plan, None)
    if path is None and traffic.others:
        return [_finding(SEPARATION_UNKNOWN, path_not_known(traffic.vehicle), None, None)]
    found = () if path is None else conflicts(path, traffic.others)
    rows = {f"item {seq + 1}": row for seq, (row, _) in enumerate(plan.simple_items())}
    findings = [
        _finding(SEPARATION, f"If the plan starts now: {each.text}", rows.get(each.place), FIX)
        for each in found
    ]
    return findings + [_finding(SEPARATION_UNKNOWN, text, None, None) for text in traffic.not_compared]


def _finding(code: str, text: str, row: int | None, fix: str | None) -> dict[str, Any]:
    place = {"row": row, "zone": None, "rally_point": None, "obstacle": None, "step": None}
    return {"code": code, "severity": "warning", "text": text, "place": place, "fix": fix, "limit": None}
