"""A gimbal of a vehicle, commanded through its gimbal manager (gimbal protocol v2).

With PX4 v1.16, any station may take control. In MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE the value -2 ("set itself
in control") gives control to the vehicle, so the server sends its own ids. From a station without control,
PX4 denies MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, and ignores GIMBAL_MANAGER_SET_ATTITUDE without an
acknowledgement. PX4 does not support GIMBAL_MANAGER_SET_PITCHYAW, and wraps angles beyond the range instead
of limiting them. Without its gimbal module PX4 sends no gimbal messages.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from gcs_server.errors import NoReply, Refused, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.dialect import MAVLink_message
from gcs_server.mavlink.mailbox import Reply
from gcs_server.vehicle.gimbal_decoder import control_of
from gcs_server.vehicle.gimbals import GimbalAddress, is_attitude_of
from gcs_server.vehicle.numbers import rotation
from gcs_server.vehicle.samples import Gimbal, GimbalReading
from gcs_server.vehicle.services.checks import check_range
from gcs_server.vehicle.services.gimbal_limits import GimbalLimited, wait_until_stopped
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Goal, Request, Transaction
from missions.frames import q_from_euler, wrap_pi

DEADLINE_S = 5.0
RESEND_S = 0.3
KEEP, RELEASE = -1.0, -3.0
Pose = Literal["neutral", "retract", "centre"]
Axis = Literal["roll", "pitch", "yaw"]
MAX_ROLL_DEG = 180.0
YAW_LOCK = d.GIMBAL_MANAGER_FLAGS_YAW_LOCK
MAX_PITCH_DEG = 90.0
MAX_RATE_DEG_S = 180.0
ATTITUDE_TOLERANCE_RAD = math.radians(2.0)
NAN = math.nan
STATUS_ID = d.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS
LOCK_REPORTED_AFTER_S = 2.0
"""Time after a command until which the gimbal may still report the yaw lock before it [s]."""
ATTITUDE_ID = d.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS


@dataclass(frozen=True, slots=True)
class Roi:
    """A location that the gimbal keeps pointing at."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


