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

    wind_ned_m_s: tuple[WindComponent, WindComponent, WindComponent] = Field(
        default=(0.0, 0.0, 0.0), description="Steady wind as the velocity of the air [m/s]; at most 40 m/s."
    )
    gusts_m_s: float = Field(
        default=0.0, ge=0, le=20, description="Standard deviation of the gusts on each horizontal axis [m/s]."
    )
    mass_scale: float = Field(default=1.0, ge=0.3, le=3, description="Factor on the vehicle's mass.")
    battery_scale: float = Field(default=1.0, ge=0.05, le=3, description="Factor on the battery's capacity.")
    sensor_noise: float = Field(
        default=1.0, ge=0, le=10, description="Factor on the sensor noise of PX4's own simulation."
    )


class DryRunSpread(StrictBody):
    """Standard deviations of the conditions (normal distributions, limited to three sigma)."""

    wind_m_s: float = Field(default=1.5, ge=0, le=10, description="Wind on each horizontal axis [m/s].")
    gusts: float = Field(
        default=0.3, ge=0, le=0.5, description="Gusts, as a fraction of the requested gusts."
    )
    mass: float = Field(default=0.03, ge=0, le=0.5, description="Mass, as a fraction of its value.")
    battery: float = Field(
        default=0.05, ge=0, le=0.5, description="Battery capacity, as a fraction of its value."
    )
    sensor_noise: float = Field(
        default=0.2, ge=0, le=0.5, description="Sensor noise, as a fraction of its value."
    )


class DryRunObstacle(StrictBody):
    """An upright box."""

    name: DisplayText = Field(min_length=1, max_length=60, description="Name in findings.")
    north_m: Metres = Field(description="Centre, north of the vehicle's start position [m].")
    east_m: Metres = Field(description="Centre, east of the vehicle's start position [m].")
    length_m: float = Field(
        gt=0, le=10_000, description="Length along the box's x axis, which points north at yaw 0 [m]."
    )
    width_m: float = Field(gt=0, le=10_000, description="Length along the box's y axis [m].")
    height_m: float = Field(gt=0, le=10_000, description="Height from the lower to the upper side [m].")
    base_alt_home_m: Metres = Field(default=0.0, description="Altitude of the lower side above home [m].")
    yaw_ned_rad: float = Field(
        default=0.0, ge=-7, le=7, description="Direction of the box's x axis, clockwise from north [rad]."
    )


class DryRunRequest(SourceBody):
    """A plan to fly in simulation: vehicle, conditions and number of flights."""

    plan: DocumentBody | None = Field(default=None, description="A plan that is not stored on the server.")
    vehicle: str | None = Field(
        default=None,
        max_length=32,
        description="Use this vehicle's parameters, position, heading and battery charge, if they are known; "
        "null: PX4's defaults, starting at the plan's home.",
    )
    vehicles: dict[Role, VehicleId] | None = Field(
        default=None,
        max_length=MAX_ROLES,
        description="For a mission with roles: the vehicle of each role, used like `vehicle`; null: each "
        "role starts at its planned position.",
    )
    conditions: DryRunConditions = DryRunConditions()
    flights: int | None = Field(
        default=None,
        ge=1,
        le=MAX_FLIGHTS,
        description="Monte Carlo: number of further flights, each in other conditions; with roles at most "
        f"{MAX_VEHICLES} divided by the number of roles.",
    )
    spread: DryRunSpread = Field(
        default=DryRunSpread(), description="How the conditions vary between the flights."
    )
    seed: int = Field(default=0, ge=0, le=2**31 - 1, description="The same seed gives the same flights.")
    obstacles: list[DryRunObstacle] = Field(
        default=[], max_length=MAX_OBSTACLES, description="Obstacles around the vehicle's start position."
    )
    endurance_s: float | None = Field(
        default=None,
        gt=0,
        le=100_000,
        description="Hover time with a full battery [s]; null: from SIM_BAT_* of a simulated vehicle.",
    )
    battery_reserve: Share = Field(
        default=0.2, description="Fraction of the battery charge to keep in reserve."
    )

    @model_validator(mode="after")
    def _check_vehicles(self) -> DryRunRequest:
        if self.vehicles is not None and self.vehicle is not None:
            raise ValueError("give vehicle, or vehicles for a mission with roles, and not both")
        return self


ChanceModel = model_of(Chance, "DryRunChance")
QuantilesModel = model_of(Quantiles, "DryRunQuantiles")


