"""Body and answer of a rerun of a flight."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gcs_server.api.strict_body import ResponseBody, StrictBody, example

Component = Annotated[float, Field(ge=-50, le=50)]
Metres = Annotated[float, Field(ge=-200, le=200)]
Health = Annotated[float, Field(ge=0, le=1)]
ParameterName = Annotated[str, Field(pattern=r"^[A-Z][A-Z0-9_]{0,15}$")]
ParameterNumber = Annotated[float, Field(ge=-1e9, le=1e9)]
MAX_DURATION_S = 120.0


class RerunRequest(StrictBody):
    """A part of a flight, and what is different when it is flown again."""

    model_config = example(from_s=30.0, duration_s=20.0, parameters={"MPC_XY_VEL_P_ACC": 1.2})

    from_s: Annotated[float, Field(ge=0, le=1e6)]
    """Begin of the part [s since the log's start]; the vehicle is in the air then."""
    duration_s: Annotated[float, Field(ge=1, le=MAX_DURATION_S)] = 20.0
    """Duration [s]; the rerun ends earlier where the vehicle landed or the log ends."""
    parameters: Annotated[dict[ParameterName, ParameterNumber], Field(max_length=50)] = Field(
        default_factory=dict
    )
    """Parameters with other values: of control (MC_*, MPC_* of gains and limits) or of the body (SIH_*)."""
    wind_ned_m_s: Annotated[list[Component], Field(min_length=3, max_length=3)] | None = None
    """Other steady wind [m/s], the direction it blows to; null: the one found in the log."""
    motor_health: Annotated[list[Health], Field(min_length=4, max_length=4)] | None = None
    """Factor on the thrust of motors 1 to 4; 0: the motor stops; null: all work."""
    moved_ned_m: Annotated[list[Metres], Field(min_length=3, max_length=3)] | None = None
    """What is added to the position setpoints: a waypoint, or a target of setpoints, that is moved [m]; null:
    they are as logged."""


class RerunTrack(ResponseBody):
    """What one vehicle did."""

    position_ned_m: list[list[float]]
    """Positions from the vehicle's local origin."""
    velocity_ned_m_s: list[list[float]]
    """Velocities."""
    attitude_deg: list[list[float]]
    """Roll, pitch, yaw."""


class IdentifiedValue(ResponseBody):
    """A value that was found in a flight."""

    value: float
    """The value."""
    error: float
    """Its standard error; a value below three of them is not used."""


class RerunResult(ResponseBody):
    """A part of a flight: as logged, flown again unchanged, and flown again with the change."""

    t_s: list[float]
    """Times [s since the log's start], of all tracks."""
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
    """Steady wind that was found in the log; 0: none was found."""
    source: Literal["parameters", "flight"]
    """Where the body is from: the log's SIH_* parameters, or found in this flight."""
    model: dict[str, IdentifiedValue]
    """What this part of the flight says: `thrust_m_s2` (all motors at full signal, by mass), `drag_per_s`
    (drag per speed, by mass), `wind_north_m_s`, `wind_east_m_s`, `roll_rad_s2`, `pitch_rad_s2`, `yaw_rad_s2`
    (angular acceleration at full signal); empty: too short."""
    notes: list[str]
    """What the log does not have, as sentences."""
