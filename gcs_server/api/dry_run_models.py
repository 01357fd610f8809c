"""Bodies of the dry-run routes: requests and results."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from gcs_server.api.documents import DocumentBody, SourceBody
from gcs_server.api.group_models import VehicleId
from gcs_server.api.offboard_mission_models import Role
from gcs_server.api.plan_models import OriginModel
from gcs_server.api.reflect import model_of
from gcs_server.api.strict_body import ResponseBody, StrictBody
from missions.documents import PlanKind
from missions.dry_run import document
from missions.dry_run.spread import MAX_FLIGHTS, MAX_VEHICLES, Chance, Quantiles
from missions.offboard.document import MAX_ROLES
from missions.values import DisplayText

MAX_OBSTACLES = 100
Metres = Annotated[float, Field(ge=-20_000, le=20_000)]
Vector3 = tuple[float, float, float]
Share = Annotated[float, Field(ge=0, le=1)]
WindComponent = Annotated[float, Field(ge=-40, le=40)]


class DryRunConditions(StrictBody):
    """Wind, vehicle and battery of the simulated flight."""

    wind_ned_m_s: tuple[WindComponent, WindComponent, WindComponent] = (0.0, 0.0, 0.0)
    """Steady wind as the velocity of the air [m/s]; at most 40 m/s."""
    gusts_m_s: float = Field(default=0.0, ge=0, le=20)
    """Standard deviation of the gusts on each horizontal axis [m/s]."""
    mass_scale: float = Field(default=1.0, ge=0.3, le=3)
    """Factor on the vehicle's mass."""
    battery_scale: float = Field(default=1.0, ge=0.05, le=3)
    """Factor on the battery's capacity."""
    sensor_noise: float = Field(default=1.0, ge=0, le=10)
    """Factor on the sensor noise of PX4's own simulation."""


class DryRunSpread(StrictBody):
    """Standard deviations of the conditions (normal distributions, limited to three sigma)."""

    wind_m_s: float = Field(default=1.5, ge=0, le=10)
    """Wind on each horizontal axis [m/s]."""
    gusts: float = Field(default=0.3, ge=0, le=0.5)
    """Gusts, as a fraction of the requested gusts."""
    mass: float = Field(default=0.03, ge=0, le=0.5)
    """Mass, as a fraction of its value."""
    battery: float = Field(default=0.05, ge=0, le=0.5)
    """Battery capacity, as a fraction of its value."""
    sensor_noise: float = Field(default=0.2, ge=0, le=0.5)
    """Sensor noise, as a fraction of its value."""


class DryRunObstacle(StrictBody):
    """An upright box."""

    name: DisplayText = Field(min_length=1, max_length=60)
    """Name in findings."""
    north_m: Metres
    """Centre, north of the vehicle's start position [m]."""
    east_m: Metres
    """Centre, east of the vehicle's start position [m]."""
    length_m: float = Field(gt=0, le=10_000)
    """Length along the box's x axis, which points north at yaw 0 [m]."""
    width_m: float = Field(gt=0, le=10_000)
    """Length along the box's y axis [m]."""
    height_m: float = Field(gt=0, le=10_000)
    """Height from the lower to the upper side [m]."""
    base_alt_home_m: Metres = 0.0
    """Altitude of the lower side above home [m]."""
    yaw_ned_rad: float = Field(default=0.0, ge=-7, le=7)
    """Direction of the box's x axis, clockwise from north [rad]."""


class DryRunRequest(SourceBody):
    """A plan to fly in simulation: vehicle, conditions and number of flights."""

    plan: DocumentBody | None = None
    """A plan that is not stored on the server."""
    vehicle: str | None = Field(default=None, max_length=32)
    """Use this vehicle's parameters, position, heading and battery charge, if they are known; null: PX4's
    defaults, starting at the plan's home."""
    vehicles: dict[Role, VehicleId] | None = Field(default=None, max_length=MAX_ROLES)
    """For a mission with roles: the vehicle of each role, used like `vehicle`; null: each role starts at its
    planned position."""
    conditions: DryRunConditions = DryRunConditions()
    flights: int | None = Field(
        default=None,
        ge=1,
        le=MAX_FLIGHTS,
        description="Monte Carlo: number of further flights, each in other conditions; with roles at most "
        f"{MAX_VEHICLES} divided by the number of roles.",
    )
    spread: DryRunSpread = DryRunSpread()
    """How the conditions vary between the flights."""
    seed: int = Field(default=0, ge=0, le=2**31 - 1)
    """The same seed gives the same flights."""
    obstacles: list[DryRunObstacle] = Field(default=[], max_length=MAX_OBSTACLES)
    """Obstacles around the vehicle's start position."""
    endurance_s: float | None = Field(default=None, gt=0, le=100_000)
    """Hover time with a full battery [s]; null: from SIM_BAT_* of a simulated vehicle."""
    battery_reserve: Share = 0.2
    """Fraction of the battery charge to keep in reserve."""

    @model_validator(mode="after")
    def _check_vehicles(self) -> DryRunRequest:
        if self.vehicles is not None and self.vehicle is not None:
            raise ValueError("give vehicle, or vehicles for a mission with roles, and not both")
        return self


