"""Commands a person gives: each succeeds when the vehicle's own state shows it."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float | None], None]
"""(what is happening, fraction 0–1 or None); for people."""

GOTO_MAX_DISTANCE_M = 1000.0
TAKEOFF_MIN_M, TAKEOFF_MAX_M = 1.0, 120.0


class CommandService:
    """Arm, modes, take-off, go-to.

    Every method raises Refused (NotVerified) without sending, InvalidRequest for bad values, Rejected
    with the vehicle's reasons, NoReply at the deadline, Disconnected when vehicle or link went.
    """

    async def arm(self, *, progress: Progress | None = None) -> None:
        """Returns once the vehicle reports to be armed."""
        raise NotImplementedError

    async def disarm(self, *, progress: Progress | None = None) -> None:
        """Returns once the vehicle reports to be disarmed; PX4 refuses it in flight."""
        raise NotImplementedError

    async def set_mode(self, name: str, *, progress: Progress | None = None) -> None:
        """Returns once the vehicle reports the mode. `name` as in `Status.mode`."""
        raise NotImplementedError

    async def takeoff(self, alt_home_m: float, *, progress: Progress | None = None) -> None:
        """Arms where needed and climbs; returns once the vehicle is taking off (not: has arrived)."""
        raise NotImplementedError

    async def land(self, *, progress: Progress | None = None) -> None:
        """Lands where it is."""
        raise NotImplementedError

    async def rtl(self, *, progress: Progress | None = None) -> None:
        """Returns to the launch position and lands, as the vehicle's own RTL does."""
        raise NotImplementedError

    async def hold(self, *, progress: Progress | None = None) -> None:
        """Stops and stays."""
        raise NotImplementedError

    async def goto(
        self,
        lat_deg: float,
        lon_deg: float,
        *,
        alt_amsl_m: float | None = None,
        alt_home_m: float | None = None,
        yaw_ned_deg: float | None = None,
        max_distance_m: float = GOTO_MAX_DISTANCE_M,
        progress: Progress | None = None,
    ) -> None:
        """Flies there in Hold; exactly one altitude. Returns once under way (not: has arrived)."""
        raise NotImplementedError

    async def kill(self, *, progress: Progress | None = None) -> None:
        """Stops the motors at once, in flight too: the vehicle falls."""
        raise NotImplementedError
