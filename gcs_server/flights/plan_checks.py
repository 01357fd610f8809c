"""Checks a plan with the data that the server has about a vehicle."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING

import msgspec

from gcs_server.errors import NotYet, PlanFindings
from gcs_server.flights.readings import reported_values
from gcs_server.flights.traffic import traffic_of
from gcs_server.plans.tasks import Answer
from gcs_server.plans.work import SMALL_BYTES
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.vehicle.samples import Home
from gcs_server.vehicle.vehicle import Vehicle
from missions import documents
from missions.errors import PlanError
from missions.geodesy import distance_m
from missions.offboard.state import OperatorArea
from missions.pattern_settings import CorridorPattern, OrbitPattern, PerimeterPattern, StructurePattern
from missions.patterns import document as pattern_document
from missions.trajectory.limits import PARAMETERS as MOTION_PARAMETERS
from missions.values import HomePosition
from missions.vehicle import PARAMETERS

if TYPE_CHECKING:
    from gcs_server.flights.flights import Flights

SMALL_CORNERS, SMALL_LINES = 50, 60
"""Maximum numbers of corners and lines of a pattern that is generated in a thread."""


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
    flights: Flights,
    text: bytes,
    vehicle: Vehicle | None,
    power: dict[str, float] | None = None,
    *,
    home: HomePosition | None = None,
    compare_with_others: bool = False,
) -> Answer:
    """Findings and estimates of a plan for a vehicle; the body of the answer is a `PlanCheck`.

    Args:
        flights: all that flies plans.
        text: the plan as JSON text.
        vehicle: the vehicle; None: the plan's own home, and PX4's default parameters.
        power: electrical power and battery of the vehicle, for the energy estimate.
        home: home position to use instead of the vehicle's.
        compare_with_others: whether the findings also compare a waypoint plan with the flights of other
            vehicles, for a start now; they are warnings, because the real time of the start is not known.
    """
    context = plan_context_of(flights, vehicle)
    arguments = {
        "plan": text,
        "parameters": context.parameters,
        "unknown_parameters": context.unknown_parameters,
        "home": context.home if home is None else home.model_dump(),
        "origin": context.origin,
        "reported": context.reported,
        "operator": context.operator.to_json(),
        "power": power,
        "traffic": await traffic_of(flights, vehicle)
        if vehicle is not None and compare_with_others
        else None,
        "vehicle": None if vehicle is None else vehicle.id,
        "not_known": context.not_known,
    }
    # An offboard mission of any size may take seconds to compile.
    small = len(text) <= SMALL_BYTES and documents.MISSION_FORMAT.encode() not in text
    return await flights.plan_work.run("check", arguments, small=small)


class CheckFinding(msgspec.Struct, frozen=True):
    """What the server itself needs of a finding."""

    code: str
    severity: str
    text: str


class _CheckBody(msgspec.Struct):
    findings: list[CheckFinding]


async def findings_of(check: Answer) -> list[CheckFinding]:
    """The findings in the answer of `check_document`; read in a thread, because the answer may be long."""
    return (await asyncio.to_thread(msgspec.json.decode, check.body, type=_CheckBody)).findings


@dataclass(frozen=True, slots=True)
class ErrorGroup:
    """Errors of one kind: of the plan, of the flight from the vehicle's position, or of the separation."""

    message_start: str
    """Beginning of the message; the text of the first error follows."""
    errors: tuple[tuple[str, str], ...]
    """Codes and texts."""
    remedy: str

    def unaccepted(self, despite: Collection[str]) -> ErrorGroup:
        """The errors whose codes are not in `despite`."""
        return replace(self, errors=tuple(each for each in self.errors if each[0] not in despite))


def require_accepted(groups: Sequence[ErrorGroup], despite: Collection[str]) -> None:
    """Raises PlanFindings with all errors of all groups that the caller has not accepted."""
    remaining = [each for each in (group.unaccepted(despite) for group in groups) if each.errors]
    if not remaining:
        return
    all_errors = [error for group in remaining for error in group.errors]
    raise PlanFindings(
        " ".join(f"{group.message_start} {group.errors[0][1]}" for group in remaining),
        codes=tuple(dict.fromkeys(code for code, _ in all_errors)),
        reasons=tuple(text for _, text in all_errors),
        remedy=" ".join(group.remedy for group in remaining),
    )


def is_small_pattern(text: bytes) -> bool:
    """Whether a pattern (as JSON text of at most SMALL_BYTES) is small enough for a thread, in about 50
    ms."""
    try:
        pattern = pattern_document.read(text)
    except PlanError:
        return True  # the task says why it cannot be used
    if isinstance(pattern, OrbitPattern | PerimeterPattern):
        return True
    if isinstance(pattern, StructurePattern):
        return len(pattern.outline) <= SMALL_CORNERS
    spacing_m = pattern_document.coverage_of(pattern.coverage).spacing_m
    if isinstance(pattern, CorridorPattern):
        return len(pattern.points) <= SMALL_CORNERS and pattern.width_m <= SMALL_LINES * spacing_m
    corners = [*pattern.outer, *(corner for hole in pattern.holes for corner in hole)]
    lats, lons = [each.lat_deg for each in corners], [each.lon_deg for each in corners]
    if not 0 < len(corners) <= SMALL_CORNERS:
        return False
    return distance_m(min(lats), min(lons), max(lats), max(lons)) <= SMALL_LINES * spacing_m


def take_off_position_of(vehicle: Vehicle) -> dict[str, float]:
    """The present place of a vehicle, from which it will take off: `lat_deg`, `lon_deg`, `alt_amsl_m`.

    Raises:
        NotYet: the position is unknown.
    """
    estimates = VehicleEstimates(vehicle)
    local, origin = estimates.local(), estimates.origin()
    if local is None or origin is None or not estimates.has_position():
        raise NotYet(
            f"Vehicle {vehicle.id} has no valid global position.",
            remedy="Wait for GPS and the estimator (see the vehicle's messages), or leave it out.",
        )
    lat_deg, lon_deg, alt_amsl_m = origin.to_geodetic(local.position_ned_m)
    return {"lat_deg": lat_deg, "lon_deg": lon_deg, "alt_amsl_m": alt_amsl_m}


def plan_context_of(flights: Flights, vehicle: Vehicle | None) -> PlanContext:
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
    limits = flights.offboard(vehicle.id).operator_limits.limits
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
