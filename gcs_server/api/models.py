"""Request bodies of flight commands, gimbals, links and replays."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from gcs_server.api.strict_body import Latitude, Longitude, StrictBody, example
from gcs_server.links.names import MAX_NAME_LENGTH, NAME_RULE
from gcs_server.replay.playback import MAX_SPEED, MIN_SPEED
from gcs_server.vehicle.services.guided import OrbitYaw

Despite = Annotated[list[Annotated[str, Field(max_length=40)]], Field(max_length=50)]
"""Codes of the error findings that the caller accepts."""


class ArmRequest(StrictBody):
    """What the caller accepts when it arms."""

    model_config = example(despite=["arming_starts_flight"])

    despite: Despite = Field(default=[])
    """Codes that the caller accepts: `arming_starts_flight` if the vehicle is in a mode in which arming
    starts a flight (Take off, Mission); in Mission also those of `mission/start`."""


class TakeoffRequest(StrictBody):
    """The take-off altitude."""

    model_config = example(alt_home_m=10)

    alt_home_m: float = Field(allow_inf_nan=False, ge=1, le=120)
    """Altitude above home to climb to [m], 1 to 120."""


class ModeRequest(StrictBody):
    """The flight mode to switch to."""

    model_config = example(mode="position")

    mode: str = Field(min_length=1, max_length=32)
    """hold, position, altitude, mission, … as in `status.mode`."""
    despite: Despite = Field(default=[])
    """For the mode mission: codes as for `mission/start`."""


class TargetAltitude(StrictBody):
    """An altitude; exactly one of the two."""

    alt_amsl_m: float | None = Field(default=None, allow_inf_nan=False, ge=-500, le=10_000)
    """Above mean sea level [m]."""
    alt_home_m: float | None = Field(default=None, allow_inf_nan=False, ge=-100, le=1000)
    """Above home [m]."""
    max_distance_m: float | None = Field(default=None, allow_inf_nan=False, gt=0, le=100_000)
    """Refuse a target that is farther away than this [m]; default 1000."""
    despite: Despite = Field(default=[])
    """Codes of findings about the vehicle's geofence that the caller accepts: `fence_violation`,
    `fence_crossed`, `fence_unknown`, `radius_exceeded` (GF_MAX_HOR_DIST), `altitude_fence`
    (GF_MAX_VER_DIST)."""

    @model_validator(mode="after")
    def _check_one_altitude(self) -> Self:
        if (self.alt_amsl_m is None) == (self.alt_home_m is None):
            raise ValueError("give exactly one of alt_amsl_m and alt_home_m")
        return self


class AltitudeRequest(TargetAltitude):
    """The altitude to climb or descend to; exactly one of the two."""

    model_config = example(alt_home_m=20)


class GotoRequest(TargetAltitude):
    """The target position; exactly one of the two altitudes."""

    model_config = example(lat_deg=47.3982, lon_deg=8.5462, alt_home_m=15)

    lat_deg: Latitude
    lon_deg: Longitude
    yaw_ned_deg: float | None = Field(default=None, allow_inf_nan=False, ge=-360, le=360)
    """Heading clockwise from north [deg]."""
    speed_m_s: float | None = Field(default=None, allow_inf_nan=False, ge=0.1, le=100)
    """Ground speed [m/s], at most MPC_XY_VEL_MAX. Default: the speed of an earlier command since the vehicle
    has been in Hold, otherwise MPC_XY_CRUISE."""


class OrbitRequest(TargetAltitude):
    """The circle; exactly one of the two altitudes."""

    model_config = example(lat_deg=47.3982, lon_deg=8.5462, alt_home_m=15, radius_m=20, speed_m_s=3)

    lat_deg: Latitude
    """Of the centre."""
    lon_deg: Longitude
    """Of the centre."""
    radius_m: float = Field(allow_inf_nan=False, ge=1, le=10_000)
    """Radius [m], at most MC_ORBIT_RAD_MAX."""
    speed_m_s: float = Field(allow_inf_nan=False, ge=0.1, le=100)
    """Speed along the circle [m/s], at most MPC_XY_VEL_MAX, and the square root of 2 m/s² times the radius:
    PX4 would limit it without a word."""
    clockwise: bool = True
    """Direction, seen from above."""
    yaw: OrbitYaw | None = None
    """Where the nose points: to the `center`, as at the beginning (`initial`), along the circle (`tangent`),
    or anywhere (`uncontrolled`). Default: as MC_ORBIT_YAW_MOD says."""


class HeadingRequest(StrictBody):
    """The heading."""

    model_config = example(yaw_ned_deg=90)

    yaw_ned_deg: float = Field(allow_inf_nan=False, ge=-360, le=360)
    """Clockwise from north [deg]."""


class SpeedRequest(StrictBody):
    """The ground speed."""

    model_config = example(speed_m_s=3)

    speed_m_s: float = Field(allow_inf_nan=False, ge=0.1, le=100)
    """At most MPC_XY_VEL_MAX [m/s]."""


class HomeRequest(StrictBody):
    """The position of home: `{"here": true}`, or a position."""

    model_config = example(lat_deg=47.3982, lon_deg=8.5462)

    here: bool = False
    """The vehicle's position."""
    lat_deg: Latitude | None = None
    """Degrees north, WGS 84."""
    lon_deg: Longitude | None = None
    """Degrees east, WGS 84."""
    alt_amsl_m: float | None = Field(default=None, allow_inf_nan=False, ge=-500, le=10_000)
    """Above mean sea level [m]. Default: the ground there if elevation files show it, otherwise the altitude
    of the present home."""
    max_distance_m: float | None = Field(default=None, allow_inf_nan=False, gt=0, le=100_000)
    """Refuse a position that is farther from the vehicle than this [m]; default 1000."""

    @model_validator(mode="after")
    def _check_one_position(self) -> Self:
        if self.here == (self.lat_deg is not None) or (self.lat_deg is None) != (self.lon_deg is None):
            raise ValueError("give either here: true, or lat_deg and lon_deg")
        if self.here and self.alt_amsl_m is not None:
            raise ValueError("here: true takes no alt_amsl_m: it is the vehicle's own altitude")
        return self


