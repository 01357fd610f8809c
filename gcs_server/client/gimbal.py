"""Gimbal commands of a program: control, angles, rates, ROI."""

from __future__ import annotations

from typing import Any

from gcs_server.client.control import VehicleApi
from gcs_server.client.setpoints import Body


class Gimbal:
    """The vehicle's gimbal; angles in degrees, pitch up positive."""

    def __init__(self, vehicle: VehicleApi, query: str = "") -> None:
        self._vehicle = vehicle
        self._query = query

    def at(self, *, component: int | None = None, device: int | None = None) -> Gimbal:
        """Selects another gimbal of the vehicle; the topic `gimbal` lists them in `gimbals`.

        Args:
            component: MAVLink component id of the gimbal manager (`component_id`).
            device: `gimbal_device_id`, if the gimbal manager has several gimbals.
        """
        selectors = (("component", component), ("device", device))
        query = "&".join(f"{name}={value}" for name, value in selectors if value is not None)
        return Gimbal(self._vehicle, f"?{query}" if query else "")

    async def _post(self, path: str, body: Body | None = None) -> Any:
        return await self._vehicle.request("POST", f"/gimbal/{path}{self._query}", body)

    async def take(self) -> None:
        """Takes control of the gimbal."""
        await self._post("take")

    async def release(self) -> None:
        """Releases control of the gimbal."""
        await self._post("release")

    async def angles(
        self, pitch_deg: float, yaw_deg: float, *, roll_deg: float | None = None, yaw_lock: bool = False
    ) -> dict[str, Any] | None:
        """Points the gimbal; yaw is relative to the nose, or to north with `yaw_lock`.

        Returns:
            The angles at which a limit stopped the gimbal (`limited` of the response); None if it reached the
            commanded angles.
        """
        body: Body = {"pitch_deg": pitch_deg, "yaw_deg": yaw_deg, "yaw_lock": yaw_lock}
        if roll_deg is not None:
            body = {**body, "roll_deg": roll_deg}
        return (await self._post("angles", body))["limited"]

    async def rates(
        self, pitch_rate_deg_s: float, yaw_rate_deg_s: float, *, yaw_lock: bool | None = None
    ) -> None:
        """Turns the gimbal at constant rates until the next command; zeros stop both axes. `yaw_lock` None
        keeps the gimbal's current setting."""
        body: Body = {"pitch_rate_deg_s": pitch_rate_deg_s, "yaw_rate_deg_s": yaw_rate_deg_s}
        await self._post("rates", {**body, "yaw_lock": yaw_lock})

    async def roi(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Keeps the camera pointed at a location."""
        await self._post("roi", {"lat_deg": lat_deg, "lon_deg": lon_deg, "alt_amsl_m": alt_amsl_m})

    async def clear_roi(self) -> None:
        """Stops pointing at a location."""
        await self._post("roi/clear")
