"""Request and response bodies of the routes for plans.

The documents are defined in `missions`, which checks their JSON; its errors name the item and the fix.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gcs_server.api.documents import DocumentBody, PlanBody
from gcs_server.api.group_models import VehicleId, require_unique
from gcs_server.api.reflect import model_of
from gcs_server.api.strict_body import ResponseBody, StrictBody
from gcs_server.plans.files import PlanVersion
from missions.checks import CODES
from missions.documents import PlanKind
from missions.estimates import Estimate
from missions.formats.any_format import FormatName
from missions.formats.results import AreaUseName
from missions.geodesy import LocalOrigin
from missions.offboard.document import MAX_ROLES, MINIMUM_SEPARATION_M, OffboardMission
from missions.offboard.roles import PlannedDistance
from missions.offboard.samples import Leg, StepTime
from missions.offboard.tables import ImportedTable
from missions.plan import MAX_ITEMS, Plan
from missions.values import Altitude, DisplayText, FenceZone, Point

MAX_NAME_LENGTH = 100


AnyDocument = Annotated[Plan | OffboardMission, Field(discriminator="format")]


Name = Annotated[
    DisplayText,
    Field(
        min_length=1,
        max_length=MAX_NAME_LENGTH,
        pattern=r"\S",
        description="Name of the plan.",
    ),
]


class NewPlan(StrictBody):
    """A new plan to store."""

    name: Name
    plan: DocumentBody


class ChangedPlan(NewPlan):
    """A plan's next version."""

    base_version: int = Field(ge=1)
    """Version that was changed; 409 if it is not the newest."""


class Power(StrictBody):
    """Values for the energy estimate: constant power in flight, plus the energy for climbing."""

    hover_power_w: float = Field(gt=0, le=1e6)
    """Electrical power to hover [W]."""
    battery_wh: float = Field(gt=0, le=1e6)
    """Energy of the full battery [Wh]."""
    mass_kg: float = Field(gt=0, le=1e4)
    """Mass with battery and payload [kg]."""
    reserve: float = Field(default=0.2, ge=0, lt=1)
    """Fraction of the battery that is kept as reserve."""


class PlanToCheck(StrictBody):
    """The plan to check."""

    plan: DocumentBody
    vehicle: str | None = Field(default=None, max_length=32)
    """Use this vehicle's parameters and home if they are known."""

    power: Power | None = None
    """For the energy estimate; null: energy and endurance are not checked."""


class PlanToFollowGround(StrictBody):
    """The waypoint plan whose altitudes above the ground are resolved."""

    plan: PlanBody
    tolerance_m: float | None = Field(default=None, ge=1.0, le=1000.0, allow_inf_nan=False)
    """Tolerance of the height above the ground [m]: waypoints are added until the straight lines stay within
    it; null: no waypoints are added."""


class PlanToExport(StrictBody):
    """The plan to export."""

    plan: DocumentBody


class PlanToConvert(StrictBody):
    """The waypoint plan to convert into an offboard mission."""

    plan: PlanBody
    name: Name
    vehicle: str | None = Field(default=None, max_length=32)
    """Use this vehicle's parameters and home if they are known."""


class SurveyToDivide(StrictBody):
    """A survey of a plan, and the vehicles over which it is divided."""

    plan: PlanBody
    item: int | None = Field(default=None, ge=0, lt=MAX_ITEMS)
    """Index of the survey in `items` of the plan; default: its only survey."""
    vehicles: list[VehicleId] | None = Field(default=None, min_length=2, max_length=MAX_ROLES)
    """The vehicles, at their present places; not with `count`."""
    count: int | None = Field(default=None, ge=2, le=MAX_ROLES)
    """Number of vehicles, if they are not chosen yet: their take-off positions are planned in a row to the
    east of the plan's home."""
    minimum_separation_m: float = Field(default=MINIMUM_SEPARATION_M, ge=1.0, le=100.0, allow_inf_nan=False)
    """Minimum distance of any two vehicles, also if both brake [m]."""
    name: Name
    """Name of the mission."""

    @model_validator(mode="after")
    def _check_vehicles(self) -> Self:
        if (self.vehicles is None) == (self.count is None):
            raise ValueError("give vehicles or count")
        require_unique(self.vehicles or [], "vehicles")
        return self


class DividedPart(ResponseBody):
    """The part of one vehicle."""

    role: str
    """Role of the mission."""
    vehicle: str | None
    """The vehicle whose place the part was made for; null: only a number was given."""
    lines: list[tuple[Point, Point]]
    """Its lines in flight order and direction; a line of the survey may be cut in two."""
    layer_m: float
    """Height of its way out and back above the lines [m]."""


