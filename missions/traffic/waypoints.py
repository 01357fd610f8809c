"""The predicted path of a vehicle that flies a waypoint plan, or will fly it."""

from __future__ import annotations

from dataclasses import replace

from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.items import Land, ReturnHome
from missions.plan import Plan
from missions.route import route_of
from missions.traffic.path import (
    BY_DRY_RUN,
    BY_ESTIMATE,
    PredictedLeg,
    PredictedPath,
    along_legs,
    straight_to,
)
from missions.waypoints.planned import PlannedPasses


def lands(plan: Plan) -> bool:
    """Whether the plan ends with a landing or a return."""
    steps = route_of(plan).steps
    return bool(steps) and isinstance(steps[-1].item, Land | ReturnHome)


def predict_plan(
    vehicle: str,
    origin: LocalOrigin,
    planned: PlannedPasses,
    *,
    ends_in_air: bool,
    index: int = 0,
    t_s: float = 0.0,
    way_from: Vector3 | None = None,
    speed_m_s: float = 5.0,
) -> PredictedPath | None:
    """The rest of a planned flight; None: nothing is left, or it has no path.

    Args:
        vehicle: id of the vehicle.
        origin: origin of the local frame of `planned` and `way_from`.
        planned: the whole planned flight.
        ends_in_air: whether the vehicle stays in the air at the end of the plan.
        index: index of the pass that is flown now.
        t_s: planned time that is flown now.
        way_from: the position of a vehicle that is not on the planned path, and flies straight to the end of
            that pass; None: it is on the path.
        speed_m_s: the speed of that straight way.
    """
    rest = planned.passes[index:]
    if not rest:
        return None
    legs: list[PredictedLeg] = []
    if way_from is not None:
        first = rest[0].leg
        _, north, east, down = first.points[-1]
        way = straight_to(first.place, way_from, (north, east, down), speed_m_s)
        legs.append(way)
        # the rest begins when the vehicle is there
        t_s, rest = first.start_s + first.duration_s - way.leg.duration_s, rest[1:]
    legs += [PredictedLeg(replace(each.leg, start_s=each.leg.start_s - t_s)) for each in rest]
    accuracy = BY_DRY_RUN if planned.by == "dry_run" else BY_ESTIMATE
    path = along_legs(vehicle, origin, legs, accuracy, ends_in_air=ends_in_air)
    # a plan that repeats without end can be anywhere on its path at any later time
    return path.at_any_time() if path is not None and planned.duration_s is None else path
