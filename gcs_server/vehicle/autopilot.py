"""What differs between autopilots, and between the releases of one: modes, which vehicles this server
commands, the action when setpoints stop. PX4's own tables are in `px4/`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from gcs_server.mavlink import dialect as d
from gcs_server.vehicle.px4.modes import mode_name
from gcs_server.vehicle.px4.stream_loss import StreamLoss

_NAMES = {d.MAV_AUTOPILOT_ARDUPILOTMEGA: "ArduPilot"}
_OLDEST, _NEWEST = (1, 14), (1, 17)
"""Releases of PX4 with which this server was tested, or whose differences are known."""
_COMMANDED_TYPES = frozenset(
    {
        d.MAV_TYPE_QUADROTOR,
        d.MAV_TYPE_HEXAROTOR,
        d.MAV_TYPE_OCTOROTOR,
        d.MAV_TYPE_TRICOPTER,
        d.MAV_TYPE_COAXIAL,
        d.MAV_TYPE_DODECAROTOR,
        d.MAV_TYPE_DECAROTOR,
    }
)


class Autopilot:
    """An autopilot that the server shows and does not command.

    Args:
        kind: MAV_AUTOPILOT.
        release: major and minor version; None: not known.
    """

    supported = False
    """Whether the server knows its modes and commands."""

    def __init__(self, kind: int, release: tuple[int, int] | None = None) -> None:
        self.name = _NAMES.get(kind, f"autopilot type {kind}")
        self.release = release

    @property
    def untested(self) -> str | None:
        """A clause about a release with which this server was not tested; None: it was, or is not known."""
        return None

    def commands(self, vehicle_type: int) -> bool:
        """Whether this server commands vehicles of this MAV_TYPE with it."""
        return False

    def mode_name(self, custom_mode: int) -> tuple[str, str]:
        """Name in the API, and label, of a mode; its number if it is not known."""
        return f"custom_{custom_mode}", f"Mode {custom_mode}"

    def stream_loss(self, parameters: Mapping[str, float], transmitter: bool) -> StreamLoss:
        """The vehicle's action when setpoints stop; see `StreamLoss.of`."""
        return StreamLoss(None, None, transmitter)


class Px4(Autopilot):
    """PX4."""

    supported = True

    def __init__(self, release: tuple[int, int] | None = None) -> None:
        super().__init__(d.MAV_AUTOPILOT_PX4, release)
        self.name = "PX4"

    @property
    def untested(self) -> str | None:
        """See `Autopilot`."""
        if self.release is None or _OLDEST <= self.release <= _NEWEST:
            return None
        which = "older" if self.release < _OLDEST else "newer"
        name = f"PX4 v{self.release[0]}.{self.release[1]}"
        return (
            f"{name}, which is {which} than what this server was tested with: it may act otherwise than said"
        )

    def commands(self, vehicle_type: int) -> bool:
        """Multicopters; commands were not tested with other vehicles."""
        return vehicle_type in _COMMANDED_TYPES

    def mode_name(self, custom_mode: int) -> tuple[str, str]:
        """See `Autopilot`."""
        return mode_name(custom_mode)

    def stream_loss(self, parameters: Mapping[str, float], transmitter: bool) -> StreamLoss:
        """See `Autopilot`."""
        return StreamLoss.of(parameters, transmitter, self.release)


@lru_cache(maxsize=64)
def autopilot_of(kind: int, firmware: str | None = None) -> Autopilot:
    """The autopilot of a vehicle, given its MAV_AUTOPILOT and its version, as `1.17.0`."""
    release = None
    if firmware is not None:
        major, minor, *_ = firmware.split(".")
        release = (int(major), int(minor))
    return Px4(release) if kind == d.MAV_AUTOPILOT_PX4 else Autopilot(kind, release)
