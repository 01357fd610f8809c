"""Commands in guided flight: go-to, altitude, heading, speed, orbit; and the home position.

PX4 accepts nearly every value of these commands: it limits speeds without a word, and starts an orbit of one
metre after it has refused a radius. So values that it would limit are refused here, with its parameter's
name. Each command succeeds when the vehicle's own state shows the target, except the speed, which no message
shows.

Altitude and heading first switch to Hold: in another mode, the position that PX4 keeps would be that mode's
target. Home is not moved while setpoints are streamed, whose limits and altitudes refer to it, nor during a
return.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Collection
from contextlib import closing, suppress
from typing import Literal, Unpack

import numpy as np

from gcs_server.errors import InvalidRequest, Refused, Rejected
from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.tables import LAYOUTS
from gcs_server.vehicle.decoders import DECODERS
from gcs_server.vehicle.numbers import Unusable
from gcs_server.vehicle.px4.modes import BY_NAME
from gcs_server.vehicle.reducers import FlightState
from gcs_server.vehicle.samples import Home, Orbit
from gcs_server.vehicle.services import checks
from gcs_server.vehicle.services.command import (
    STATE_DEADLINE_S,
    CommandOptions,
    CommandService,
    in_mode,
)
from gcs_server.vehicle.services.fence_checks import FenceChecks, LatLon
from gcs_server.vehicle.services.mission import MissionService
from gcs_server.vehicle.services.port import VehiclePort
from gcs_server.vehicle.services.transaction import Goal, Request, Transaction
from gcs_server.vehicle.tickets import Ticket
from missions.geodesy import LocalOrigin, distance_m

MAX_DISTANCE_M = 1000.0
"""Default limit of the distance of a target [m]."""
SAME_POSITION_M = 3.0
"""A reported target this near is the requested one [m]."""
SAME_ALTITUDE_M = 0.1
SAME_HOME_ALTITUDE_M = 5.0
"""A reported home altitude this near is the requested one [m]: PX4 v1.17 corrects it in flight."""
SAME_RADIUS_M = 0.1
SAME_YAW_RAD = math.radians(4.0)
TURN_DEADLINE_S = 45.0
"""Sufficient for a half turn at the slowest MPC_YAWRAUTO_MAX [s]."""
SPEED_MAX_PARAMETER, ORBIT_RADIUS_MAX_PARAMETER = "MPC_XY_VEL_MAX", "MC_ORBIT_RAD_MAX"
HOME_ENABLED_PARAMETER = "COM_HOME_EN"
ORBIT_RADIUS_MIN_M, ORBIT_RADIUS_MAX_M = 1.0, 1000.0
"""PX4's smallest radius of an orbit, and its default for the largest [m]."""
ORBIT_ACCELERATION_M_S2 = 2.0
"""PX4 reduces the speed of an orbit above this centripetal acceleration, and keeps the radius."""
MIN_SPEED_M_S = 0.1
GROUND_SPEED = 1.0
"""param1 of DO_CHANGE_SPEED."""
REPOSITION_CHANGES_MODE = 1.0
NAN = math.nan
CIRCLE_POINTS = 72
"""Positions of a circle that are compared with the ground and the geofence. The chords between them are
within 0.1 % of the radius of it."""

OrbitYaw = Literal["center", "initial", "uncontrolled", "tangent"]
ORBIT_YAW: dict[OrbitYaw, float] = {"center": 0.0, "initial": 1.0, "uncontrolled": 2.0, "tangent": 3.0}
"""ORBIT_YAW_BEHAVIOUR: the nose points to the centre, keeps its heading, is free, or points along the circle.
The behaviour that follows the sticks of an RC transmitter is left out."""
HOME_MODES = ("rtl", "mission")
"""Modes whose target or altitudes would move with home."""
SPEED_MODES = ("hold", "mission")
"""Modes whose speed DO_CHANGE_SPEED changes; an orbit has its own."""

_target = LAYOUTS[d.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT]