QUANTILES = ("duration_s", "battery_end_share", "fence_distance_m", "obstacle_distance_m")
"""Fields of the result of many flights that are quantiles."""
ChanceModel = model_of(Chance, "DryRunChance")
QuantilesModel = model_of(Quantiles, "DryRunQuantiles")


ORIGIN = "Start position of the vehicle; origin of all local positions."
PX4 = "Release of PX4 whose defaults, failsafes and home were simulated: `1.17`."
BANDS = ("p5", "p50", "p95", "greatest")
PathModel = model_of(document.FlownPath, "DryRunPath")
FlightModel = model_of(
    document.FlightResult,
    "DryRunFlight",
    px4=Annotated[str, Field(description=PX4)],
    origin=Annotated[OriginModel, Field(description=ORIGIN)],
    conditions=DryRunConditions,
    steps=list[model_of(document.StepTime, "DryRunStep")],
    findings=list[model_of(document.DryRunFinding, "DryRunFindingModel")],
    path=Annotated[PathModel | None, Field(description="The flown path; null: the flight did not start.")],
)
BandModel = model_of(document.Band, "DryRunBand", **dict.fromkeys(BANDS, list[float]))
CorridorModel = model_of(
    document.Corridor,
    "DryRunCorridor",
    t_s=list[float],
    position_ned_m=list[Vector3],
    horizontal_m=BandModel,
    vertical_m=BandModel,
)
MonteCarloModel = model_of(
    document.MonteCarloResult,
    "DryRunMonteCarlo",
    spread=DryRunSpread,
    flights=list[model_of(document.FlightSummary, "DryRunSummary")],
    corridor=CorridorModel | None,
    **dict.fromkeys(QUANTILES, QuantilesModel | None),
    chances=dict[str, ChanceModel],
)
ClosestModel = model_of(document.ClosestApproach, "DryRunClosest")
PairDistanceModel = model_of(
    document.PairDistance, "DryRunPairDistance", distance_m=QuantilesModel, nearer_than_minimum=ChanceModel
)


class DryRunGroupMonteCarlo(ResponseBody):
    """Many flights of all vehicles. The vehicles of one flight have the same wind."""

    roles: dict[str, MonteCarloModel]  # type: ignore[valid-type]
    """For each role the corridor, quantiles and chances of its vehicle."""
    closest: list[PairDistanceModel]  # type: ignore[valid-type]
    """One entry for each pair of roles that flew."""


class DryRunGroupModel(ResponseBody):
    """All vehicles of a mission with roles, flown together; all positions are relative to one `origin`."""

    roles: dict[str, FlightModel]  # type: ignore[valid-type]
    """The flight of each role."""
    closest: list[ClosestModel]  # type: ignore[valid-type]
    """One entry for each pair of roles, from the time in which both were flying."""
    monte_carlo: DryRunGroupMonteCarlo | None
    """Result of all flights; null: only one flight was simulated."""


class DryRunView(ResponseBody):
    """Result of a dry run."""

    id: str
    """Id of the dry run, as in the operation's `result`."""
    kind: PlanKind
    """Kind of the flown plan."""
    name: str | None
    """Name of the stored plan."""
    plan_id: str | None
    """Id of the stored plan."""
    version: int | None
    """Version of the stored plan."""
    vehicle: str | None
    """Vehicle whose parameters, position and battery charge were used."""
    vehicles: dict[str, str] | None
    """For a mission with roles: the vehicle whose values were used, for each role."""
    assumed: list[str]
    """Assumptions made because values were unknown; sentences."""
    nominal: FlightModel  # type: ignore[valid-type]
    """The flight in the requested conditions. For a mission with roles: the flight of the first role, with
    the findings of all roles."""
    group: DryRunGroupModel | None
    """Result of all vehicles together; null: one vehicle was simulated."""
    monte_carlo: MonteCarloModel | None  # type: ignore[valid-type]
    """Result of all flights; null: only one flight was simulated. For a mission with roles: the result of the
    first role, with `chances` that one of the vehicles has the outcome."""