class DryRunStep(ResponseBody):
    """One execution of a step; a repeated step is listed once for each execution."""

    place: str = Field(description="`item 3` of a waypoint plan, `step 4.2` of an offboard mission.")
    title: str = Field(description="Title of the step.")
    row: int | None = Field(description="Index in the plan's `items`; null for an offboard mission.")
    start_s: float = Field(description="Begin, since the start of the flight [s].")
    end_s: float = Field(description="End, since the start of the flight [s].")
    fence_distance_m: float | None = Field(
        description="Smallest distance to the geofence [m]; negative: outside; null: no geofence."
    )
    obstacle_distance_m: float | None = Field(
        description="Smallest distance to an obstacle [m]; null: no obstacles."
    )


class DryRunFindingModel(ResponseBody):
    """A problem that the dry run found."""

    code: str = Field(description="Stable code; `docs/missions.md` lists all.", examples=["fence_touched"])
    severity: Literal["error", "warning"] = Field(
        description="error: do not fly this plan; warning: check the plan."
    )
    text: str = Field(description="Message for the pilot.")
    step: str | None = Field(description="Step in which the problem occurred (its `place`).")
    t_s: float | None = Field(description="Time since the start of the flight [s].")
    position_ned_m: Vector3 | None = Field(description="Position of the vehicle, from `origin` [m].")


class DryRunPath(ResponseBody):
    """The flown path; all lists are equally long."""

    t_s: list[float] = Field(
        description="Time since the start [s]; 10 Hz, for long flights reduced to 4000 samples."
    )
    position_ned_m: list[Vector3] = Field(description="Position from `origin` [m].")
    velocity_ned_m_s: list[Vector3] = Field(description="Velocity [m/s].")
    q_ned_frd: list[tuple[float, float, float, float]] = Field(
        description="Attitude: rotation from body FRD to NED, order w, x, y, z."
    )
    gimbal_rad: list[tuple[float, float]] = Field(description="Pitch (up is positive), yaw from north [rad].")
    battery_share: list[float] | None = Field(description="Battery charge, 0 to 1; null: not known.")
    ground_m: list[float] | None = Field(
        description="Altitude of the ground below the vehicle, above `origin` [m]; null: level ground."
    )
    step: list[int] = Field(description="Index in `step_places`; -1: no step.")
    step_places: list[str] = Field(description="Names of the flown steps.")


class DryRunFlight(ResponseBody):
    """The flight in the requested conditions."""

    origin: OriginModel = Field(description="Start position of the vehicle; origin of all local positions.")  # type: ignore[valid-type]
    conditions: DryRunConditions = Field(description="Conditions of this flight.")
    finished: bool = Field(description="Whether the whole plan was flown.")
    landed: bool = Field(description="Whether the vehicle was on the ground and disarmed at the end.")
    duration_s: float = Field(description="Time from arming to the end [s].")
    length_m: float = Field(description="Length of the flown path [m].")
    battery_start_share: float = Field(description="Battery charge at the start, 0 to 1.")
    battery_end_share: float | None = Field(
        description="Battery charge at the end; null: the battery's drain is not known."
    )
    fence_distance_m: float | None = Field(
        description="Smallest distance to the geofence [m]; negative: outside; null: no geofence."
    )
    obstacle_distance_m: float | None = Field(
        description="Smallest distance to an obstacle [m]; null: no obstacles."
    )
    steps: list[DryRunStep] = Field(description="Steps in flown order.")
    findings: list[DryRunFindingModel] = Field(description="Errors first; at most 100.")
    path: DryRunPath | None = Field(description="The flown path; null: the flight did not start.")
    times_real_time: float = Field(description="Simulation speed relative to real time.")


class DryRunBand(ResponseBody):
    """Quantiles of a deviation at each point of the corridor [m]."""

    p5: list[float] = Field(description="5 % quantile.")
    p50: list[float] = Field(description="Median.")
    p95: list[float] = Field(description="95 % quantile.")
    greatest: list[float] = Field(description="Largest absolute value.")


class DryRunCorridor(ResponseBody):
    """Deviation of the flights from the nominal flight, at up to 400 points of the nominal path."""

    t_s: list[float] = Field(description="Time since the start of the nominal flight [s].")
    position_ned_m: list[Vector3] = Field(description="Position of the nominal flight, from `origin` [m].")
    horizontal_m: DryRunBand = Field(description="Horizontal deviation.")
    vertical_m: DryRunBand = Field(description="Vertical deviation; positive: higher.")


class DryRunSummary(ResponseBody):
    """Summary of one flight."""

    wind_ned_m_s: Vector3 = Field(description="Steady wind [m/s].")
    gusts_m_s: float = Field(description="Standard deviation of the gusts [m/s].")
    mass_scale: float = Field(description="Factor on the vehicle's mass.")
    battery_scale: float = Field(description="Factor on the battery's capacity.")
    sensor_noise: float = Field(description="Factor on the usual sensor noise.")
    finished: bool = Field(description="Whether the whole plan was flown.")
    duration_s: float = Field(description="Time from arming to the end [s].")
    battery_end_share: float | None = Field(description="Battery charge at the end; null: not known.")
    fence_distance_m: float | None = Field(
        description="Smallest distance to the geofence [m]; null: no geofence."
    )
    obstacle_distance_m: float | None = Field(
        description="Smallest distance to an obstacle [m]; null: no obstacles."
    )
    findings: list[str] = Field(description="Codes of the flight's findings.")


