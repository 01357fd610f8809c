"""Body and answer of a rerun of a flight."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from gcs_server.api.strict_body import ResponseBody, StrictBody, example

Component = Annotated[float, Field(ge=-50, le=50)]
Metres = Annotated[float, Field(ge=-200, le=200)]
Health = Annotated[float, Field(ge=0, le=1)]
ParameterName = Annotated[str, Field(pattern=r"^[A-Z][A-Z0-9_]{0,15}$")]
ParameterNumber = Annotated[float, Field(ge=-1e9, le=1e9)]
MAX_DURATION_S, MAX_AUTOPILOT_S = 120.0, 600.0


class ChangedItem(StrictBody):
    """What is different at one item of the flown plan."""

    number: Annotated[int, Field(ge=1, le=10_000)]
    """The item, from 1; a pattern is one item. The vehicle had not passed it."""
    moved_ned_m: Annotated[list[Metres], Field(min_length=3, max_length=3)] | None = None
    """What is added to its position [m]; null: it is where it was."""
    speed_m_s: Annotated[float, Field(gt=0, le=30)] | None = None
    """Speed over ground from this item on; null: as planned."""
    then: Literal["return", "hold", "land"] | None = None
    """What follows it; null: the next item."""


class ChangedStep(StrictBody):
    """What is different at one step of the flown offboard mission."""

    place: Annotated[str, Field(pattern=r"^step [1-9]", max_length=200)]
    """The step, as in the mission's status and findings: `step 3`, `step 4.2`, `step 5 then 1`. It had not
    ended; a repeated step changes in its next rounds too."""
    point: Annotated[int, Field(ge=1, le=5000)] | None = None
    """The point of a step that flies through points, from 1; null: all."""
    moved_ned_m: Annotated[list[Metres], Field(min_length=3, max_length=3)] | None = None
    """What is added to its position [m]; null: it is where it was."""
    speed_m_s: Annotated[float, Field(gt=0, le=100)] | None = None
    """Its speed; null: as planned."""
    duration_s: Annotated[float, Field(ge=0, le=3600)] | None = None
    """How long it holds, waits, or flies a velocity or an attitude; at a point, how long it stops there;
    null: as planned."""


class RerunRequest(StrictBody):
    """A part of a flight, and what is different when it is flown again."""

    model_config = example(from_s=30.0, duration_s=20.0, parameters={"MPC_XY_VEL_P_ACC": 1.2})

    from_s: Annotated[float, Field(ge=0, le=1e6)]
    """Begin of the part [s since the log's start]; the vehicle is in the air then."""
    duration_s: Annotated[float, Field(ge=1, le=MAX_AUTOPILOT_S)] = 20.0
    """Duration [s], with `setpoints` up to 120; it ends earlier where the vehicle has landed, with
    `setpoints` also where it landed in the log or the log ends."""
    parameters: Annotated[dict[ParameterName, ParameterNumber], Field(max_length=50)] = Field(
        default_factory=dict
    )
    """Parameters with other values: of control (MC_*, MPC_* of gains and limits) or of the body (SIH_*); with
    `autopilot` all that the simulated PX4 has: failsafes (COM_LOW_BAT_ACT, NAV_DLL_ACT, GF_ACTION), Return
    (RTL_*), missions (MIS_*)."""
    flown_by: Literal["setpoints", "autopilot"] = "setpoints"
    """`setpoints`: the logged setpoints are followed; `autopilot`: the simulated PX4 flies on in the logged
    mode (Mission, Hold, Return or Land), with its plan, and makes the setpoints; in Offboard the offboard
    mission goes on."""
    plan: Annotated[str, Field(pattern=r"^[0-9a-f]{1,40}$")] | None = None
    """Id of the waypoint plan or offboard mission that was flown; null: the one that this server noted of the
    flight."""
    battery_percent: Annotated[float, Field(ge=0, le=100)] | None = None
    """Other charge at the begin, with `autopilot`; null: as logged."""
    lost: Annotated[list[Literal["data_link", "manual_control", "gps"]], Field(max_length=3)] = Field(
        default_factory=list
    )
    """What is lost at the begin, with `autopilot`: `data_link`, `manual_control` (which the vehicle had until
    then), `gps`."""
    item: ChangedItem | None = None
    """A changed item of the plan, with `autopilot` in Mission; null: none."""
    step: ChangedStep | None = None
    """A changed step of the offboard mission, with `autopilot` in Offboard; null: none."""
    wind_ned_m_s: Annotated[list[Component], Field(min_length=3, max_length=3)] | None = None
    """Other steady wind [m/s], the direction it blows to; null: the one found in the log."""
    motor_health: Annotated[list[Health], Field(min_length=4, max_length=4)] | None = None
    """Factor on the thrust of motors 1 to 4; 0: the motor stops; null: all work."""
    moved_ned_m: Annotated[list[Metres], Field(min_length=3, max_length=3)] | None = None
    """What is added to the position setpoints: a waypoint, or a target of setpoints, that is moved [m]; null:
    they are as logged."""

    @model_validator(mode="after")
    def _belongs_to_who_flies(self) -> RerunRequest:
        if self.flown_by == "autopilot":
            return self
        if self.duration_s > MAX_DURATION_S:
            raise ValueError(f"duration_s is at most {MAX_DURATION_S:.0f} with the logged setpoints")
        for name in ("plan", "battery_percent", "lost", "item", "step"):
            if getattr(self, name) not in (None, []):
                raise ValueError(f"{name} changes nothing with the logged setpoints; use flown_by autopilot")
        return self


class RerunEvent(ResponseBody):
    """A mode, a warning or a mission step of a vehicle that PX4 flies."""

    t_s: float
    """Time [s since the log's start]."""
    text: str
    """The mode that became active, the warning, or the step that began."""


class RerunTrack(ResponseBody):
    """What one vehicle did."""

    position_ned_m: list[list[float]]
    """Positions from the vehicle's local origin."""
    velocity_ned_m_s: list[list[float]]
    """Velocities."""
    attitude_deg: list[list[float]]
    """Roll, pitch, yaw."""
    modes: list[RerunEvent] = Field(default_factory=list["RerunEvent"])
    """Modes, the first at the begin; empty with the logged setpoints."""
    warnings: list[RerunEvent] = Field(default_factory=list["RerunEvent"])
    """Warnings of the vehicle or its offboard mission; empty with the logged setpoints."""
    steps: list[RerunEvent] = Field(default_factory=list["RerunEvent"])
    """Steps of the offboard mission, the first at the begin; empty without one."""


class IdentifiedValue(ResponseBody):
    """A value that was found in a flight."""

    value: float
    """The value."""
    error: float
    """Its standard error; a value below three of them is not used."""


class RerunResult(ResponseBody):
    """A part of a flight: as logged, flown again unchanged, and flown again with the change."""

    t_s: list[float]
    """Times [s since the log's start], of all tracks; a track that ended earlier has fewer samples."""
    logged: RerunTrack
    """As the vehicle estimated it."""
    unchanged: RerunTrack
    """Flown again as it was; its distance from `logged` is what a rerun of this flight is worth."""
    changed: RerunTrack
    """Flown again with the change."""
    error_m: list[float]
    """Distance of `unchanged` from `logged`."""
    error_deg: list[float]
    """Angle between their attitudes."""
    max_error_m: float
    """Largest distance."""
    max_error_deg: float
    """Largest angle."""
    wind_ned_m_s: list[float]
    """Mean of the wind that was found in this part of the log; 0: none is felt."""
    source: Literal["parameters", "flight"]
    """Where the body is from: the log's SIH_* parameters, or found in this flight."""
    model: dict[str, IdentifiedValue]
    """What this part of the flight says: `thrust_m_s2` (all motors at full signal, by mass), `drag_per_s`
    (drag per speed, by mass), `wind_north_m_s`, `wind_east_m_s`, `roll_rad_s2`, `pitch_rad_s2`, `yaw_rad_s2`
    (angular acceleration at full signal); empty: too short."""
    notes: list[str]
    """What the log does not have, as sentences."""