class DividedSurvey(ResponseBody):
    """A survey divided over several vehicles; nothing is saved."""

    plan: OffboardMission
    """The mission, with a role for each part. `POST /plans/check` gives times and distances."""
    parts: list[DividedPart]
    """The parts, from one side of the area to the other."""
    notes: list[str]
    """What the mission does not contain, as sentences."""


PlanVersionModel = model_of(PlanVersion, "PlanVersion")
EstimateModel = model_of(Estimate, "PlanEstimates")


class PlanList(ResponseBody):
    """All plans."""

    plans: list[PlanVersionModel]  # type: ignore[valid-type]
    """Newest version of each plan, by name."""


class PlanVersions(ResponseBody):
    """The stored versions of one plan."""

    versions: list[PlanVersionModel]  # type: ignore[valid-type]
    """Newest first."""


class KeptPlan(PlanVersionModel):  # type: ignore[misc,valid-type]
    """A version of a plan, with its document."""

    plan: AnyDocument = Field(description="The plan's document.")


class FindingPlace(ResponseBody):
    """The part of the plan that the finding is about; all null: the whole plan."""

    row: int | None
    """Index in `items`."""
    zone: int | None
    """Index in `fence`."""
    rally_point: int | None
    """Index in `rally_points`."""
    obstacle: int | None
    """Index in `obstacles`."""
    step: str | None
    """Step of an offboard mission: `step 3`, `step 4.2`."""


class FindingModel(ResponseBody):
    """One problem of a plan."""

    code: str = Field(examples=[next(iter(CODES))])
    """Stable code; `docs/missions.md` lists all."""
    severity: Literal["error", "warning"]
    """error: PX4 refuses the plan, or it is unsafe; warning: check the plan."""
    text: str
    """Message for the pilot."""
    place: FindingPlace
    """The part of the plan that the finding is about."""
    fix: str | None
    """How to correct the problem."""
    limit: float | None
    """The limit that the plan was checked against: altitude above home [m], speed [m/s], tilt [rad] or
    minimum time [s]; null: no limit. The page uses it to correct the plan."""


LegModel = model_of(Leg, "PlanLeg")
StepTimeModel = model_of(StepTime, "PlanStepTime")
PlannedDistanceModel = model_of(PlannedDistance, "PlannedDistance")
OriginModel = model_of(LocalOrigin, "PlanOrigin")


class RoleFlight(ResponseBody):
    """The planned flight of one role."""

    role: str
    """Name of the role."""
    time_s: float
    """Time from arming to disarming, without waiting for other roles."""
    length_m: float
    """Length of the path."""
    photos: int
    """Number of photos."""


class OffboardFlight(ResponseBody):
    """The planned flight of an offboard mission, starting on the ground at home."""

    steps: list[StepTimeModel]  # type: ignore[valid-type]
    """Steps in flight order; at a branch, those of the longest path."""
    legs: list[LegModel]  # type: ignore[valid-type]
    """The segments of the path, on all branches."""
    roles: list[RoleFlight]
    """The flight of each role; empty for one vehicle."""
    closest: list[PlannedDistanceModel]  # type: ignore[valid-type]
    """The smallest planned distance of each pair of roles; empty for one vehicle, and if the places are not
    known."""
    needs: list[str]
    """The estimates that the vehicle must have."""
    start_ned_m: tuple[float, float, float]
    """Start position, from the local origin [m]."""
    origin: OriginModel | None  # type: ignore[valid-type]
    """Global position of the local origin; null if unknown."""


class PlanCheck(ResponseBody):
    """Findings and estimates of a plan."""

    kind: PlanKind
    """Which kind of plan it is."""
    findings: list[FindingModel]
    """Findings in the order of the checks; empty: no problem was found."""
    estimates: EstimateModel  # type: ignore[valid-type]
    """Estimates of the whole flight."""
    flight: OffboardFlight | None
    """The planned flight of an offboard mission; null for a waypoint plan."""
    vehicle: str | None
    """Vehicle for which the plan was checked."""
    ground: list[tuple[float, float | None]]
    """The ground below the flight: distance along the flight [m], and altitude of the ground above home, or
    above the start of an offboard mission [m]; null: unknown. Empty without elevation files."""
    not_known: list[str]
    """Unknown data of the vehicle or the ground; sentences."""


class ImportedAreaUse(ResponseBody):
    """One possible use of an area in a file."""

    use: AreaUseName
    """`stay_inside`: a geofence to stay inside, with the area's holes as zones to stay out of;
    `stay_outside`: a zone to stay out of; `survey`: the area (and its holes) of a survey pattern."""
    text: str
    """The use as a sentence, for example for a button."""
    fence: list[FenceZone]
    """The zones to add to the plan's `fence` for this use. Empty for `survey`: use `outer` and `holes` of the
    area for the pattern."""


