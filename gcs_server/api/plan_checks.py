"""Checks a plan with the data that the server has about a vehicle."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from gcs_server.api.station import Station
from gcs_server.streamer.missions.readings import reported_values
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.samples import Home
from gcs_server.vehicle.vehicle import Vehicle
from missions import documents
from missions.documents import Document
from missions.geodesy import distance_m
from missions.offboard.document import OffboardMission
from missions.offboard.state import OperatorArea
from missions.patterns.document import (
    CorridorPattern,
    OrbitPattern,
    PatternDocument,
    PerimeterPattern,
    StructurePattern,
)
from missions.trajectory.limits import PARAMETERS as MOTION_PARAMETERS
from missions.values import HomePosition
from missions.vehicle import PARAMETERS

SMALL_ITEMS = 300
"""Maximum number of items and corners of a plan that is checked or written in a thread, in about 30 ms;
larger plans need a process."""
SMALL_CORNERS, SMALL_LINES = 50, 60
"""Maximum numbers of corners and lines of a pattern that is generated in a thread."""
SMALL_MISSION_BYTES = 8_192
"""Maximum size of a mission that is written in a thread [bytes]; a mission is always checked in a process."""


@dataclass(frozen=True, slots=True)
class PlanContext:
    """A vehicle's data for the check of a plan; empty without a vehicle."""

    parameters: dict[str, float] = field(default_factory=dict[str, float])
    """Parameters by PX4 name."""
    unknown_parameters: tuple[str, ...] = ()
    """PX4 names of the parameters that the checks of an offboard mission need and whose values are
    unknown."""
    home: dict[str, float] | None = None
    """Home position: `lat_deg`, `lon_deg`, `alt_amsl_m`."""
    origin: dict[str, float] | None = None
    """Origin of the local frame, with the same keys as `home`."""
    not_known: tuple[str, ...] = ()
    """Sentences about unknown values."""
    reported: tuple[str, ...] | None = None
    """Names of the condition values that the vehicle reports; None without a vehicle."""
    operator: OperatorArea = field(default_factory=OperatorArea)
    """The operator's limits for this vehicle."""


async def check_document(
    station: Station,
    document: Document,
    vehicle: Vehicle | None,
    power: dict[str, float] | None = None,
    *,
    home: HomePosition | None = None,
) -> dict[str, Any]:
    """Findings and estimates of a plan for a vehicle, with the fields of `PlanCheck`.

    Args:
        station: the running server.
        document: the plan.
        vehicle: the vehicle; None: the plan's own home, and PX4's default parameters.
        power: electrical power and battery of the vehicle, for the energy estimate.
        home: home position to use instead of the vehicle's.
    """
    context = plan_context_of(station, vehicle)
    unknown_parameters = context.unknown_parameters
    if not isinstance(document, OffboardMission):
        unknown_parameters = tuple(name for name in unknown_parameters if name in PARAMETERS.values())
    arguments = {
        "plan": text_of(document),
        "parameters": context.parameters,
        "unknown_parameters": unknown_parameters,
        "home": context.home if home is None else home.model_dump(),
        "origin": context.origin,
        "reported": context.reported,
        "operator": context.operator.to_json(),
        "power": power,
    }
    small = not isinstance(document, OffboardMission) and is_small(document)
    result = await station.plan_work.run("check", arguments, small=small)
    not_known = (*context.not_known, *result.pop("ground_not_known"))
    return {**result, "vehicle": None if vehicle is None else vehicle.id, "not_known": not_known}


def text_of(document: Document) -> str:
    """The document as JSON text."""
    return documents.write(document).decode()


def is_small(document: Document) -> bool:
    """Whether a plan is small enough for a thread; other plans need a process."""
    if isinstance(document, OffboardMission):
        return len(documents.write(document)) <= SMALL_MISSION_BYTES
    corners = sum(len(zone.polygon) for zone in document.fence if zone.shape == "polygon")
    corners += sum(len(obstacle.polygon) for obstacle in document.obstacles)
    size = documents.count_steps(document) + corners + len(document.fence) + len(document.rally_points)
    return size <= SMALL_ITEMS


def is_small_pattern(pattern: PatternDocument) -> bool:
    """Whether a pattern is small enough for a thread, in about 50 ms; larger patterns need a process. The
    page requests a pattern after each change of a field, and a process takes a second to start."""
    if isinstance(pattern, OrbitPattern | PerimeterPattern):
        return True
    if isinstance(pattern, StructurePattern):
        return len(pattern.outline) <= SMALL_CORNERS
    spacing_m = pattern.coverage.to_coverage().spacing_m
    if isinstance(pattern, CorridorPattern):
        return len(pattern.points) <= SMALL_CORNERS and pattern.width_m <= SMALL_LINES * spacing_m
    corners = [*pattern.outer, *(corner for hole in pattern.holes for corner in hole)]
    lats, lons = [each.lat_deg for each in corners], [each.lon_deg for each in corners]
    if not 0 < len(corners) <= SMALL_CORNERS:
        return False
    return distance_m(min(lats), min(lons), max(lats), max(lons)) <= SMALL_LINES * spacing_m


def plan_context_of(station: Station, vehicle: Vehicle | None) -> PlanContext:
    """The data that the server has about a vehicle."""
    if vehicle is None:
        return PlanContext()
    not_known: list[str] = []
    params = {
        name: vehicle.params.known(name) for name in {*PARAMETERS.values(), *MOTION_PARAMETERS.values()}
    }
    parameters = {name: float(param.value) for name, param in params.items() if param is not None}
    # A parameter that is missing in a complete list does not exist in this PX4 build.
    is_complete = vehicle.params.list.state == "ready"
    unknown_parameters = (
        () if is_complete else tuple(sorted(name for name in params if name not in parameters))
    )
    limits = station.offboard(vehicle.id).operator_limits.limits
    operator = OperatorArea(limits.height_max_m, limits.distance_max_m, limits.fence)
    sample = vehicle.topic("home")
    if sample is None:
        not_known.append(f"The home of vehicle {vehicle.id} is not known: the plan's home is used.")
        return PlanContext(
            parameters,
            unknown_parameters,
            not_known=tuple(not_known),
            reported=reported_values(vehicle),
            operator=operator,
        )
    assert isinstance(sample.value, Home)
    home = {name: getattr(sample.value, name) for name in ("lat_deg", "lon_deg", "alt_amsl_m")}
    origin = VehicleEstimates(vehicle).origin()
    return PlanContext(
        parameters,
        unknown_parameters,
        home,
        None if origin is None else asdict(origin),
        tuple(not_known),
        reported_values(vehicle),
        operator,
    )
