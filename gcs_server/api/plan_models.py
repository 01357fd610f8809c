"""Request and response bodies of the routes for plans.

The documents are defined in `missions`, which checks their JSON; its errors name the item and the fix.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gcs_server.api.documents import DocumentBody, PlanBody
from gcs_server.api.reflect import model_of
from gcs_server.api.strict_body import ResponseBody, StrictBody
from gcs_server.plans.files import PlanVersion
from missions.checks import CODES
from missions.documents import PlanKind
from missions.estimates import Estimate
from missions.formats.any_format import FormatName
from missions.formats.results import AreaUseName
from missions.geodesy import LocalOrigin
from missions.offboard.document import OffboardMission
from missions.offboard.samples import Leg, StepTime
from missions.offboard.tables import ImportedTable
from missions.plan import Plan
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

    base_version: int = Field(ge=1, description="Version that was changed; 409 if it is not the newest.")


class Power(StrictBody):
    """Values for the energy estimate: constant power in flight, plus the energy for climbing."""

    hover_power_w: float = Field(gt=0, le=1e6, description="Electrical power to hover [W].")
    battery_wh: float = Field(gt=0, le=1e6, description="Energy of the full battery [Wh].")
    mass_kg: float = Field(gt=0, le=1e4, description="Mass with battery and payload [kg].")
    reserve: float = Field(
        default=0.2, ge=0, lt=1, description="Fraction of the battery that is kept as reserve."
    )


class PlanToCheck(StrictBody):
    """The plan to check."""

    plan: DocumentBody
    vehicle: str | None = Field(
        default=None, max_length=32, description="Use this vehicle's parameters and home if they are known."
    )

    power: Power | None = Field(
        default=None, description="For the energy estimate; null: energy and endurance are not checked."
    )


class PlanToFollowGround(StrictBody):
    """The waypoint plan whose altitudes above the ground are resolved."""

    plan: PlanBody
    tolerance_m: float | None = Field(
        default=None,
        ge=1.0,
        le=1000.0,
        allow_inf_nan=False,
        description="Tolerance of the height above the ground [m]: waypoints are added until the straight "
        "lines stay within it; null: no waypoints are added.",
    )


class PlanToExport(StrictBody):
    """The plan to export."""

    plan: DocumentBody


class PlanToConvert(StrictBody):
    """The waypoint plan to convert into an offboard mission."""

    plan: PlanBody
    name: Name
    vehicle: str | None = Field(
        default=None, max_length=32, description="Use this vehicle's parameters and home if they are known."
    )


PlanVersionModel = model_of(PlanVersion, "PlanVersion")
EstimateModel = model_of(Estimate, "PlanEstimates")


class PlanList(ResponseBody):
    """All plans."""

    plans: list[PlanVersionModel] = Field(description="Newest version of each plan, by name.")  # type: ignore[valid-type]


class PlanVersions(ResponseBody):
    """The stored versions of one plan."""

    versions: list[PlanVersionModel] = Field(description="Newest first.")  # type: ignore[valid-type]


class KeptPlan(PlanVersionModel):  # type: ignore[misc,valid-type]
    """A version of a plan, with its document."""

    plan: AnyDocument = Field(description="The plan's document.")


class FindingPlace(ResponseBody):
    """The part of the plan that the finding is about; all null: the whole plan."""

    row: int | None = Field(description="Index in `items`.")
    zone: int | None = Field(description="Index in `fence`.")
    rally_point: int | None = Field(description="Index in `rally_points`.")
    obstacle: int | None = Field(description="Index in `obstacles`.")
    step: str | None = Field(description="Step of an offboard mission: `step 3`, `step 4.2`.")


class FindingModel(ResponseBody):
    """One problem of a plan."""

    code: str = Field(description="Stable code; `docs/missions.md` lists all.", examples=[next(iter(CODES))])
    severity: Literal["error", "warning"] = Field(
        description="error: PX4 refuses the plan, or it is unsafe; warning: check the plan."
    )
    text: str = Field(description="Message for the pilot.")
    place: FindingPlace = Field(description="The part of the plan that the finding is about.")
    fix: str | None = Field(description="How to correct the problem.")
    limit: float | None = Field(
        description="The limit that the plan was checked against: altitude above home [m], speed [m/s], tilt "
        "[rad] or minimum time [s]; null: no limit. The page uses it to correct the plan."
    )


LegModel = model_of(Leg, "PlanLeg")
StepTimeModel = model_of(StepTime, "PlanStepTime")
OriginModel = model_of(LocalOrigin, "PlanOrigin")


class OffboardFlight(ResponseBody):
    """The planned flight of an offboard mission, starting on the ground at home."""

    steps: list[StepTimeModel] = Field(  # type: ignore[valid-type]
        description="Steps in flight order; at a branch, those of the longest path."
    )
    legs: list[LegModel] = Field(description="The segments of the path, on all branches.")  # type: ignore[valid-type]
    needs: list[str] = Field(description="The estimates that the vehicle must have.")
    start_ned_m: tuple[float, float, float] = Field(description="Start position, from the local origin [m].")
    origin: OriginModel | None = Field(  # type: ignore[valid-type]
        description="Global position of the local origin; null if unknown."
    )


class PlanCheck(ResponseBody):
    """Findings and estimates of a plan."""

    kind: PlanKind = Field(description="Which kind of plan it is.")
    findings: list[FindingModel] = Field(
        description="Findings in the order of the checks; empty: no problem was found."
    )
    estimates: EstimateModel = Field(description="Estimates of the whole flight.")  # type: ignore[valid-type]
    flight: OffboardFlight | None = Field(
        description="The planned flight of an offboard mission; null for a waypoint plan."
    )
    vehicle: str | None = Field(description="Vehicle for which the plan was checked.")
    ground: list[tuple[float, float | None]] = Field(
        description="The ground below the flight: distance along the flight [m], and altitude of the ground "
        "above home, or above the start of an offboard mission [m]; null: unknown. Empty without elevation "
        "files."
    )
    not_known: list[str] = Field(description="Unknown data of the vehicle or the ground; sentences.")


class ImportedAreaUse(ResponseBody):
    """One possible use of an area in a file."""

    use: AreaUseName = Field(
        description="`stay_inside`: a geofence to stay inside, with the area's holes as zones to stay out "
        "of; `stay_outside`: a zone to stay out of; `survey`: the area (and its holes) of a survey pattern."
    )
    text: str = Field(description="The use as a sentence, for example for a button.")
    fence: list[FenceZone] = Field(
        description="The zones to add to the plan's `fence` for this use. Empty for `survey`: use `outer` "
        "and `holes` of the area for the pattern."
    )


class ImportedArea(ResponseBody):
    """An area in a file, which is not part of the plan: the file does not state its use. Ask the user which
    of `uses` is meant, and never choose one silently."""

    name: str = Field(description="Name in the file.")
    outer: list[Point] = Field(description="Corners of the outer boundary.")
    holes: list[list[Point]] = Field(description="Holes in the area.")
    likely_use: AreaUseName | None = Field(
        description="The use that the name suggests (`No-fly zone`: `stay_outside`); null: the name suggests "
        "none. A hint for the order of the answers, not an answer."
    )
    uses: list[ImportedAreaUse] = Field(description="The possible uses.")


class ImportedPlan(ResponseBody):
    """A plan from a file; nothing is saved."""

    format: FormatName = Field(description="Format of the file.")
    kind: PlanKind = Field(description="Which kind of plan it is.")
    plan: AnyDocument = Field(description="The plan's document.")
    areas: list[ImportedArea] = Field(description="Areas in the file that are not part of the plan.")
    notes: list[str] = Field(description="Notes on what was imported and what was not; sentences.")


ImportedTableModel = model_of(ImportedTable, "ImportedTable")


class ConvertedPlan(ResponseBody):
    """An offboard mission converted from a waypoint plan; nothing is saved."""

    plan: OffboardMission = Field(description="The mission.")
    notes: list[str] = Field(description="Parts of the plan that the mission does not contain; sentences.")


class GroundPlan(ResponseBody):
    """A plan that follows the ground; nothing is saved."""

    plan: Plan = Field(description="The plan.")
    resolved: int = Field(description="Number of items and rally points with resolved altitudes.")
    unknown: int = Field(
        description="Number of items and rally points whose altitudes are unresolved, because no file covers "
        "their positions."
    )
    added: int = Field(description="Number of added waypoints.")
    notes: list[str] = Field(description="Unusable files and positions without elevation data; sentences.")


class ElevationFileModel(ResponseBody):
    """One elevation file."""

    name: str = Field(description="Name of the file.")
    west_deg: float = Field(description="Western edge [deg].")
    south_deg: float = Field(description="Southern edge [deg].")
    east_deg: float = Field(description="Eastern edge [deg].")
    north_deg: float = Field(description="Northern edge [deg].")
    spacing_m: float = Field(description="Distance between two rows of the grid, on the ground [m].")


class ElevationFiles(ResponseBody):
    """The operator's elevation files."""

    folder: str = Field(description="Folder for GeoTIFF (.tif, .tiff) and HGT files.")
    files: list[ElevationFileModel] = Field(description="Files, from the finest grid to the coarsest.")
    unreadable: list[str] = Field(
        description="Files in the folder that cannot be used, each with the reason."
    )


