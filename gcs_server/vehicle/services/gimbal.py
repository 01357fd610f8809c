"""The gimbal manager (v2 protocol) of a vehicle.

PX4 v1.16: any station may take control. In CONFIGURE the value for "myself" means the vehicle, so this
server's ids are sent. Without control command 1000 is denied, and message 282 is ignored without an answer.
287 is not supported; angles beyond the range flip instead of being clamped. Without its gimbal module PX4
sends nothing.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass

from gcs_server.errors import NoReply, Refused, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.mavlink.mailbox import Reply
from gcs_server.vehicle.gimbal_decoder import control_of
from gcs_server.vehicle.numbers import rotation
from gcs_server.vehicle.samples import Gimbal
from gcs_server.vehicle.services.checks import number
from gcs_server.vehicle.services.gimbal_reach import GimbalLimited, wait_until_stopped
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Goal, Request, Transaction
from missions.frames import q_from_euler, wrap_pi

DEADLINE_S = 5.0
RESEND_S = 0.3
KEEP, RELEASE = -1.0, -3.0
NONE_SET = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
YAW_LOCK = d.GIMBAL_MANAGER_FLAGS_YAW_LOCK
MAX_PITCH_DEG = 90.0
MAX_RATE_DEG_S = 180.0
NEAR_RAD = math.radians(2.0)
NAN = math.nan
STATUS_ID = d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS
ATTITUDE_ID = d.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS


@dataclass(frozen=True, slots=True)
class Roi:
    """A location that the gimbal keeps pointing at."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


