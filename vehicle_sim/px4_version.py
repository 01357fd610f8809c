"""The versions of PX4 that a vehicle can simulate, as a table of what differs between them.

What PX4 v1.17 does differently was recorded beside v1.16. Parameters and events that came, went or changed
are in `data/px4_1_17.json`; whether a parameter exists is asked of the parameters, not of the version.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

DATA_FOLDER: Final = Path(__file__).parent / "data"


@dataclass(frozen=True, eq=False)
class Px4Version:
    """One version of PX4; the defaults are those of v1.16."""

    name: str
    """Major and minor number, as on the command line."""
    release: int
    """AUTOPILOT_VERSION.flight_sw_version; the last byte marks a release."""
    git_hash: str
    mavlink_hash: bytes
    """First bytes of the hash of its MAVLink definitions, as in PROTOCOL_VERSION."""
    differences_file: str = ""
    """Name of the file of differences from v1.16; empty: none."""
    max_mavlink_version: int = 200
    gnss_integrity: bool = False
    """Whether GNSS_INTEGRITY is streamed."""
    not_streamed_interval_us: int = 0
    """MESSAGE_INTERVAL.interval_us of a message that is not streamed."""
    interval_on_request: bool = False
    """Whether REQUEST_MESSAGE of MESSAGE_INTERVAL is answered."""
    requests_int_first: bool = False
    """Whether the first upload after a boot is requested with MISSION_REQUEST_INT."""
    arms_by_mission_item: bool = False
    """Whether ARM_DISARM may be an item of a mission."""
    completes_return_item: bool = False
    """Whether a return as an item of a mission is reached at once, so that the mission is finished before the
    return begins."""
    reports_mission_state: bool = False
    """Whether MISSION_CURRENT has state and mode."""
    airspeed_without_sensor_m_s: float = 0.0
    altitude_cruise: bool = False
    """Whether there is a mode Altitude Cruise."""
    corrects_home: bool = False
    """Whether home's altitude is corrected for two minutes after a take-off."""
    home_has_tilt: bool = False
    """Whether home has roll and pitch, and is not reset by a later take-off of a mission."""
    smooths_heading: bool = False
    """Whether MPC_YAWRAUTO_ACC limits how fast the heading of a trajectory begins and ends a turn."""
    fallback_needs_sticks: bool = False
    """Whether NAV_RCL_ACT replaces a failsafe's Position, Altitude or Stabilized mode without sticks."""
    limits_topics: bool = False
    """Whether ROS 2 topics have shortest periods of their own."""
    reply_valid_s: float = math.inf
    """Age from which a reply to an arming check is ignored."""
    disarms_to_owned_mode: bool = False
    """Whether disarming selects the mode that the executor in charge owns, instead of the mode before the
    landing, and Hold instead of a mode that does not answer."""
    relaxed_global_position: bool = False
    """Whether a mode can require a global position of less accuracy."""

    @cached_property
    def differences(self) -> dict[str, Any]:
        """What the file of differences contains."""
        if not self.differences_file:
            return {}
        return json.loads((DATA_FOLDER / self.differences_file).read_text(encoding="utf-8"))

    @property
    def custom_version(self) -> tuple[int, ...]:
        """AUTOPILOT_VERSION.flight_custom_version: the start of the git hash, its last byte first."""
        return tuple(int(self.git_hash[:10] + "000000", 16).to_bytes(8, "little"))


V1_16: Final = Px4Version(
    name="1.16",
    release=0x011000FF,
    git_hash="6ea3539157ca358c70a515878b77077af7d4611d",
    mavlink_hash=bytes((2, 246, 129, 2, 216, 118, 253, 91)),
)
V1_17: Final = Px4Version(
    name="1.17",
    release=0x011100FF,
    git_hash="d6f12ad1c4f70ad3230afd7d86e971421e02fef4",
    mavlink_hash=bytes((9, 111, 236, 37, 13, 32, 175, 51)),
    differences_file="px4_1_17.json",
    max_mavlink_version=203,
    gnss_integrity=True,
    not_streamed_interval_us=-1,
    interval_on_request=True,
    requests_int_first=True,
    arms_by_mission_item=True,
    completes_return_item=True,
    reports_mission_state=True,
    airspeed_without_sensor_m_s=float("nan"),
    altitude_cruise=True,
    corrects_home=True,
    home_has_tilt=True,
    smooths_heading=True,
    fallback_needs_sticks=True,
    limits_topics=True,
    reply_valid_s=0.3,
    disarms_to_owned_mode=True,
    relaxed_global_position=True,
)
VERSIONS: Final = {each.name: each for each in (V1_16, V1_17)}
DEFAULT: Final = V1_17
"""The version that is simulated unless another one is given."""