class DryRunMonteCarlo(ResponseBody):
    """Many flights, each in different conditions."""

    spread: DryRunSpread = Field(description="How the conditions varied.")
    seed: int = Field(description="Seed of the varied conditions, noise and gusts.")
    flights: list[DryRunSummary] = Field(description="All flights except the nominal flight.")
    corridor: DryRunCorridor | None = Field(description="Null: the nominal flight did not start.")
    duration_s: QuantilesModel | None = Field(  # type: ignore[valid-type]
        description="Duration of the finished flights [s]; null: no flight was finished."
    )
    battery_end_share: QuantilesModel | None = Field(  # type: ignore[valid-type]
        description="Battery charge at the end, 0 to 1; null: unknown."
    )
    fence_distance_m: QuantilesModel | None = Field(description="Smallest distance to the geofence [m].")  # type: ignore[valid-type]
    obstacle_distance_m: QuantilesModel | None = Field(description="Smallest distance to an obstacle [m].")  # type: ignore[valid-type]
    chances: dict[str, ChanceModel] = Field(  # type: ignore[valid-type]
        description="Probability of `not_finished`, `fence_touched`, `obstacle_hit`, `obstacle_near` (2 m), "
        "`failsafe` and `battery_reserve`; with roles also of `separation` (the separation guard would "
        "act) and `nearer_than_minimum` (two vehicles come nearer than the minimum separation)."
    )
    times_real_time: float = Field(description="Simulated time of all flights divided by computing time.")


class DryRunClosest(ResponseBody):
    """Smallest distance between two vehicles."""

    roles: tuple[str, str] = Field(description="Their roles.")
    distance_m: float = Field(description="Distance between the vehicles' centres [m].")
    t_s: float = Field(description="Time since the common start [s].")


class DryRunPairDistance(ResponseBody):
    """Smallest distance between two vehicles in many flights."""

    roles: tuple[str, str] = Field(description="Their roles.")
    distance_m: QuantilesModel = Field(  # type: ignore[valid-type]
        description="Smallest distance of each flight, between the centres [m]."
    )
    nearer_than_minimum: ChanceModel = Field(  # type: ignore[valid-type]
        description="Probability that the two vehicles come nearer than the mission's minimum separation."
    )


class DryRunMonteCarloTogether(ResponseBody):
    """Many flights of all vehicles. The vehicles of one flight have the same wind."""

    roles: dict[str, DryRunMonteCarlo] = Field(
        description="For each role the corridor, quantiles and chances of its vehicle."
    )
    closest: list[DryRunPairDistance] = Field(description="One entry for each pair of roles that flew.")


class DryRunTogetherModel(ResponseBody):
    """All vehicles of a mission with roles, flown together; all positions are relative to one `origin`."""

    roles: dict[str, DryRunFlight] = Field(description="The flight of each role.")
    closest: list[DryRunClosest] = Field(
        description="One entry for each pair of roles, from the time in which both were flying."
    )
    monte_carlo: DryRunMonteCarloTogether | None = Field(
        description="Result of all flights; null: only one flight was simulated."
    )


class DryRunView(ResponseBody):
    """Result of a dry run."""

    id: str = Field(description="Id of the dry run, as in the operation's `result`.")
    kind: PlanKind = Field(description="Kind of the flown plan.")
    name: str | None = Field(description="Name of the stored plan.")
    plan_id: str | None = Field(description="Id of the stored plan.")
    version: int | None = Field(description="Version of the stored plan.")
    vehicle: str | None = Field(
        description="Vehicle whose parameters, position and battery charge were used."
    )
    vehicles: dict[str, str] | None = Field(
        description="For a mission with roles: the vehicle whose values were used, for each role."
    )
    assumed: list[str] = Field(description="Assumptions made because values were unknown; sentences.")
    nominal: DryRunFlight = Field(
        description="The flight in the requested conditions. For a mission with roles: the flight "
        "of the first role, with the findings of all roles."
    )
    together: DryRunTogetherModel | None = Field(
        description="Result of all vehicles together; null: one vehicle was simulated."
    )
    monte_carlo: DryRunMonteCarlo | None = Field(
        description="Result of all flights; null: only one flight was simulated. For a mission with roles: "
        "the result of the first role, with `chances` that one of the vehicles has the outcome."
    )