class GimbalService:
    """Takes and releases gimbal control, and points the camera.

    Raises as `CommandService`; `Refused` names the controller if it is not this server.
    """

    def __init__(self, vehicle: VehiclePort) -> None:
        self._vehicle = vehicle
        self.roi: Roi | None = None
        """The location that this server has set and not cleared; PX4 does not report it."""

    async def take_control(self) -> None:
        """Takes primary control; returns once the manager's status shows it."""
        self._vehicle.require_commandable()
        own_ids = self._vehicle.own_ids
        await self._configure(
            float(own_ids[0]), float(own_ids[1]), "take control of the gimbal", lambda c: c == own_ids
        )

    async def release_control(self) -> None:
        """Releases control if this server has it."""
        self._vehicle.require_commandable()
        own_ids = self._vehicle.own_ids
        if await self._control() != own_ids:
            return
        await self._configure(RELEASE, RELEASE, "release the gimbal", lambda c: c != own_ids)

    async def set_angles(
        self,
        pitch_deg: float,
        yaw_deg: float,
        *,
        roll_deg: float | None = None,
        yaw_lock: bool = False,
        wait: bool = True,
    ) -> GimbalLimited | None:
        """Points the camera. Pitch is positive up; yaw is relative to the nose, or to north with `yaw_lock`.

        Returns once the gimbal is there or has stopped earlier (returns where). Without `wait`, or if it does
        not report its attitude, returns once the vehicle has acknowledged.
        """
        number("pitch_deg", pitch_deg, -MAX_PITCH_DEG, MAX_PITCH_DEG)
        number("yaw_deg", yaw_deg, -360.0, 360.0)
        if roll_deg is not None:
            number("roll_deg", roll_deg, -180.0, 180.0)
        self._vehicle.require_commandable()
        self._check_limits(pitch_deg, yaw_deg, yaw_lock)
        await self._require_control()
        yaw_deg = math.degrees(wrap_pi(math.radians(yaw_deg)))
        if roll_deg is not None:
            await self._attitude(roll_deg, pitch_deg, yaw_deg, yaw_lock)
        else:
            await self._pitch_yaw(pitch_deg, yaw_deg, yaw_lock)
        self.roi = None
        return await wait_until_stopped(self._vehicle, pitch_deg, yaw_deg, yaw_lock) if wait else None

    def point(self, pitch_rad: float, yaw_ned_rad: float) -> None:
        """Points the camera without waiting, for targets that are sent many times a second.

        It uses GIMBAL_MANAGER_SET_ATTITUDE, which is not acknowledged and is ignored without control. Pitch
        is limited to the gimbal's range.
        """
        vehicle = self._vehicle
        sample = vehicle.topic("gimbal")
        gimbal = sample.value if sample is not None else None
        if isinstance(gimbal, Gimbal):
            low_rad, high_rad = gimbal.pitch_min_rad, gimbal.pitch_max_rad
            if low_rad is not None and high_rad is not None:
                pitch_rad = min(max(pitch_rad, low_rad), high_rad)
        identity, q = vehicle.identity, q_from_euler(0.0, pitch_rad, yaw_ned_rad)
        vehicle.send(
            d.MAVLink_gimbal_manager_set_attitude_message(
                identity.system_id, identity.component_id, YAW_LOCK, 0, list(q), NAN, NAN, NAN
            )
        )
        self.roi = None

    async def _pitch_yaw(self, pitch_deg: float, yaw_deg: float, yaw_lock: bool) -> None:
        flags = YAW_LOCK if yaw_lock else 0
        await self._acknowledged(
            Request(d.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, (pitch_deg, yaw_deg, NAN, NAN, float(flags), 0, 0)),
            "point the gimbal",
        )

    async def set_rates(
        self, pitch_rate_deg_s: float, yaw_rate_deg_s: float, *, yaw_lock: bool | None = None
    ) -> None:
        """Turns the camera at constant rates; zero stops both axes. `yaw_lock` None keeps the current
        setting."""
        number("pitch_rate_deg_s", pitch_rate_deg_s, -MAX_RATE_DEG_S, MAX_RATE_DEG_S)
        number("yaw_rate_deg_s", yaw_rate_deg_s, -MAX_RATE_DEG_S, MAX_RATE_DEG_S)
        self._vehicle.require_commandable()
        await self._require_control()
        if yaw_lock is None:
            sample = self._vehicle.topic("gimbal")
            yaw_lock = sample is not None and isinstance(sample.value, Gimbal) and sample.value.yaw_lock
        flags = float(YAW_LOCK if yaw_lock else 0)
        await self._acknowledged(
            Request(
                d.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
                (NAN, NAN, pitch_rate_deg_s, yaw_rate_deg_s, flags, 0, 0),
            ),
            "turn the gimbal",
        )
        self.roi = None

    async def set_roi(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Keeps the camera pointed at a location; needs no control."""
        number("lat_deg", lat_deg, -90.0, 90.0)
        number("lon_deg", lon_deg, -180.0, 180.0)
        number("alt_amsl_m", alt_amsl_m, -500.0, 10_000.0)
        self._vehicle.require_commandable()
        request = Request(
            d.MAV_CMD_DO_SET_ROI_LOCATION,
            (0, 0, 0, 0, lat_deg, lon_deg, alt_amsl_m),
            frame=d.MAV_FRAME_GLOBAL,
        )
        await self._acknowledged(request, "point at the location")
        self.roi = Roi(lat_deg, lon_deg, alt_amsl_m)

    async def clear_roi(self) -> None:
        """Stops pointing at a location."""
        self._vehicle.require_commandable()
        await self._acknowledged(
            Request(d.MAV_CMD_DO_SET_ROI_NONE, NONE_SET), "stop pointing at the location"
        )
        self.roi = None

    # --- the parts ------------------------------------------------------------------------------

    async def _acknowledged(self, request: Request, what: str) -> None:
        """No state shows these at once, because a gimbal moves slowly: the acknowledgement is the answer."""
        goal = Goal(what, lambda _f, _s: False, DEADLINE_S, asks=(), ack_is_enough=True)
        await self._guarded(Transaction(self._vehicle, request, goal), what)

    async def _configure(
        self, system: float, component: float, what: str, accepts: Callable[[tuple[int, int] | None], bool]
    ) -> None:
        def reached(_flight_state: object, since_s: float) -> bool:
            newest = self._vehicle.newest_payload(STATUS_ID)
            return newest is not None and newest[1] > since_s and accepts(control_of(newest[0]))

        goal = Goal(what, reached, DEADLINE_S, asks=(STATUS_ID,), listen=(STATUS_ID,))
        request = Request(d.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, (system, component, KEEP, KEEP, 0, 0, 0))
        if system == RELEASE:
            request = Request(request.command, (RELEASE, RELEASE, RELEASE, RELEASE, 0, 0, 0))
        await self._guarded(Transaction(self._vehicle, request, goal), what)

    async def _guarded(self, transaction: Transaction, what: str) -> None:
        try:
            await transaction.run()
        except NoReply as error:
            raise NoReply(
                f"Vehicle {self._vehicle.id} did not answer the request to {what} within "
                f"{error.deadline_s:g} s.",
                deadline_s=error.deadline_s,
                remedy="It may have no gimbal (PX4: set MNT_MODE_IN 4 and MNT_MODE_OUT, then restart it).",
            ) from None

    async def _control(self) -> tuple[int, int] | None:
        """Requests who controls the gimbal.

        Raises:
            NoReply: no gimbal manager answers.
        """
        fresh: list[tuple[int, int] | None] = []

        def reached(_flight_state: object, since_s: float) -> bool:
            newest = self._vehicle.newest_payload(STATUS_ID)
            if newest is None or newest[1] <= since_s:
                return False
            fresh.append(control_of(newest[0]))
            return True

        what = "report who controls the gimbal"
        goal = Goal(what, reached, DEADLINE_S, asks=(STATUS_ID,), listen=(STATUS_ID,))
        try:
            await self._guarded(Transaction(self._vehicle, None, goal), what)
        except Rejected as error:  # the vehicle is connected, but has no gimbal
            raise NoReply(
                f"Vehicle {self._vehicle.id} reports no gimbal.",
                deadline_s=DEADLINE_S,
                remedy="PX4: set MNT_MODE_IN 4 and MNT_MODE_OUT, then restart it.",
            ) from error
        return fresh[-1]

    async def _require_control(self) -> None:
        control = await self._control()
        if control == self._vehicle.own_ids:
            return
        if control is None:
            raise Refused("The gimbal is not controlled.", remedy="Take control of it first.")
        raise Refused(
            f"The gimbal is controlled by system {control[0]}, component {control[1]}, not by this server.",
            remedy="Ask that station, or take control: then it loses control.",
        )

    def _check_limits(self, pitch_deg: float, yaw_deg: float, yaw_lock: bool) -> None:
        sample = self._vehicle.topic("gimbal")
        gimbal = sample.value if sample is not None else None
        if not isinstance(gimbal, Gimbal):
            return
        if gimbal.pitch_min_rad is not None and gimbal.pitch_max_rad is not None:
            number(
                "pitch_deg", pitch_deg, math.degrees(gimbal.pitch_min_rad), math.degrees(gimbal.pitch_max_rad)
            )
        if not yaw_lock and gimbal.yaw_min_rad is not None and gimbal.yaw_max_rad is not None:
            number("yaw_deg", yaw_deg, math.degrees(gimbal.yaw_min_rad), math.degrees(gimbal.yaw_max_rad))

    async def _attitude(self, roll_deg: float, pitch_deg: float, yaw_deg: float, yaw_lock: bool) -> None:
        """Roll needs GIMBAL_MANAGER_SET_ATTITUDE, which is not acknowledged: it is sent until the device's
        attitude is there or moves."""
        vehicle = self._vehicle
        q = q_from_euler(math.radians(roll_deg), math.radians(pitch_deg), math.radians(yaw_deg))
        identity = vehicle.identity
        message = d.MAVLink_gimbal_manager_set_attitude_message(
            identity.system_id, identity.component_id, YAW_LOCK if yaw_lock else 0, 0, list(q), NAN, NAN, NAN
        )
        began_s = vehicle.clock.monotonic_s()
        first: float | None = None
        with vehicle.mailbox.expect(ATTITUDE_ID) as waiter:
            while (left_s := began_s + DEADLINE_S - vehicle.clock.monotonic_s()) > 0:
                vehicle.send(message)
                vehicle.send(self._ask_attitude())
                try:
                    async with asyncio.timeout(min(RESEND_S, left_s)):
                        off_rad = _angle_between(q, await waiter.next())
                except TimeoutError:
                    continue
                first = off_rad if first is None else first
                if off_rad < NEAR_RAD or off_rad < first - NEAR_RAD:
                    return
        if first is None:
            raise NoReply(
                f"Vehicle {vehicle.id} does not report its gimbal's attitude.",
                deadline_s=DEADLINE_S,
                remedy="Without roll the request is acknowledged and needs no attitude report.",
            )
        raise Rejected(f"The gimbal of vehicle {vehicle.id} does not move to this attitude.")

    def _ask_attitude(self) -> MAVLink_message:
        identity = self._vehicle.identity
        request = Request(d.MAV_CMD_REQUEST_MESSAGE, (float(ATTITUDE_ID), 0, 0, 0, 0, 0, 0))
        return request.message(identity.system_id, identity.component_id, 0, False)


def _angle_between(q: tuple[float, float, float, float], message: Reply) -> float:
    """Angle between an attitude and the reported one [rad]; half a turn if there is no valid report."""
    reported = rotation(message.q)
    if reported is None:
        return math.pi
    dot = abs(sum(a * b for a, b in zip(q, reported, strict=True)))
    return 2 * math.acos(min(1.0, dot))
