"""A command of a vehicle as the task of its futures: targets in the local frame, and when it arrives."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gcs_server.errors import Refused
from gcs_server.flights.futures_state import start_of, surroundings_of
from gcs_server.flights.futures_task import FuturesTask, Stream
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.values.stream_request import OnExpiry, StreamRequest
from gcs_server.vehicle.vehicle import Vehicle
from missions.geodesy import LocalOrigin
from missions.setpoints import Setpoint
from missions.values import Obstacle
from missions.what_if.futures.commands import GoTo, Hold, Land, ModeCommand, Orbit, OrbitYaw
from missions.what_if.futures.start import Delay, Start

if TYPE_CHECKING:
    from gcs_server.flights.flights import Flights

COMMAND_DELAY = Delay(0.05, 0.5)
"""A command to the vehicle: the link, and PX4's next tick."""
SETPOINT_DELAY = Delay(0.02, 0.15)
"""A setpoint of a running stream."""
START_DELAY = Delay(1.0, 2.0)
"""The start of a stream: PX4 wants setpoints for a second before it switches to Offboard."""
RENEWED = "The setpoint is renewed for the whole time."
SLOW_M_S = 1.0
LATE_DESCENT = "The vehicle still moves: its descent may begin some seconds later than in these flights."
NOT_BRAKED = "Obstacle brake and avoidance, which need the sensors, are not flown."


@dataclass(frozen=True, slots=True)
class Going:
    """A go-to, as its route takes it: exactly one of the two altitudes."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float | None
    alt_home_m: float | None
    yaw_ned_deg: float | None
    speed_m_s: float | None


@dataclass(frozen=True, slots=True)
class Altitude:
    """A change of the altitude: exactly one of the two."""

    alt_amsl_m: float | None
    alt_home_m: float | None


@dataclass(frozen=True, slots=True)
class Circling:
    """An orbit, as its route takes it: exactly one of the two altitudes."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float | None
    alt_home_m: float | None
    radius_m: float
    speed_m_s: float
    clockwise: bool
    yaw: OrbitYaw | None


@dataclass(frozen=True, slots=True)
class StreamAsked:
    """A setpoint of a stream."""

    setpoint: Setpoint


CommandAsked = Going | Altitude | Circling | StreamAsked | Hold | Land


async def futures_task(
    flights: Flights,
    vehicle: Vehicle,
    asked: CommandAsked,
    *,
    obstacles: Sequence[Obstacle],
    horizon_s: float,
    count: int,
    seed: int,
) -> FuturesTask:
    """The task of a command's futures, from what is known now.

    Args:
        flights: all that flies.
        vehicle: the vehicle.
        asked: the command.
        obstacles: known obstacles.
        horizon_s: how far the flights reach.
        count: number of flights.
        seed: their seed.

    Raises:
        Refused, NotVerified, Disconnected: the vehicle does not fly, has no position, or cannot fly this
            now.
        InvalidRequest: it can never fly this.
    """
    assumed: list[str] = []
    start = start_of(vehicle, flights.models, assumed)
    origin, state_unix_s = VehicleEstimates(vehicle).origin(), vehicle.clock.unix_s()
    stream: Stream | None = None
    mode: ModeCommand | None = None
    delay = COMMAND_DELAY
    if isinstance(asked, StreamAsked):
        stream, delay = _stream(flights, vehicle, asked.setpoint, assumed)
        text = f"setpoint {asked.setpoint.type}"
    else:
        mode, text = _mode(vehicle, asked, start, origin)
        if isinstance(asked, Land) and math.hypot(*start.velocity_ned_m_s) > SLOW_M_S:
            assumed.append(LATE_DESCENT)
    surroundings = surroundings_of(flights, vehicle, obstacles, horizon_s, assumed)
    around = await asyncio.to_thread(surroundings)
    return FuturesTask(
        vehicle=vehicle.id,
        start=start,
        origin=origin,
        mode=mode,
        stream=stream,
        delay=delay,
        surroundings=around,
        state_unix_s=state_unix_s,
        text=text,
        battery_known="SIM_BAT_DRAIN" in start.parameters,
        flights=count,
        horizon_s=horizon_s,
        seed=seed,
        assumed=tuple(assumed),
    )


def _stream(
    flights: Flights, vehicle: Vehicle, setpoint: Setpoint, assumed: list[str]
) -> tuple[Stream, Delay]:
    offboard = flights.offboard(vehicle.id)
    status = offboard.status()
    streams = status.streaming
    request = StreamRequest(setpoint, 1.0, OnExpiry("hold", 0.0), "futures", "")
    snapshot = offboard.check(request)
    assumed.append(RENEWED)
    if snapshot.scans or snapshot.avoidance is not None:
        assumed.append(NOT_BRAKED)
    bounds = replace(snapshot.bounds, obstacle_brake=False)
    snapshot = replace(snapshot, scans=(), avoidance=None, mission_avoidance=None, bounds=bounds)
    return Stream(setpoint, snapshot), SETPOINT_DELAY if streams else START_DELAY


def _mode(
    vehicle: Vehicle,
    asked: Going | Altitude | Circling | Hold | Land,
    start: Start,
    origin: LocalOrigin | None,
) -> tuple[ModeCommand, str]:
    if isinstance(asked, Hold):
        return asked, "hold"
    if isinstance(asked, Land):
        return asked, "land"
    alt_amsl_m = _alt_amsl_m(vehicle, asked)
    if origin is None:
        raise Refused(
            f"Vehicle {vehicle.id} has no valid global position: the target cannot be placed.",
            remedy="Wait for GPS and the estimator.",
        )
    if isinstance(asked, Altitude):
        place = vehicle.guided.hold_target()
        down = origin.alt_amsl_m - alt_amsl_m
        north, east = start.position_ned_m[:2] if place is None else origin.to_ned(*place)[:2]
        return GoTo((north, east, down), _yaw(start)), "altitude"
    target = origin.to_ned(asked.lat_deg, asked.lon_deg, alt_amsl_m)
    if isinstance(asked, Circling):
        speed_m_s = asked.speed_m_s if asked.clockwise else -asked.speed_m_s
        return Orbit(target, asked.radius_m, speed_m_s, asked.yaw), "orbit"
    yaw = None if asked.yaw_ned_deg is None else math.radians(asked.yaw_ned_deg)
    return GoTo(target, yaw, asked.speed_m_s), "goto"


def _yaw(start: Start) -> float:
    w, x, y, z = start.q_ned_frd
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _alt_amsl_m(vehicle: Vehicle, asked: Going | Altitude | Circling) -> float:
    if asked.alt_amsl_m is not None:
        return asked.alt_amsl_m
    home = VehicleEstimates(vehicle).home()
    if home is None or asked.alt_home_m is None:
        raise Refused(
            f"Vehicle {vehicle.id} reports no home, to which the altitude refers.",
            remedy="Give alt_amsl_m.",
        )
    return home.alt_amsl_m + asked.alt_home_m
