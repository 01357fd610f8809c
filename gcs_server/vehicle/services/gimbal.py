"""The gimbal manager (v2 protocol) of a vehicle."""

from __future__ import annotations


class GimbalService:
    """Look at who is in control, take it, point, give it back.

    Raises as `CommandService`; `Refused` names who is in control where it is not us.
    """

    async def take_control(self) -> None:
        """Becomes primary control; returns once the manager's status shows it."""
        raise NotImplementedError

    async def release_control(self) -> None:
        """Gives control back where it is ours."""
        raise NotImplementedError

    async def set_angles(
        self, pitch_deg: float, yaw_deg: float, *, roll_deg: float | None = None, yaw_lock: bool = False
    ) -> None:
        """Points the camera. Pitch positive up; yaw from the nose, from north with `yaw_lock`."""
        raise NotImplementedError

    async def set_rates(
        self, pitch_rate_deg_s: float, yaw_rate_deg_s: float, *, yaw_lock: bool = False
    ) -> None:
        """Turns the camera steadily; zero stops both axes and keeps `yaw_lock`."""
        raise NotImplementedError

    async def set_roi(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Keeps looking at a place; needs no control."""
        raise NotImplementedError

    async def clear_roi(self) -> None:
        """Stops looking at a place."""
        raise NotImplementedError
