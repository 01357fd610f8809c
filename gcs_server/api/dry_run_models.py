"""Bodies of the dry-run routes: requests and results."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from gcs_server.api.documents import DocumentBody, SourceBody
from gcs_server.api.group_models import VehicleId
from gcs_server.api.offboard_mission_models import Role
from gcs_server.api.plan_models import OriginModel
from gcs_server.api.reflect import model_of
from gcs_server.api.strict_body import ResponseBody, StrictBody
from missions.documents import PlanKind
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


ChanceModel = model_of(Chance, "DryRunChance")
QuantilesModel = model_of(Quantiles, "DryRunQuantiles")


class DryRunStep(ResponseBody):
    """One execution of a step; a repeated step is listed once for each execution."""

    place: str
    """`item 3` of a waypoint plan, `step 4.2` of an offboard mission."""
    title: str
    """Title of the step."""
    row: int | None
    """Index in the plan's `items`; null for an offboard mission."""
    start_s: float
    """Begin, since the start of the flight [s]."""
    end_s: float
    """End, since the start of the flight [s]."""
    fence_distance_m: float | None
    """Smallest distance to the geofence [m]; negative: outside; null: no geofence."""
    obstacle_distance_m: float | None
    """Smallest distance to an obstacle [m]; null: no obstacles."""


class DryRunFindingModel(ResponseBody):
    """A problem that the dry run found."""

    code: str = Field(examples=["fence_touched"])
    """Stable code; `docs/missions.md` lists all."""
    severity: Literal["error", "warning"]
    """error: do not fly this plan; warning: check the plan."""
    text: str
    """Message for the pilot."""
    step: str | None
    """Step in which the problem occurred (its `place`)."""
    t_s: float | None
    """Time since the start of the flight [s]."""
    position_ned_m: Vector3 | None
    """Position of the vehicle, from `origin` [m]."""


class DryRunPath(ResponseBody):
    """The flown path; all lists are equally long."""

    t_s: list[float]
    """Time since the start [s]; 10 Hz, for long flights reduced to 4000 samples."""
    position_ned_m: list[Vector3]
    """Position from `origin` [m]."""
    velocity_ned_m_s: list[Vector3]
    """Velocity [m/s]."""
    q_ned_frd: list[tuple[float, float, float, float]]
    """Attitude: rotation from body FRD to NED, order w, x, y, z."""
    gimbal_rad: list[tuple[float, float]]
    """Pitch (up is positive), yaw from north [rad]."""
    battery_share: list[float] | None
    """Battery charge, 0 to 1; null: not known."""
    ground_m: list[float] | None
    """Altitude of the ground below the vehicle, above `origin` [m]; null: level ground."""
    step: list[int]
    """Index in `step_places`; -1: no step."""
    step_places: list[str]
    """Names of the flown steps."""


class DryRunFlight(ResponseBody):
    """The flight in the requested conditions."""

    origin: OriginModel  # type: ignore[valid-type]
    """Start position of the vehicle; origin of all local positions."""
    conditions: DryRunConditions
    """Conditions of this flight."""
    finished: bool
    """Whether the whole plan was flown."""
    landed: bool
    """Whether the vehicle was on the ground and disarmed at the end."""
    duration_s: float
    """Time from arming to the end [s]."""
    length_m: float
    """Length of the flown path [m]."""
    battery_start_share: float
    """Battery charge at the start, 0 to 1."""
    battery_end_share: float | None
    """Battery charge at the end; null: the battery's drain is not known."""
    fence_distance_m: float | None
    """Smallest distance to the geofence [m]; negative: outside; null: no geofence."""
    obstacle_distance_m: float | None
    """Smallest distance to an obstacle [m]; null: no obstacles."""
    steps: list[DryRunStep]
    """Steps in flown order."""
    findings: list[DryRunFindingModel]
    """Errors first; at most 100."""
    path: DryRunPath | None
    """The flown path; null: the flight did not start."""
    times_real_time: float
    """Simulation speed relative to real time."""


class DryRunBand(ResponseBody):
    """Quantiles of a deviation at each point of the corridor [m]."""

    p5: list[float]
    """5 % quantile."""
    p50: list[float]
    """Median."""
    p95: list[float]
    """95 % quantile."""
    greatest: list[float]
    """Largest absolute value."""