class KillRequest(StrictBody):
    """Confirmation of Stop motors."""

    model_config = example(confirm="motors stop, vehicle 1 falls")

    confirm: str = Field(max_length=100)
    """Exactly `motors stop, vehicle {id} falls`, with the vehicle's id."""


class GimbalAngles(StrictBody):
    """The gimbal's target angles."""

    model_config = example(pitch_deg=-30, yaw_deg=0)

    pitch_deg: float = Field(allow_inf_nan=False, ge=-180, le=180)
    """Pitch; up is positive [deg]."""
    yaw_deg: float = Field(allow_inf_nan=False, ge=-360, le=360)
    """Yaw relative to the nose, or relative to north with `yaw_lock` [deg]."""
    roll_deg: float | None = Field(default=None, allow_inf_nan=False, ge=-180, le=180)
    """Roll; right side down is positive [deg]."""
    yaw_lock: bool = False
    """Keep the direction while the vehicle turns."""
    wait: bool = True
    """Answer once the gimbal has reached the angles or stopped; false: answer once the vehicle has
    acknowledged, for rapid sequences of angles."""


class GimbalRates(StrictBody):
    """The gimbal's turning rates; zero stops both axes."""

    model_config = example(pitch_rate_deg_s=5, yaw_rate_deg_s=-10)

    pitch_rate_deg_s: float = Field(allow_inf_nan=False, ge=-360, le=360)
    """Pitch rate, upward [deg/s]."""
    yaw_rate_deg_s: float = Field(allow_inf_nan=False, ge=-360, le=360)
    """Yaw rate, clockwise [deg/s]."""
    yaw_lock: bool | None = None
    """Keep the direction while the vehicle turns; null: keep the gimbal's current setting."""


class GimbalRoi(StrictBody):
    """A location at which the camera stays pointed (ROI)."""

    model_config = example(lat_deg=47.3982, lon_deg=8.5462, alt_amsl_m=488)

    lat_deg: Latitude
    lon_deg: Longitude
    alt_amsl_m: float = Field(allow_inf_nan=False, ge=-500, le=10_000)
    """Above mean sea level [m]."""


class LinkRequest(StrictBody):
    """A link to open."""

    model_config = example(url="udpin://127.0.0.1:14551", name="second")

    url: str = Field(min_length=3, max_length=500)
    """udpin://, udpout://, tcp://, tcpin://, serial:, tlog: or ros2:// URL."""
    name: str | None = Field(
        default=None,
        min_length=1,
        max_length=MAX_NAME_LENGTH,
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        description=f"Name of the link: {NAME_RULE}; default: derived from the URL.",
    )


class ReplayRequest(StrictBody):
    """The recording to replay, and playback options."""

    model_config = example(recording="20260711-093000-udpin-127.0.0.1-14550.tlog")

    recording: str = Field(min_length=1, max_length=255)
    """Name of a recording in `GET /recordings`."""
    speed: float = Field(default=1.0, allow_inf_nan=False, ge=MIN_SPEED, le=MAX_SPEED)
    """Playback speed; 1 is real time."""
    playing: bool = True
    """Whether playback starts immediately."""


class ReplayChange(StrictBody):
    """Changes of a replay; omitted fields stay unchanged."""

    model_config = example(playing=True, speed=4, position_unix_s=1783762200)

    playing: bool | None = None
    """Whether to play; at the end, playing restarts from the beginning."""
    speed: float | None = Field(default=None, allow_inf_nan=False, ge=MIN_SPEED, le=MAX_SPEED)
    """Playback speed; 1 is real time."""
    position_unix_s: float | None = Field(default=None, allow_inf_nan=False, ge=0, le=10_000_000_000)
    """Time to jump to [s since 1970, recording clock]; the nearest recorded time is used."""
