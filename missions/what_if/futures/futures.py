"""Futures of a command: what a vehicle will do with it, in a hundred flights from its present state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from missions.dry_run.clearance import FenceDistance
from missions.dry_run.setup import AnyObstacle
from missions.frames import Vector3
from missions.what_if.futures.commands import ARRIVED_M, GoTo, Land, ModeCommand, StreamedSetpoint
from missions.what_if.futures.corridor import (
    arrivals_s,
    corridor,
    nearest_fence,
    nearest_obstacle,
    nearest_vehicle,
    quantiles,
)
from missions.what_if.futures.document import FLIGHTS, HORIZON_S, Futures, FuturesSpread
from missions.what_if.futures.flight import Flight, simulated_parameters
from missions.what_if.futures.start import Delay, Deviations, OtherVehicle, Start


@dataclass(frozen=True, slots=True)
class Place:
    """What is around the vehicle."""

    home_ned_m: Vector3
    """Position of home in the local frame; fence and obstacles are relative to it."""
    fence: FenceDistance
    obstacles: Sequence[AnyObstacle] = ()
    others: Sequence[OtherVehicle] = ()


def fly_futures(
    start: Start,
    command: ModeCommand | StreamedSetpoint,
    delay: Delay,
    place: Place,
    *,
    text: str,
    target_ned_m: Vector3 | None = None,
    battery_known: bool = False,
    flights: int = FLIGHTS,
    horizon_s: float = HORIZON_S,
    seed: int = 0,
    spread: FuturesSpread | None = None,
    assumed: Sequence[str] = (),
    cancelled: Callable[[], None] | None = None,
) -> Futures:
    """Flies the futures.

    Args:
        start: the vehicle's present state.
        command: what is flown.
        delay: of the command, from the state on.
        place: what is around the vehicle.
        text: the command in words.
        target_ned_m: where a stream leads; a go-to has its own target.
        battery_known: whether the parameters tell how fast the battery drains.
        flights: number of flights.
        horizon_s: how far they reach.
        seed: of deviations, noise and gusts; equal seeds give equal futures.
        spread: how the flights differ.
        assumed: sentences that are passed on.
        cancelled: called often; an exception from it ends the flights.

    Raises:
        PlanError: the vehicle's parameters describe no valid aircraft.
    """
    spread = spread or FuturesSpread()
    store = simulated_parameters(start)
    drag_per_s = store.finite_value("SIH_KDV") / max(store.finite_value("SIH_MASS"), 0.01)
    deviations = Deviations.draw(start, delay, spread, flights, seed, drag_per_s)
    tracks = Flight(start, store, command, deviations, spread.velocity_m_s, seed).fly(horizon_s, cancelled)
    target = command.target_ned_m if isinstance(command, GoTo) else target_ned_m
    arrived = None if target is None else arrivals_s(tracks, target, ARRIVED_M)
    charge_known = start.battery_share is not None and battery_known
    return Futures(
        flights=flights,
        seed=seed,
        horizon_s=horizon_s,
        command=text,
        corridor=corridor(tracks),
        target_ned_m=target,
        arrived=0 if arrived is None else len(arrived),
        arrival_s=None if arrived is None else quantiles(arrived, 1),
        landed=int(tracks.on_ground.sum()),
        touched_ground=0 if isinstance(command, Land) else int(tracks.touched_ground.sum()),
        lost_control=int(tracks.lost_control.sum()),
        battery_start_share=start.battery_share,
        battery_end_share=quantiles(tracks.battery_share, 4) if charge_known else None,
        fence=nearest_fence(tracks, place.fence, place.home_ned_m),
        obstacle=nearest_obstacle(tracks, place.obstacles, place.home_ned_m),
        vehicle=nearest_vehicle(tracks, place.others),
        spread=spread,
        assumed=list(assumed),
    )