def orbit_speed_max_m_s(radius_m: float) -> float:
    """The highest speed at which PX4 flies an orbit of this radius [m/s]."""
    return math.sqrt(ORBIT_ACCELERATION_M_S2 * radius_m)


class Guided:
    """The commands of one vehicle. Every method may raise the errors of `CommandService`.

    Args:
        vehicle: the vehicle.
        command: its other commands, with the ticket and the dialogue of a command.
        known_parameter: the newest known value of a parameter; None: unknown.
        read_parameter: reads a parameter from the vehicle; None: no answer.
        home_in_use: why home must not move now, as a sentence; None: it may.
        home_was_set: called when the vehicle reports the home that was set.
        mission: the vehicle's plan, with its geofence.
    """

    def __init__(
        self,
        vehicle: VehiclePort,
        command: CommandService,
        known_parameter: Callable[[str], float | None],
        read_parameter: Callable[[str], Awaitable[float | None]],
        home_in_use: Callable[[], str | None],
        home_was_set: Callable[[], None],
        mission: Callable[[], MissionService],
    ) -> None:
        self._vehicle = vehicle
        self._command = command
        self._known_parameter = known_parameter
        self._read_parameter = read_parameter
        self._home_in_use = home_in_use
        self._home_was_set = home_was_set
        self._fence = FenceChecks(vehicle, mission, self._limit)

    async def goto(
        self,
        lat_deg: float,
        lon_deg: float,
        *,
        alt_amsl_m: float | None = None,
        alt_home_m: float | None = None,
        yaw_ned_deg: float | None = None,
        speed_m_s: float | None = None,
        max_distance_m: float = MAX_DISTANCE_M,
        despite: Collection[str] = (),
        **options: Unpack[CommandOptions],
    ) -> None:
        """Flies to a position in Hold mode, at exactly one of the two altitudes. Returns once the vehicle has
        the target, before it arrives. Without `speed_m_s` PX4 keeps the speed of an earlier command in the
        same stay in Hold, and otherwise flies at MPC_XY_CRUISE. `despite` accepts findings about the
        vehicle's geofence by their codes (`FenceChecks`), here and in the other commands."""
        checks.check_range("lat_deg", lat_deg, -90.0, 90.0)
        checks.check_range("lon_deg", lon_deg, -180.0, 180.0)
        checks.check_range("max_distance_m", max_distance_m, 1.0, 100_000.0)
        yaw_rad = NAN if yaw_ned_deg is None else _radians("yaw_ned_deg", yaw_ned_deg)
        _check_altitudes(alt_amsl_m, alt_home_m)
        vehicle = self._vehicle
        self._require_flying()
        with self._command.begin("go to", options, BY_NAME["hold"]) as ticket:
            if speed_m_s is not None:
                await self._check_speed(speed_m_s)
            target_amsl_m = await self._altitude_amsl_m(ticket, alt_amsl_m, alt_home_m)
            await self._fence.require_inside(self._place(), [(lat_deg, lon_deg)], target_amsl_m, despite)
            checks.require_near(vehicle, lat_deg, lon_deg, target_amsl_m, max_distance_m)
            checks.require_above_ground(vehicle, self._command.floor.now(), lat_deg, lon_deg, target_amsl_m)
            speed = -1.0 if speed_m_s is None else speed_m_s
            request = Request(
                d.MAV_CMD_DO_REPOSITION,
                (speed, REPOSITION_CHANGES_MODE, 0.0, yaw_rad, lat_deg, lon_deg, target_amsl_m),
                frame=d.MAV_FRAME_GLOBAL,
            )
            goal = self._target_goal("go there", (lat_deg, lon_deg), target_amsl_m)
            await self._command.run(ticket, request, goal, options)

    async def change_altitude(
        self,
        *,
        alt_amsl_m: float | None = None,
        alt_home_m: float | None = None,
        max_distance_m: float = MAX_DISTANCE_M,
        despite: Collection[str] = (),
        **options: Unpack[CommandOptions],
    ) -> None:
        """Climbs or descends in Hold to exactly one of the two altitudes; a go-to continues at the new one.
        Returns once the vehicle has the target, before it arrives."""
        _check_altitudes(alt_amsl_m, alt_home_m)
        vehicle = self._vehicle
        self._require_flying()
        with self._command.begin("change altitude", options, BY_NAME["hold"]) as ticket:
            target_amsl_m = await self._altitude_amsl_m(ticket, alt_amsl_m, alt_home_m)
            await self._fence.require_inside(self._place(), [self._place()], target_amsl_m, despite)
            position = checks.position_of(vehicle)
            place = self.hold_target() or (position.lat_deg, position.lon_deg, position.alt_amsl_m)
            for lat_lon_deg in {place[:2], (position.lat_deg, position.lon_deg)}:
                checks.require_near(vehicle, *lat_lon_deg, target_amsl_m, max_distance_m)
                checks.require_above_ground(vehicle, self._command.floor.now(), *lat_lon_deg, target_amsl_m)
            await self._enter_hold(ticket, options)
            request = _reposition(NAN, target_amsl_m)
            goal = self._target_goal("change its altitude", None, target_amsl_m)
            await self._command.run(ticket, request, goal, options)

    async def change_heading(self, yaw_ned_deg: float, **options: Unpack[CommandOptions]) -> None:
        """Turns to a heading clockwise from north [deg] in Hold; returns once the vehicle has turned."""
        yaw_rad = _radians("yaw_ned_deg", yaw_ned_deg)
        self._require_flying()
        with self._command.begin("change heading", options, BY_NAME["hold"]) as ticket:
            checks.position_of(self._vehicle)
            await self._enter_hold(ticket, options)
            # PX4 takes the current altitude as the target unless the command has one.
            target = self.hold_target()
            request = _reposition(yaw_rad, NAN if target is None else target[2])
            accepted = Goal("turn", _never, STATE_DEADLINE_S, requested_ids=(), ack_is_enough=True)
            await self._command.run(ticket, request, accepted, options)
            if (progress := options.get("progress")) is not None:
                progress(f"Turning to {yaw_ned_deg % 360.0:.0f}°", None)
            turned = Goal(
                f"turn to {yaw_ned_deg % 360.0:.0f}°",
                self._is_heading(yaw_rad),
                TURN_DEADLINE_S,
                requested_ids=(d.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,),
                listen=(d.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,),
            )
            await self._command.run(ticket, None, turned, options)

    async def change_speed(self, speed_m_s: float, **options: Unpack[CommandOptions]) -> None:
        """Changes the ground speed of Hold (go-to) or of the mission, until the next mode change. Returns
        once the vehicle has acknowledged it, which is all that it reports."""
        self._require_flying()
        mode = self._vehicle.status.mode
        if mode not in SPEED_MODES:
            raise Refused(
                f"Vehicle {self._vehicle.id} is in {self._vehicle.status.mode_label}: the ground speed can "
                "be changed in Hold and Mission only.",
                remedy="Command an orbit again with another speed; otherwise select Hold first.",
            )
        with self._command.begin("change speed", options) as ticket:
            await self._check_speed(speed_m_s)
            request = Request(d.MAV_CMD_DO_CHANGE_SPEED, (GROUND_SPEED, speed_m_s, -1.0, 0, 0, 0, 0))
            goal = Goal("change its speed", _never, STATE_DEADLINE_S, requested_ids=(), ack_is_enough=True)
            await self._command.run(ticket, request, goal, options)

    async def orbit(
        self,
        lat_deg: float,
        lon_deg: float,
        *,
        radius_m: float,
        speed_m_s: float,
        alt_amsl_m: float | None = None,
        alt_home_m: float | None = None,
        clockwise: bool = True,
        yaw: OrbitYaw | None = None,
        max_distance_m: float = MAX_DISTANCE_M,
        despite: Collection[str] = (),
        **options: Unpack[CommandOptions],
    ) -> None:
        """Circles around a point, at exactly one of the two altitudes, until another command. Returns once
        the vehicle reports this circle, before it has reached it.

        Args:
            lat_deg: latitude of the centre.
            lon_deg: longitude of the centre.
            radius_m: radius; at least 1 m, at most MC_ORBIT_RAD_MAX.
            speed_m_s: speed along the circle; at most `orbit_speed_max_m_s` and MPC_XY_VEL_MAX.
            alt_amsl_m: altitude of the circle above mean sea level.
            alt_home_m: altitude of the circle above home.
            clockwise: direction, seen from above.
            yaw: where the nose points; None: as MC_ORBIT_YAW_MOD says.
            max_distance_m: refuse a centre that is farther away.
            despite: codes of findings about the geofence that are accepted.
            options: see `CommandOptions`.
        """
        checks.check_range("lat_deg", lat_deg, -90.0, 90.0)
        checks.check_range("lon_deg", lon_deg, -180.0, 180.0)
        checks.check_range("max_distance_m", max_distance_m, 1.0, 100_000.0)
        _check_altitudes(alt_amsl_m, alt_home_m)
        self._require_flying()
        with self._command.begin("orbit", options, BY_NAME["orbit"]) as ticket:
            await self._check_orbit(radius_m, speed_m_s)
            target_amsl_m = await self._altitude_amsl_m(ticket, alt_amsl_m, alt_home_m)
            circle = _circle(self._place(), (lat_deg, lon_deg), radius_m)
            await self._fence.require_inside(self._place(), circle, target_amsl_m, despite)
            checks.require_near(self._vehicle, lat_deg, lon_deg, target_amsl_m, max_distance_m)
            self._require_circle_above_ground(circle, target_amsl_m)
            signed_radius_m = radius_m if clockwise else -radius_m
            behaviour = NAN if yaw is None else ORBIT_YAW[yaw]
            request = Request(
                d.MAV_CMD_DO_ORBIT,
                (signed_radius_m, speed_m_s, behaviour, NAN, lat_deg, lon_deg, target_amsl_m),
                frame=d.MAV_FRAME_GLOBAL,
            )
            ids = (d.MAVLINK_MSG_ID_CURRENT_MODE, d.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS)
            goal = Goal(
                "orbit",
                self._is_orbiting((lat_deg, lon_deg), signed_radius_m),
                STATE_DEADLINE_S,
                requested_ids=ids,
                listen=(d.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS,),
            )
            await self._command.run(ticket, request, goal, options)

    async def set_home(
        self,
        position: tuple[float, float, float | None] | None = None,
        *,
        max_distance_m: float = MAX_DISTANCE_M,
        **options: Unpack[CommandOptions],
    ) -> None:
        """Sets home, to which Return flies and to which altitudes above home refer; returns once the vehicle
        reports it.

        Args:
            position: latitude, longitude [deg], altitude AMSL [m], which by default is that of the known
                ground there, or else of the present home; None: the vehicle's position.
            max_distance_m: refuse a position that is farther from the vehicle.
            options: see `CommandOptions`.
        """
        vehicle = self._vehicle
        vehicle.require_commandable()
        self._command.require_no_kill("set home")
        if (reason := self._why_home_stays()) is not None:
            raise Refused(reason, remedy="Select Hold first, set home, then continue.")
        checks.position_of(vehicle)
        home = None if position is None else self._home_position(position, max_distance_m)
        params = (1.0, 0.0, 0.0, NAN, 0.0, 0.0, 0.0) if home is None else (0.0, 0.0, 0.0, NAN, *home)
        request = Request(d.MAV_CMD_DO_SET_HOME, params, frame=d.MAV_FRAME_GLOBAL)
        accepted = Goal("set home", _never, STATE_DEADLINE_S, requested_ids=(), ack_is_enough=True)
        ids = (d.MAVLINK_MSG_ID_HOME_POSITION,)
        reported = Goal(
            "report the new home", self._is_home(home), STATE_DEADLINE_S, requested_ids=ids, listen=ids
        )
        # Home moves nothing, so it interrupts no other command; but a frame that is sent again must not move
        # home during a return that began meanwhile, so its ticket is looked at before each.
        ticket = vehicle.tickets.open("set home", yields=True)
        ticket.add_condition(self._why_home_stays)
        try:
            with closing(ticket):
                await Transaction(vehicle, request, accepted, options.get("progress"), ticket).run()
        except Rejected as error:
            if error.mav_result != d.MAV_RESULT_DENIED:
                raise
            remedy = f"PX4 denies it while {HOME_ENABLED_PARAMETER} is 0: set that parameter to 1."
            raise Rejected(
                str(error), mav_result=error.mav_result, reasons=error.reasons, remedy=remedy
            ) from None
        await Transaction(vehicle, None, reported).run()
        self._home_was_set()

    # --- internal -------------------------------------------------------------------------------

    def _require_flying(self) -> None:
        vehicle = self._vehicle
        vehicle.require_commandable()
        if not vehicle.flight_state.armed or vehicle.flight_state.landed_state == "on_ground":
            raise Refused(f"Vehicle {vehicle.id} is not flying.", remedy="Take off first.")

    def _why_home_stays(self) -> str | None:
        """Why home must not move now, as a sentence; None: it may."""
        status = self._vehicle.status
        if status.armed and status.mode in HOME_MODES:
            return f"Vehicle {self._vehicle.id} is in {status.mode_label}, which refers to its present home."
        return self._home_in_use()

    def _home_position(
        self, position: tuple[float, float, float | None], max_distance_m: float
    ) -> tuple[float, float, float]:
        """The checked position for home, with its altitude."""
        lat_deg, lon_deg, alt_amsl_m = position
        checks.check_range("lat_deg", lat_deg, -90.0, 90.0)
        checks.check_range("lon_deg", lon_deg, -180.0, 180.0)
        if alt_amsl_m is None:
            floor = self._command.floor.now()
            lowest_amsl_m = floor.lowest_amsl_m(lat_deg, lon_deg)
            if lowest_amsl_m is None:
                raise InvalidRequest(
                    "alt_amsl_m",
                    "Give alt_amsl_m: neither the ground there nor the present home is known.",
                )
            alt_amsl_m = lowest_amsl_m + floor.landing_height_m
        checks.check_range("alt_amsl_m", alt_amsl_m, -500.0, 10_000.0)
        checks.require_near(self._vehicle, lat_deg, lon_deg, alt_amsl_m, max_distance_m)
        return lat_deg, lon_deg, alt_amsl_m

    async def _altitude_amsl_m(
        self, ticket: Ticket, alt_amsl_m: float | None, alt_home_m: float | None
    ) -> float:
        """The one altitude that was given, AMSL [m]."""
        if alt_amsl_m is None:
            assert alt_home_m is not None
            return await self._command.home_alt_amsl_m(ticket) + alt_home_m
        await self._command.request_home(ticket)
        return alt_amsl_m

    async def _enter_hold(self, ticket: Ticket, options: CommandOptions) -> None:
        if self._vehicle.status.mode != "hold":
            await self._command.enter_mode(ticket, BY_NAME["hold"], options)

    async def _limit(self, name: str) -> float | None:
        known = self._known_parameter(name)
        return known if known is not None else await self._read_parameter(name)

    async def _check_speed(self, speed_m_s: float) -> None:
        """Raises InvalidRequest for a speed that PX4 would limit."""
        checks.check_range("speed_m_s", speed_m_s, MIN_SPEED_M_S, 100.0)
        highest_m_s = await self._limit(SPEED_MAX_PARAMETER)
        if highest_m_s is not None and speed_m_s > highest_m_s:
            raise InvalidRequest(
                "speed_m_s",
                f"Vehicle {self._vehicle.id} flies at most {highest_m_s:g} m/s ({SPEED_MAX_PARAMETER}), "
                f"not {speed_m_s:g} m/s.",
                remedy=f"Use at most {highest_m_s:g} m/s, or raise {SPEED_MAX_PARAMETER}.",
            )

    async def _check_orbit(self, radius_m: float, speed_m_s: float) -> None:
        """Raises InvalidRequest for a radius that PX4 refuses, or a speed that it would limit."""
        largest_m = await self._limit(ORBIT_RADIUS_MAX_PARAMETER)
        largest_m = ORBIT_RADIUS_MAX_M if largest_m is None else largest_m
        if not ORBIT_RADIUS_MIN_M <= radius_m <= largest_m:
            raise InvalidRequest(
                "radius_m",
                f"radius_m must be from {ORBIT_RADIUS_MIN_M:g} to {largest_m:g} "
                f"({ORBIT_RADIUS_MAX_PARAMETER}), not {radius_m:g}.",
            )
        await self._check_speed(speed_m_s)
        highest_m_s = orbit_speed_max_m_s(radius_m)
        if speed_m_s > highest_m_s:
            raise InvalidRequest(
                "speed_m_s",
                f"PX4 flies an orbit of {radius_m:g} m at no more than {highest_m_s:.1f} m/s, which is a "
                f"centripetal acceleration of {ORBIT_ACCELERATION_M_S2:g} m/s².",
                remedy=f"Use at most {math.floor(highest_m_s * 10) / 10:g} m/s, or a radius of at least "
                f"{math.ceil(speed_m_s**2 / ORBIT_ACCELERATION_M_S2):g} m.",
            )

    def _place(self) -> LatLon:
        """The vehicle's present position. Raises Refused if it reports none."""
        position = checks.position_of(self._vehicle)
        return (position.lat_deg, position.lon_deg)

    def _require_circle_above_ground(self, circle: list[LatLon], alt_amsl_m: float) -> None:
        lat_deg, lon_deg = np.array(circle).T
        too_low = self._command.floor.now().too_low(lat_deg, lon_deg, np.full(len(circle), alt_amsl_m))
        if too_low is not None:
            raise Refused(f"A part of the circle is {too_low.text}.", remedy=too_low.remedy)

    def _newest(self, msg_id: int, since_s: float) -> bytes | None:
        """The newest payload of a message, if it arrived after `since_s`."""
        newest = self._vehicle.newest_payload(msg_id)
        return None if newest is None or newest[1] <= since_s else newest[0]

    def hold_target(self) -> tuple[float, float, float] | None:
        """The target at which the vehicle holds or to which it flies in Hold: latitude, longitude [deg],
        altitude AMSL [m]; None: it is in another mode, or has not reported one lately."""
        now_s = self._vehicle.clock.monotonic_s()
        payload = self._newest(d.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT, now_s - checks.MAX_POSITION_AGE_S)
        if payload is None or self._vehicle.status.mode != "hold":
            return None
        _, lat, lon, alt_m, *_ = _target.unpacker.unpack(payload)
        return (lat / 1e7, lon / 1e7, alt_m) if math.isfinite(alt_m) else None

    def _target_goal(self, action: str, place_deg: tuple[float, float] | None, alt_amsl_m: float) -> Goal:
        """The goal that the vehicle, in Hold, reports a target of this altitude and place (None: any)."""
        in_hold = in_mode(BY_NAME["hold"])

        def reached(flight_state: FlightState, since_s: float) -> bool:
            if not in_hold(flight_state, since_s):
                return False
            payload = self._newest(d.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT, since_s)
            if payload is None:
                return False
            _, lat, lon, alt_m, *_ = _target.unpacker.unpack(payload)
            away_m = 0.0 if place_deg is None else distance_m(lat / 1e7, lon / 1e7, *place_deg)
            nearest_m = SAME_POSITION_M if place_deg is not None else SAME_ALTITUDE_M
            return away_m < SAME_POSITION_M and abs(alt_m - alt_amsl_m) < nearest_m

        return Goal(
            action,
            reached,
            STATE_DEADLINE_S,
            requested_ids=(d.MAVLINK_MSG_ID_CURRENT_MODE, d.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT),
            listen=(d.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,),
        )

    def _is_heading(self, yaw_rad: float) -> Callable[[FlightState, float], bool]:
        def reached(_flight_state: FlightState, since_s: float) -> bool:
            payload = self._newest(d.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT, since_s)
            if payload is None:
                return False
            fields = dict(zip(_target.fields, _target.unpacker.unpack(payload), strict=True))
            return abs(math.remainder(fields["yaw"] - yaw_rad, 2.0 * math.pi)) < SAME_YAW_RAD

        return reached

    def _is_orbiting(
        self, centre_deg: tuple[float, float], signed_radius_m: float
    ) -> Callable[[FlightState, float], bool]:
        in_orbit = in_mode(BY_NAME["orbit"])

        def reached(flight_state: FlightState, since_s: float) -> bool:
            circle = self._sample("orbit", since_s)
            if not isinstance(circle, Orbit) or not in_orbit(flight_state, since_s):
                return False
            is_there = distance_m(circle.lat_deg, circle.lon_deg, *centre_deg) < SAME_POSITION_M
            reported_m = circle.radius_m if circle.clockwise else -circle.radius_m
            return is_there and abs(reported_m - signed_radius_m) < SAME_RADIUS_M

        return reached

    def _is_home(self, position: tuple[float, float, float] | None) -> Callable[[FlightState, float], bool]:
        """Whether the vehicle has reported this home; None: any."""

        def reached(_flight_state: FlightState, since_s: float) -> bool:
            home = self._sample("home", since_s)
            if not isinstance(home, Home) or position is None:
                return home is not None
            is_there = distance_m(home.lat_deg, home.lon_deg, *position[:2]) < SAME_POSITION_M
            return is_there and abs(home.alt_amsl_m - position[2]) < SAME_HOME_ALTITUDE_M

        return reached

    def _sample(self, topic: str, since_s: float) -> object | None:
        """What the newest message of a topic says, if it arrived after `since_s`; as the vehicle sent it."""
        (msg_id, *_), decode = DECODERS[topic]
        payload = self._newest(msg_id, since_s)
        if payload is not None:
            with suppress(Unusable):
                decoded = decode({msg_id: payload})
                return None if decoded is None else decoded[0]
        return None