class GimbalService:
    """Takes and releases gimbal control, and points the camera.

    Raises the errors of `CommandService`; `Refused` names the controller of the gimbal if another station has
    control.

    Args:
        vehicle: the vehicle of the gimbal.
        address: the gimbal's address; None: the vehicle's first gimbal.
        rois: locations that this server has set, by gimbal; shared by all services of the vehicle.
    """

    def __init__(
        self,
        vehicle: VehiclePort,
        address: GimbalAddress | None = None,
        rois: dict[GimbalAddress | None, Roi] | None = None,
    ) -> None:
        self._vehicle = vehicle
        self._address = address
        self._rois: dict[GimbalAddress | None, Roi] = {} if rois is None else rois
        self._commanded_lock: tuple[bool, float] | None = None
        """The newest commanded yaw lock, and when it was commanded [s, monotonic]."""

    @property
    def roi(self) -> Roi | None:
        """The location that this server has set and not cleared; PX4 does not report it."""
        return self._rois.get(self._gimbal_address())

    async def take_control(self) -> None:
        """Takes primary control; returns once the manager reports this server as the controller."""
        self._vehicle.require("gimbal")
        own_ids = self._vehicle.own_ids
        await self._configure(
            float(own_ids[0]), float(own_ids[1]), "take control of the gimbal", lambda c: c == own_ids
        )

    async def release_control(self) -> None:
        """Releases control if this server has control."""
        self._vehicle.require("gimbal")
        own_ids = self._vehicle.own_ids
        if await self._request_controller() != own_ids:
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

        Returns None once the gimbal has reached the angles. If the gimbal stops at other angles, returns
        these angles. Without `wait`, or if the gimbal does not report its attitude, returns None once the
        vehicle has acknowledged the command.
        """
        check_range("pitch_deg", pitch_deg, -MAX_PITCH_DEG, MAX_PITCH_DEG)
        check_range("yaw_deg", yaw_deg, -360.0, 360.0)
        if roll_deg is not None:
            check_range("roll_deg", roll_deg, -MAX_ROLL_DEG, MAX_ROLL_DEG)
        self._vehicle.require("gimbal")
        self._check_limits(pitch_deg, yaw_deg, yaw_lock)
        await self._require_control()
        yaw_deg = math.degrees(wrap_pi(math.radians(yaw_deg)))
        self._record_lock(yaw_lock)
        if roll_deg is not None:
            await self._point_with_roll(roll_deg, pitch_deg, yaw_deg, yaw_lock)
        else:
            await self._point_pitch_yaw(pitch_deg, yaw_deg, yaw_lock)
        self._rois.pop(self._gimbal_address(), None)
        if not wait:
            return None
        component_id, _ = self._target()
        return await wait_until_stopped(
            self._vehicle, component_id, self.reading, (pitch_deg, yaw_deg, yaw_lock)
        )

    async def set_pose(self, pose: Pose) -> None:
        """Moves to the neutral or the retracted position, or to the centre (level and straight ahead). Where
        these positions are, the gimbal decides; PX4's servo outputs centre for each."""
        if pose == "centre":
            await self.set_angles(0.0, 0.0)
            return
        self._vehicle.require("gimbal")
        await self._require_control()
        flag = d.GIMBAL_MANAGER_FLAGS_NEUTRAL if pose == "neutral" else d.GIMBAL_MANAGER_FLAGS_RETRACT
        await self._run_until_acknowledged(
            Request(
                d.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, (NAN, NAN, NAN, NAN, float(flag), 0, self._device())
            ),
            f"go to its {pose} position" if pose == "neutral" else "retract",
        )
        self._rois.pop(self._gimbal_address(), None)

    async def try_axis(
        self, axis: Axis, angle_deg: float, *, while_armed: bool = False
    ) -> GimbalLimited | None:
        """Turns one axis to an angle and the others to zero, for a test on the bench.

        Args:
            axis: the axis.
            angle_deg: right side down, up, or to the right is positive.
            while_armed: also while the vehicle is armed, so that its motors may turn.

        Raises:
            Refused: the vehicle is armed, or another station controls the gimbal.
        """
        vehicle = self._vehicle
        if vehicle.status.armed and not while_armed:
            raise Refused(
                f"Vehicle {vehicle.id} is armed: its motors may turn while somebody watches the gimbal.",
                remedy="Disarm first, or send it with while_armed if that is meant.",
            )
        angles = {"roll": 0.0, "pitch": 0.0, "yaw": 0.0, axis: angle_deg}
        if axis == "roll":
            check_range("angle_deg", angle_deg, -MAX_ROLL_DEG, MAX_ROLL_DEG)
        roll_deg = angles["roll"] if axis == "roll" else None
        return await self.set_angles(angles["pitch"], angles["yaw"], roll_deg=roll_deg)

    def point(self, pitch_rad: float, yaw_ned_rad: float) -> None:
        """Points the camera without waiting, for targets that are sent many times a second.

        The message GIMBAL_MANAGER_SET_ATTITUDE is not acknowledged, and is ignored without control. Pitch is
        limited to the gimbal's range.
        """
        vehicle = self._vehicle
        gimbal = self.reading()
        if gimbal is not None:
            low_rad, high_rad = gimbal.pitch_min_rad, gimbal.pitch_max_rad
            if low_rad is not None and high_rad is not None:
                pitch_rad = min(max(pitch_rad, low_rad), high_rad)
        self._record_lock(True)
        vehicle.send(self._attitude_message(q_from_euler(0.0, pitch_rad, yaw_ned_rad), yaw_lock=True))
        self._rois.pop(self._gimbal_address(), None)

    async def _point_pitch_yaw(self, pitch_deg: float, yaw_deg: float, yaw_lock: bool) -> None:
        flags = YAW_LOCK if yaw_lock else 0
        await self._run_until_acknowledged(
            Request(
                d.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
                (pitch_deg, yaw_deg, NAN, NAN, float(flags), 0, self._device()),
            ),
            "point the gimbal",
        )

    async def set_rates(
        self, pitch_rate_deg_s: float, yaw_rate_deg_s: float, *, yaw_lock: bool | None = None
    ) -> None:
        """Turns the camera at constant rates; zero stops both axes. `yaw_lock` None keeps the current
        setting."""
        check_range("pitch_rate_deg_s", pitch_rate_deg_s, -MAX_RATE_DEG_S, MAX_RATE_DEG_S)
        check_range("yaw_rate_deg_s", yaw_rate_deg_s, -MAX_RATE_DEG_S, MAX_RATE_DEG_S)
        self._vehicle.require("gimbal")
        await self._require_control()
        if yaw_lock is None:
            yaw_lock = self._current_lock()
        self._record_lock(yaw_lock)
        flags = float(YAW_LOCK if yaw_lock else 0)
        await self._run_until_acknowledged(
            Request(
                d.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
                (NAN, NAN, pitch_rate_deg_s, yaw_rate_deg_s, flags, 0, self._device()),
            ),
            "turn the gimbal",
        )
        self._rois.pop(self._gimbal_address(), None)

    def _record_lock(self, yaw_lock: bool) -> None:
        self._commanded_lock = (yaw_lock, self._vehicle.clock.monotonic_s())

    def _current_lock(self) -> bool:
        """The gimbal's yaw lock: the reported one, unless this server has commanded another one since. A
        change of the lock would turn the camera by the vehicle's heading."""
        gimbal, commanded = self.reading(), self._commanded_lock
        if commanded is not None:
            is_new = self._vehicle.clock.monotonic_s() - commanded[1] < LOCK_REPORTED_AFTER_S
            if gimbal is None or is_new:
                return commanded[0]
        return gimbal is not None and gimbal.yaw_lock

    async def set_roi(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Keeps the camera pointed at a location; does not require control."""
        check_range("lat_deg", lat_deg, -90.0, 90.0)
        check_range("lon_deg", lon_deg, -180.0, 180.0)
        check_range("alt_amsl_m", alt_amsl_m, -500.0, 10_000.0)
        self._vehicle.require("gimbal")
        request = Request(
            d.MAV_CMD_DO_SET_ROI_LOCATION,
            (self._device(), 0, 0, 0, lat_deg, lon_deg, alt_amsl_m),
            frame=d.MAV_FRAME_GLOBAL,
        )
        await self._run_until_acknowledged(request, "point at the location")
        self._rois[self._gimbal_address()] = Roi(lat_deg, lon_deg, alt_amsl_m)

    async def clear_roi(self) -> None:
        """Stops pointing at a location."""
        self._vehicle.require("gimbal")
        await self._run_until_acknowledged(
            Request(d.MAV_CMD_DO_SET_ROI_NONE, (self._device(), 0, 0, 0, 0, 0, 0)),
            "stop pointing at the location",
        )
        self._rois.pop(self._gimbal_address(), None)

    # --- which gimbal ---------------------------------------------------------------------------

    def reading(self) -> GimbalReading | None:
        """The gimbal's newest report; None before the first report."""
        sample = self._vehicle.topic("gimbal")
        first = sample.value if sample is not None else None
        if not isinstance(first, Gimbal) or self._address is None:
            return first if isinstance(first, Gimbal) else None
        own_address = (self._address.component_id, self._address.device_id)
        readings = (first, *first.gimbals)
        return next((g for g in readings if (g.component_id, g.gimbal_device_id) == own_address), None)

    def _target(self) -> tuple[int, float]:
        """The manager's component, and the device id for its commands; 0 (all devices) with only one
        gimbal."""
        address = self._gimbal_address()
        if address is None:
            return self._vehicle.identity.component_id, 0.0
        has_several = len(self._vehicle.gimbals.addresses()) > 1
        return address.component_id, float(address.device_id if has_several else 0)

    def _gimbal_address(self) -> GimbalAddress | None:
        """The gimbal's address; None while no gimbal is connected."""
        return self._address or next(iter(self._vehicle.gimbals.addresses()), None)

    def _device(self) -> float:
        return self._target()[1]

    def _status(self) -> tuple[bytes, float] | None:
        """GIMBAL_MANAGER_STATUS and its time of reception [s, monotonic]."""
        component_id, device = self._target()
        return self._vehicle.newest_payload(STATUS_ID, component_id, int(device) or None)

    def _attitude_message(self, q: tuple[float, float, float, float], *, yaw_lock: bool) -> MAVLink_message:
        component_id, device = self._target()
        flags = YAW_LOCK if yaw_lock else 0
        return d.MAVLink_gimbal_manager_set_attitude_message(
            self._vehicle.identity.system_id, component_id, flags, int(device), list(q), NAN, NAN, NAN
        )

    # --- internal -------------------------------------------------------------------------------

    async def _run_until_acknowledged(self, request: Request, action: str) -> None:
        """Runs a request until the vehicle acknowledges it; does not wait for the gimbal, which moves
        slowly."""
        goal = Goal(action, lambda _f, _s: False, DEADLINE_S, requested_ids=(), ack_is_enough=True)
        await self._run_transaction(self._transaction(request, goal), action)

    def _transaction(self, request: Request | None, goal: Goal) -> Transaction:
        return Transaction(self._vehicle, request, goal, component_id=self._target()[0])

    async def _configure(
        self, system: float, component: float, action: str, accepts: Callable[[tuple[int, int] | None], bool]
    ) -> None:
        def reached(_flight_state: object, since_s: float) -> bool:
            newest = self._status()
            return newest is not None and newest[1] > since_s and accepts(control_of(newest[0]))

        goal = Goal(action, reached, DEADLINE_S, requested_ids=(STATUS_ID,), listen=(STATUS_ID,))
        request = Request(
            d.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, (system, component, KEEP, KEEP, 0, 0, self._device())
        )
        if system == RELEASE:
            request = Request(request.command, (RELEASE, RELEASE, RELEASE, RELEASE, 0, 0, self._device()))
        await self._run_transaction(self._transaction(request, goal), action)

    async def _run_transaction(self, transaction: Transaction, action: str) -> None:
        try:
            await transaction.run()
        except NoReply as error:
            raise NoReply(
                f"Vehicle {self._vehicle.id} did not answer the request to {action} within "
                f"{error.deadline_s:g} s.",
                deadline_s=error.deadline_s,
                remedy="The vehicle may have no gimbal, or no input for it; GET …/gimbal/setup says what is "
                "missing.",
            ) from None

    async def _request_controller(self) -> tuple[int, int] | None:
        """Requests the gimbal's controller (system id, component id); None: not controlled.

        Raises:
            NoReply: no gimbal manager answers.
        """
        reported: list[tuple[int, int] | None] = []

        def reached(_flight_state: object, since_s: float) -> bool:
            newest = self._status()
            if newest is None or newest[1] <= since_s:
                return False
            reported.append(control_of(newest[0]))
            return True

        action = "report who controls the gimbal"
        goal = Goal(action, reached, DEADLINE_S, requested_ids=(STATUS_ID,), listen=(STATUS_ID,))
        try:
            await self._run_transaction(self._transaction(None, goal), action)
        except Rejected as error:  # the vehicle is connected, but has no gimbal
            raise NoReply(
                f"Vehicle {self._vehicle.id} reports no gimbal.",
                deadline_s=DEADLINE_S,
                remedy="GET …/gimbal/setup says what is missing.",
            ) from error
        return reported[-1]

    async def _require_control(self) -> None:
        control = await self._request_controller()
        if control == self._vehicle.own_ids:
            return
        if control is None:
            raise Refused("The gimbal is not controlled.", remedy="Take control of the gimbal first.")
        raise Refused(
            f"The gimbal is controlled by system {control[0]}, component {control[1]}, not by this server.",
            remedy="Ask that station, or take control; the other station then loses control.",
        )

    def _check_limits(self, pitch_deg: float, yaw_deg: float, yaw_lock: bool) -> None:
        gimbal = self.reading()
        if gimbal is None:
            return
        if gimbal.pitch_min_rad is not None and gimbal.pitch_max_rad is not None:
            check_range(
                "pitch_deg", pitch_deg, math.degrees(gimbal.pitch_min_rad), math.degrees(gimbal.pitch_max_rad)
            )
        if not yaw_lock and gimbal.yaw_min_rad is not None and gimbal.yaw_max_rad is not None:
            check_range(
                "yaw_deg", yaw_deg, math.degrees(gimbal.yaw_min_rad), math.degrees(gimbal.yaw_max_rad)
            )

    async def _point_with_roll(
        self, roll_deg: float, pitch_deg: float, yaw_deg: float, yaw_lock: bool
    ) -> None:
        """Points the camera with roll, which needs GIMBAL_MANAGER_SET_ATTITUDE. This message is not
        acknowledged, so it is repeated until the reported attitude is at the target or has moved towards the
        target."""
        vehicle = self._vehicle
        q = q_from_euler(math.radians(roll_deg), math.radians(pitch_deg), math.radians(yaw_deg))
        message = self._attitude_message(q, yaw_lock=yaw_lock)
        start_s = vehicle.clock.monotonic_s()
        first_error_rad: float | None = None
        with vehicle.mailbox.expect(ATTITUDE_ID, matches=self._is_attitude_of_gimbal) as waiter:
            while (left_s := start_s + DEADLINE_S - vehicle.clock.monotonic_s()) > 0:
                vehicle.send(message)
                vehicle.send(self._attitude_request())
                try:
                    async with asyncio.timeout(min(RESEND_S, left_s)):
                        error_rad = _angle_between(q, await waiter.next())
                except TimeoutError:
                    continue
                first_error_rad = error_rad if first_error_rad is None else first_error_rad
                if error_rad < ATTITUDE_TOLERANCE_RAD or error_rad < first_error_rad - ATTITUDE_TOLERANCE_RAD:
                    return
        if first_error_rad is None:
            raise NoReply(
                f"Vehicle {vehicle.id} does not report its gimbal's attitude.",
                deadline_s=DEADLINE_S,
                remedy="Without roll the request is acknowledged and needs no attitude report.",
            )
        raise Rejected(f"The gimbal of vehicle {vehicle.id} does not move to this attitude.")

    def _is_attitude_of_gimbal(self, message: Reply) -> bool:
        address = self._gimbal_address()
        return address is None or is_attitude_of(
            address, message.get_srcComponent(), message.gimbal_device_id
        )

    def _attitude_request(self) -> MAVLink_message:
        request = Request(d.MAV_CMD_REQUEST_MESSAGE, (float(ATTITUDE_ID), 0, 0, 0, 0, 0, 0))
        return request.message(self._vehicle.identity.system_id, self._target()[0], 0, False)


def _angle_between(q: tuple[float, float, float, float], message: Reply) -> float:
    """Angle between an attitude and the reported attitude [rad]; half a turn without a valid report."""
    reported = rotation(message.q)
    if reported is None:
        return math.pi
    dot = abs(sum(a * b for a, b in zip(q, reported, strict=True)))
    return 2 * math.acos(min(1.0, dot))
