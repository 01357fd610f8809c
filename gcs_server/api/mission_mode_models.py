"""Request and response bodies of the routes for missions that are registered with PX4 as flight modes."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from gcs_server.api.offboard_mission_models import WhichMission
from gcs_server.api.reflect import model_of
from gcs_server.api.strict_body import StrictBody
from gcs_server.streamer.missions.mode_status import MissionModeStatus

MAX_DEFERRAL_S = 120
MODE_NAME_PATTERN = r"^[!-~]([ -~]{0,22}[!-~])?$"


class RegisterMode(WhichMission):
    """The mission to register, and the name of its mode."""

    name: str = Field(
        pattern=MODE_NAME_PATTERN,
        max_length=24,
        description="Name of the mode, which all ground stations show: 1 to 24 printable ASCII characters, "
        "without a space at either end.",
    )
    defer_failsafes_s: int = Field(
        default=0,
        ge=0,
        le=MAX_DEFERRAL_S,
        description="How long PX4 may defer a failsafe while the vehicle flies in the mode [s]; 0: never. "
        "PX4 defers its reaction to a lost ground station connection, lost manual control or a low battery.",
    )


class UnregisterMode(StrictBody):
    """The mode to remove."""

    name: str = Field(max_length=24, description="Name of the mode.")


MissionModeModel = model_of(MissionModeStatus)


class MissionModesView(BaseModel):
    """The missions of this server that are registered with a vehicle as flight modes."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    vehicle: str = Field(description="The vehicle's id.")
    possible: bool = Field(
        description="Whether modes can be registered: the server has a ROS 2 connection to the vehicle."
    )
    modes: list[MissionModeModel] = Field(description="The registered modes.")  # type: ignore[valid-type]