class PatternFigures(ResponseBody):
    """Lengths, number of photos and flight time of a pattern."""

    lines_length_m: float = Field(description="Total length of the lines with photos [m].")
    lower_bound_m: float = Field(description="Smallest possible length of lines with this spacing [m].")
    photos: int = Field(description="Number of photos.")
    spacing_m: float = Field(description="Distance between neighbouring lines [m]; 0: no lines.")
    trigger_m: float = Field(description="Distance between two photos on a line [m]; 0: no photos.")
    resolution_m_px: float | None = Field(description="Ground sampling distance [m per pixel].")
    heading_deg: float | None = Field(description="Direction of the lines, clockwise from north [deg].")
    area_m2: float | None = Field(description="Area that the photos show [m²]; null: no photos.")
    length_m: float = Field(description="Length of the path with all turns [m].")
    time_s: float = Field(description="Estimated flight time without wind, as for a waypoint plan [s].")


class PatternPosition(ResponseBody):
    """A position of a pattern's path."""

    lat_deg: float = Field(description="Latitude [deg].")
    lon_deg: float = Field(description="Longitude [deg].")
    altitude: Altitude = Field(
        description="Altitude; above the ground with `resolved_amsl_m`, if it is known."
    )


class PatternPlan(ResponseBody):
    """A document that contains only a pattern; nothing is saved."""

    plan: AnyDocument = Field(
        description="A waypoint plan with the items of the pattern, or an offboard mission with its steps. "
        "The steps begin in the air: insert them after a take-off."
    )
    lines: list[tuple[Point, Point]] = Field(description="The lines on which photos are taken.")
    path: list[PatternPosition] = Field(description="The positions that the vehicle flies to, in order.")
    figures: PatternFigures = Field(description="Lengths, number of photos and flight time.")
    notes: list[str] = Field(description="What could not be computed; sentences.")