class DryRunCorridor(ResponseBody):
    """Deviation of the flights from the nominal flight, at up to 400 points of the nominal path."""

    t_s: list[float]
    """Time since the start of the nominal flight [s]."""
    position_ned_m: list[Vector3]
    """Position of the nominal flight, from `origin` [m]."""
    horizontal_m: DryRunBand
    """Horizontal deviation."""
    vertical_m: DryRunBand
    """Vertical deviation; positive: higher."""


class DryRunSummary(ResponseBody):
    """Summary of one flight."""

    wind_ned_m_s: Vector3
    """Steady wind [m/s]."""
    gusts_m_s: float
    """Standard deviation of the gusts [m/s]."""
    mass_scale: float
    """Factor on the vehicle's mass."""
    battery_scale: float
    """Factor on the battery's capacity."""
    sensor_noise: float
    """Factor on the usual sensor noise."""
    finished: bool
    """Whether the whole plan was flown."""
    duration_s: float
    """Time from arming to the end [s]."""
    battery_end_share: float | None
    """Battery charge at the end; null: not known."""
    fence_distance_m: float | None
    """Smallest distance to the geofence [m]; null: no geofence."""
    obstacle_distance_m: float | None
    """Smallest distance to an obstacle [m]; null: no obstacles."""
    findings: list[str]
    """Codes of the flight's findings."""


class DryRunMonteCarlo(ResponseBody):
    """Many flights, each in different conditions."""

    spread: DryRunSpread
    """How the conditions varied."""
    seed: int
    """Seed of the varied conditions, noise and gusts."""
    flights: list[DryRunSummary]
    """All flights except the nominal flight."""
    corridor: DryRunCorridor | None
    """Null: the nominal flight did not start."""
    duration_s: QuantilesModel | None  # type: ignore[valid-type]
    """Duration of the finished flights [s]; null: no flight was finished."""
    battery_end_share: QuantilesModel | None  # type: ignore[valid-type]
    """Battery charge at the end, 0 to 1; null: unknown."""
    fence_distance_m: QuantilesModel | None  # type: ignore[valid-type]
    """Smallest distance to the geofence [m]."""
    obstacle_distance_m: QuantilesModel | None  # type: ignore[valid-type]
    """Smallest distance to an obstacle [m]."""
    chances: dict[str, ChanceModel]  # type: ignore[valid-type]
    """Probability of `not_finished`, `fence_touched`, `obstacle_hit`, `obstacle_near` (2 m), `failsafe` and
    `battery_reserve`; with roles also of `separation` (the separation guard would act) and
    `nearer_than_minimum` (two vehicles come nearer than the minimum separation)."""
    times_real_time: float
    """Simulated time of all flights divided by computing time."""


class DryRunClosest(ResponseBody):
    """Smallest distance between two vehicles."""

    roles: tuple[str, str]
    """Their roles."""
    distance_m: float
    """Distance between the vehicles' centres [m]."""
    t_s: float
    """Time since the common start [s]."""


class DryRunPairDistance(ResponseBody):
    """Smallest distance between two vehicles in many flights."""

    roles: tuple[str, str]
    """Their roles."""
    distance_m: QuantilesModel  # type: ignore[valid-type]
    """Smallest distance of each flight, between the centres [m]."""
    nearer_than_minimum: ChanceModel  # type: ignore[valid-type]
    """Probability that the two vehicles come nearer than the mission's minimum separation."""


class DryRunMonteCarloTogether(ResponseBody):
    """Many flights of all vehicles. The vehicles of one flight have the same wind."""

    roles: dict[str, DryRunMonteCarlo]
    """For each role the corridor, quantiles and chances of its vehicle."""
    closest: list[DryRunPairDistance]
    """One entry for each pair of roles that flew."""


class DryRunTogetherModel(ResponseBody):
    """All vehicles of a mission with roles, flown together; all positions are relative to one `origin`."""

    roles: dict[str, DryRunFlight]
    """The flight of each role."""
    closest: list[DryRunClosest]
    """One entry for each pair of roles, from the time in which both were flying."""
    monte_carlo: DryRunMonteCarloTogether | None
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
    nominal: DryRunFlight
    """The flight in the requested conditions. For a mission with roles: the flight of the first role, with
    the findings of all roles."""
    together: DryRunTogetherModel | None
    """Result of all vehicles together; null: one vehicle was simulated."""
    monte_carlo: DryRunMonteCarlo | None
    """Result of all flights; null: only one flight was simulated. For a mission with roles: the result of the
    first role, with `chances` that one of the vehicles has the outcome."""