def _circle(vehicle: LatLon, centre: LatLon, radius_m: float) -> list[LatLon]:
    """Positions of a circle, beginning at the nearest one to the vehicle."""
    origin = LocalOrigin(*centre, 0.0)
    north_m, east_m, _ = origin.to_ned(*vehicle, 0.0)
    first_rad = math.atan2(east_m, north_m)
    angles = first_rad + np.linspace(0.0, 2.0 * math.pi, CIRCLE_POINTS, endpoint=False)
    offsets = [(radius_m * math.cos(a), radius_m * math.sin(a), 0.0) for a in angles.tolist()]
    return [(lat, lon) for lat, lon, _ in map(origin.to_geodetic, offsets)]


def _reposition(yaw_rad: float, alt_amsl_m: float) -> Request:
    """A DO_REPOSITION at the present target position; as COMMAND_LONG, because a COMMAND_INT cannot leave the
    position out."""
    params = (-1.0, REPOSITION_CHANGES_MODE, 0.0, yaw_rad, NAN, NAN, alt_amsl_m)
    return Request(d.MAV_CMD_DO_REPOSITION, params)


def _radians(field: str, value_deg: float) -> float:
    return math.radians(checks.check_range(field, value_deg, -360.0, 360.0))


def _check_altitudes(alt_amsl_m: float | None, alt_home_m: float | None) -> None:
    if (alt_amsl_m is None) == (alt_home_m is None):
        raise InvalidRequest("alt_amsl_m", "Give exactly one altitude: alt_amsl_m or alt_home_m.")
    if alt_amsl_m is not None:
        checks.check_range("alt_amsl_m", alt_amsl_m, -500.0, 10_000.0)
    if alt_home_m is not None:
        checks.check_range("alt_home_m", alt_home_m, -500.0, 10_000.0)


def _never(_flight_state: FlightState, _since_s: float) -> bool:
    """A condition for commands whose only result is the acknowledgement."""
    return False