class ImportedArea(ResponseBody):
    """An area in a file, which is not part of the plan: the file does not state its use. Ask the user which
    of `uses` is meant, and never choose one silently."""

    name: str
    """Name in the file."""
    outer: list[Point]
    """Corners of the outer boundary."""
    holes: list[list[Point]]
    """Holes in the area."""
    likely_use: AreaUseName | None
    """The use that the name suggests (`No-fly zone`: `stay_outside`); null: the name suggests none. A hint
    for the order of the answers, not an answer."""
    uses: list[ImportedAreaUse]
    """The possible uses."""


class ImportedPlan(ResponseBody):
    """A plan from a file; nothing is saved."""

    format: FormatName
    """Format of the file."""
    kind: PlanKind
    """Which kind of plan it is."""
    plan: AnyDocument
    """The plan's document."""
    areas: list[ImportedArea]
    """Areas in the file that are not part of the plan."""
    notes: list[str]
    """Notes on what was imported and what was not; sentences."""


ImportedTableModel = model_of(ImportedTable, "ImportedTable")


class ConvertedPlan(ResponseBody):
    """An offboard mission converted from a waypoint plan; nothing is saved."""

    plan: OffboardMission
    """The mission."""
    notes: list[str]
    """Parts of the plan that the mission does not contain; sentences."""


class GroundPlan(ResponseBody):
    """A plan that follows the ground; nothing is saved."""

    plan: Plan
    """The plan."""
    resolved: int
    """Number of items and rally points with resolved altitudes."""
    unknown: int
    """Number of items and rally points whose altitudes are unresolved, because no file covers their
    positions."""
    added: int
    """Number of added waypoints."""
    notes: list[str]
    """Unusable files and positions without elevation data; sentences."""


class ElevationFileModel(ResponseBody):
    """One elevation file."""

    name: str
    """Name of the file."""
    west_deg: float
    """Western edge [deg]."""
    south_deg: float
    """Southern edge [deg]."""
    east_deg: float
    """Eastern edge [deg]."""
    north_deg: float
    """Northern edge [deg]."""
    spacing_m: float
    """Distance between two rows of the grid, on the ground [m]."""
    from_tiles: bool
    """Whether the server saved it from tiles. Other files are used first."""
    attribution: str | None
    """Attribution that the file asks for."""


class ElevationFiles(ResponseBody):
    """The operator's elevation files."""

    folder: str
    """Folder for GeoTIFF (.tif, .tiff) and HGT files."""
    tiles_url: str | None
    """Address of tiles of heights of this ground: append `/{zoom}/{x}/{y}`; null: there are no files.
    Another one after each change of the files."""
    files: list[ElevationFileModel]
    """Files in the order in which they are used: the operator's own, then those saved from tiles; each from
    the finest grid to the coarsest."""
    unreadable: list[str]
    """Files in the folder that cannot be used, each with the reason."""


class PatternFigures(ResponseBody):
    """Lengths, number of photos and flight time of a pattern."""

    lines_length_m: float
    """Total length of the lines with photos [m]."""
    lower_bound_m: float
    """Smallest possible length of lines with this spacing [m]."""
    photos: int
    """Number of photos."""
    spacing_m: float
    """Distance between neighbouring lines [m]; 0: no lines."""
    trigger_m: float
    """Distance between two photos on a line [m]; 0: no photos."""
    resolution_m_px: float | None
    """Ground sampling distance [m per pixel]."""
    heading_deg: float | None
    """Direction of the lines, clockwise from north [deg]."""
    area_m2: float | None
    """Area that the photos show [m²]; null: no photos."""
    length_m: float
    """Length of the path with all turns [m]."""
    time_s: float
    """Estimated flight time without wind, as for a waypoint plan [s]."""


class PatternPosition(ResponseBody):
    """A position of a pattern's path."""

    lat_deg: float
    """Latitude [deg]."""
    lon_deg: float
    """Longitude [deg]."""
    altitude: Altitude
    """Altitude; above the ground with `resolved_amsl_m`, if it is known."""


class PatternPlan(ResponseBody):
    """A document that contains only a pattern; nothing is saved."""

    plan: AnyDocument
    """A waypoint plan with the pattern as its only item, or an offboard mission with its steps. The steps
    begin in the air: insert them after a take-off."""
    lines: list[tuple[Point, Point]]
    """The lines on which photos are taken."""
    path: list[PatternPosition]
    """The positions that the vehicle flies to, in order."""
    figures: PatternFigures
    """Lengths, number of photos and flight time."""
    notes: list[str]
    """What could not be computed; sentences."""
