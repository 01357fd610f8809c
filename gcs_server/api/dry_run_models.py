"""Dry runs over HTTP: what to fly in simulation, and what came of it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from gcs_server.api.plan_models import DocumentBody, OriginModel
from gcs_server.api.reflect import model_of
from gcs_server.api.strict_body import AnswerBody, StrictBody
from missions.documents import Kind
from missions.dry_run.spread import Chance, Quantiles

MAX_FLIGHTS = 200
MAX_OBSTACLES = 100
Metres = Annotated[float, Field(ge=-20_000, le=20_000)]
Vector3 = tuple[float, float, float]
Share = Annotated[float, Field(ge=0, le=1)]
WindComponent = Annotated[float, Field(ge=-40, le=40)]


class DryRunConditions(StrictBody):
    """What the flight meets."""

    wind_ned_m_s: tuple[WindComponent, WindComponent, WindComponent] = Field(
        default=(0.0, 0.0, 0.0), description="Steady wind: where the air moves to [m/s]; at most 40 m/s."
    )
    gusts_m_s: float = Field(
        default=0.0, ge=0, le=20, description="One sigma of the gusts on each horizontal axis [m/s]."
    )
    mass_scale: float = Field(default=1.0, ge=0.3, le=3, description="Times the vehicle's mass.")
    battery_scale: float = Field(default=1.0, ge=0.05, le=3, description="Times the battery's capacity.")
    sensor_noise: float = Field(
        default=1.0, ge=0, le=10, description="Times the sensor noise of PX4's own simulation."
    )


class DryRunSpread(StrictBody):
    """One sigma of each normal distribution about the stated conditions, cut at three sigma."""

    wind_m_s: float = Field(default=1.5, ge=0, le=10, description="On each horizontal axis [m/s].")
    gusts: float = Field(default=0.3, ge=0, le=0.5, description="As a part of the stated gusts.")
    mass: float = Field(default=0.03, ge=0, le=0.5, description="As a part of the mass.")
    battery: float = Field(default=0.05, ge=0, le=0.5, description="As a part of the battery's capacity.")
    sensor_noise: float = Field(default=0.2, ge=0, le=0.5, description="As a part of the sensor noise.")


class DryRunObstacle(StrictBody):
    """An upright box."""

    name: str = Field(min_length=1, max_length=60, description="For findings.")
    north_m: Metres = Field(description="Of its centre, from where the vehicle stands [m].")
    east_m: Metres = Field(description="Of its centre, from where the vehicle stands [m].")
    length_m: float = Field(gt=0, le=10_000, description="Along its own x axis: north where yaw is 0 [m].")
    width_m: float = Field(gt=0, le=10_000, description="Along its own y axis [m].")
    height_m: float = Field(gt=0, le=10_000, description="From its underside to its roof [m].")
    base_alt_home_m: Metres = Field(default=0.0, description="Its underside above home [m].")
    yaw_ned_rad: float = Field(
        default=0.0, ge=-7, le=7, description="How it is turned, clockwise from north [rad]."
    )


class DryRunRequest(StrictBody):
    """Which plan is flown in simulation, by which vehicle, in which weather, how often."""

    plan_id: str | None = Field(default=None, max_length=40, description="Of a plan that the server keeps.")
    version: int | None = Field(default=None, ge=1, description="Of that plan; the newest unless named.")
    plan: DocumentBody | None = Field(default=None, description="A plan that is not kept on the server.")
    vehicle: str | None = Field(
        default=None,
        max_length=32,
        description="With this vehicle's parameters, place, heading and charge, as far as they are known; "
        "null: PX4's defaults, from the plan's home.",
    )
    conditions: DryRunConditions = DryRunConditions()
    flights: int | None = Field(
        default=None,
        ge=1,
        le=MAX_FLIGHTS,
        description="Monte Carlo: so many flights more, each in other conditions.",
    )
    spread: DryRunSpread = Field(default=DryRunSpread(), description="Of the conditions, with `flights`.")
    seed: int = Field(default=0, ge=0, le=2**31 - 1, description="The same seed gives the same flights.")
    obstacles: list[DryRunObstacle] = Field(
        default=[], max_length=MAX_OBSTACLES, description="What stands around where the vehicle stands."
    )
    endurance_s: float | None = Field(
        default=None,
        gt=0,
        le=100_000,
        description="Hovering from a full battery to an empty one [s]; null: as SIM_BAT_* of a simulated "
        "vehicle say.",
    )
    battery_reserve: Share = Field(default=0.2, description="Share of the battery that is to be left.")

    @model_validator(mode="after")
    def _one(self) -> DryRunRequest:
        if (self.plan_id is None) == (self.plan is None):
            raise ValueError("give exactly one of plan_id and plan")
        if self.version is not None and self.plan_id is None:
            raise ValueError("version belongs to plan_id")
        return self


ChanceModel = model_of(Chance, "DryRunChance")
QuantilesModel = model_of(Quantiles, "DryRunQuantiles")


class DryRunStep(AnswerBody):
    """When a step was flown; one that is flown again is listed again."""

    place: str = Field(description="`item 3` of a waypoint plan, `step 4.2` of an offboard mission.")
    title: str = Field(description="What it is, for people.")
    row: int | None = Field(description="Index in the plan's `items`; null: of an offboard mission.")
    start_s: float = Field(description="Since the start [s].")
    end_s: float = Field(description="Since the start [s].")
    fence_distance_m: float | None = Field(
        description="The smallest distance inside the geofence [m]; negative: outside; null: no geofence."
    )
    obstacle_distance_m: float | None = Field(
        description="The smallest distance to an obstacle [m]; null: none."
    )


class DryRunFindingModel(AnswerBody):
    """One thing that the flight has shown to be wrong."""

    code: str = Field(description="Stable; `docs/missions.md` has all.", examples=["fence_touched"])
    severity: Literal["error", "warning"] = Field(
        description="error: it must not be flown so; warning: it may surprise."
    )
    text: str = Field(description="What is wrong, a sentence.")
    step: str | None = Field(description="Where, as `place` of the steps.")
    t_s: float | None = Field(description="When, since the start [s].")
    position_ned_m: Vector3 | None = Field(description="Where the vehicle was, from `origin` [m].")


class DryRunPath(AnswerBody):
    """The flown path; all lists are equally long."""

    t_s: list[float] = Field(description="Since the start [s]; 10 Hz, long flights thinned to 4000 samples.")
    position_ned_m: list[Vector3] = Field(description="From `origin` [m].")
    velocity_ned_m_s: list[Vector3] = Field(description="[m/s].")
    q_ned_frd: list[tuple[float, float, float, float]] = Field(
        description="Attitude, taking body FRD to NED, order w, x, y, z."
    )
    gimbal_rad: list[tuple[float, float]] = Field(description="Pitch (up is positive), yaw from north [rad].")
    battery_share: list[float] | None = Field(description="Charge, 0 to 1; null: not known.")
    step: list[int] = Field(description="Index in `step_places`; -1: none.")
    step_places: list[str] = Field(description="The steps that were flown.")


class DryRunFlight(AnswerBody):
    """The flight in the stated conditions."""

    origin: OriginModel = Field(description="Where the vehicle stands; zero of all local places.")  # type: ignore[valid-type]
    conditions: DryRunConditions = Field(description="What it met.")
    finished: bool = Field(description="The whole plan was flown.")
    landed: bool = Field(description="It ended on the ground, disarmed.")
    duration_s: float = Field(description="From arming to the end [s].")
    length_m: float = Field(description="Along the flown path [m].")
    battery_start_share: float = Field(description="Charge at the start, 0 to 1.")
    battery_end_share: float | None = Field(description="At the end; null: how it drains is not known.")
    fence_distance_m: float | None = Field(
        description="The smallest distance inside the geofence [m]; negative: outside; null: no geofence."
    )
    obstacle_distance_m: float | None = Field(
        description="The smallest distance to an obstacle [m]; null: none."
    )
    steps: list[DryRunStep] = Field(description="In their order.")
    findings: list[DryRunFindingModel] = Field(description="Errors first; at most 100.")
    path: DryRunPath | None = Field(description="Null: the flight never began.")
    times_real_time: float = Field(description="How much faster than real time it was flown.")


class DryRunBand(AnswerBody):
    """Quantiles of a deviation at each place of the corridor [m]."""

    p5: list[float] = Field(description="5 % are smaller.")
    p50: list[float] = Field(description="The median.")
    p95: list[float] = Field(description="5 % are greater.")
    greatest: list[float] = Field(description="The greatest by size.")


class DryRunCorridor(AnswerBody):
    """How far the flights lie from the nominal one along its path, at up to 400 places."""

    t_s: list[float] = Field(description="Since the start of the nominal flight [s].")
    position_ned_m: list[Vector3] = Field(description="Of the nominal flight, from `origin` [m].")
    horizontal_m: DryRunBand = Field(description="Distance over the ground.")
    vertical_m: DryRunBand = Field(description="Positive: higher.")


class DryRunSummary(AnswerBody):
    """One of the flights."""

    wind_ned_m_s: Vector3 = Field(description="Steady wind [m/s].")
    gusts_m_s: float = Field(description="One sigma [m/s].")
    mass_scale: float = Field(description="Times the vehicle's mass.")
    battery_scale: float = Field(description="Times the battery's capacity.")
    sensor_noise: float = Field(description="Times the usual noise.")
    finished: bool = Field(description="The whole plan was flown.")
    duration_s: float = Field(description="From arming to the end [s].")
    battery_end_share: float | None = Field(description="Charge at the end; null: not known.")
    fence_distance_m: float | None = Field(description="The smallest [m]; null: no geofence.")
    obstacle_distance_m: float | None = Field(description="The smallest [m]; null: no obstacle.")
    findings: list[str] = Field(description="Codes.")


class DryRunMonteCarlo(AnswerBody):
    """Many flights, each in conditions of its own."""

    spread: DryRunSpread = Field(description="How the conditions varied.")
    seed: int = Field(description="Of draws, noise and gusts.")
    flights: list[DryRunSummary] = Field(description="Each of them; without the nominal one.")
    corridor: DryRunCorridor | None = Field(description="Null: the nominal flight never began.")
    duration_s: QuantilesModel | None = Field(description="Of the finished flights [s]; null: none was.")  # type: ignore[valid-type]
    battery_end_share: QuantilesModel | None = Field(description="Charge at the end; null: not known.")  # type: ignore[valid-type]
    fence_distance_m: QuantilesModel | None = Field(description="Of the smallest distances [m].")  # type: ignore[valid-type]
    obstacle_distance_m: QuantilesModel | None = Field(description="Of the smallest distances [m].")  # type: ignore[valid-type]
    chances: dict[str, ChanceModel] = Field(  # type: ignore[valid-type]
        description="Of `not_finished`, `fence_touched`, `obstacle_hit`, `obstacle_near` (2 m), `failsafe` "
        "and `battery_reserve`."
    )
    times_real_time: float = Field(description="Simulated time over time spent, all flights at once.")


class DryRunView(AnswerBody):
    """What came of a dry run."""

    id: str = Field(description="Its id, as the operation's `result` names it.")
    kind: Kind = Field(description="Which kind of plan was flown.")
    name: str | None = Field(description="Of a plan that the server keeps.")
    plan_id: str | None = Field(description="Of a plan that the server keeps.")
    version: int | None = Field(description="Of that plan.")
    vehicle: str | None = Field(description="Whose parameters, place and charge were taken.")
    assumed: list[str] = Field(description="What was not known and what was taken instead; sentences.")
    nominal: DryRunFlight = Field(description="The flight in the stated conditions.")
    monte_carlo: DryRunMonteCarlo | None = Field(description="Null: it was flown once.")
