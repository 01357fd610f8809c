"""Dry runs: the computing time of one flight and of a hundred, and the prediction compared with real-time
flights of the same plan."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from statistics import median
from typing import Any

import numpy as np

from gcs_server.client import Gcs
from missions import documents
from missions.dry_run.monte_carlo import monte_carlo
from missions.dry_run.plans import Flyable, FlyableMission, FlyablePlan
from missions.dry_run.result import dry_run
from missions.dry_run.setup import Aircraft, Conditions
from missions.dry_run.track import Track
from missions.geodesy import LocalOrigin
from missions.plan import Plan
from missions.values import HomePosition
from tests.station import FIRST_TEST_INSTANCE, free_port, running_server, running_vehicles

from .simulator import flying_share

HOME = {"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_amsl_m": 488.0}
WIND_NED_M_S, GUSTS_M_S = (0.0, 4.0, 0.0), 0.5
VEHICLE_COUNT = 5
"""Number of vehicles that fly the plan after its dry run, each with different noise."""
VEHICLE_IDS = tuple(str(FIRST_TEST_INSTANCE + 1 + number) for number in range(VEHICLE_COUNT))
CORNERS_NE_M = ((100.0, 0.0), (100.0, 100.0), (0.0, 100.0), (0.0, 20.0))
HEIGHT_M = 15.0
TIMED_FLIGHTS = 100
PREDICTED_FLIGHTS = 10
ACCEPTED_ERRORS = ("separation",)
"""Errors of the plan check that the start accepts: all vehicles fly the same path; they cannot collide."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Flights compared with their dry run; times from arming to disarming."""

    predicted_s: float
    """The median of `PREDICTED_FLIGHTS` flights: the duration of a landing varies by seconds."""
    least_s: float
    greatest_s: float
    flown_s: tuple[float, ...]
    """Duration of each vehicle's flight."""
    predicted_length_m: float
    flown_lengths_m: tuple[float, ...]
    path_error_mean_m: float
    """Mean of all vehicles."""
    path_error_max_m: float


def plan_document(corners_ne_m: Sequence[tuple[float, float]] = CORNERS_NE_M) -> dict[str, Any]:
    """A waypoint plan through these corners that lands at its start."""
    origin = LocalOrigin(**HOME)

    def item(kind: str, north_m: float, east_m: float, height_m: float) -> dict[str, Any]:
        lat_deg, lon_deg, _ = origin.to_geodetic((north_m, east_m, 0.0))
        altitude = {"value_m": height_m, "reference": "home"}
        return {"kind": kind, "lat_deg": lat_deg, "lon_deg": lon_deg, "altitude": altitude}

    items = [item("takeoff", 0.0, 0.0, HEIGHT_M)]
    items += [item("waypoint", north_m, east_m, HEIGHT_M) for north_m, east_m in corners_ne_m]
    items.append(item("land", 0.0, 0.0, 0.0))
    return {"planned_home": HOME, "items": items}


def mission_document(corners_ne_m: Sequence[tuple[float, float]] = CORNERS_NE_M) -> dict[str, Any]:
    """An offboard mission through the same corners: take-off, a smooth trajectory, landing."""
    points = [{"offset_ned_m": [north_m, east_m, -HEIGHT_M]} for north_m, east_m in corners_ne_m]
    start_point = {"offset_ned_m": [0.0, 0.0, -HEIGHT_M]}
    steps = [
        {"step": "take_off", "height_m": HEIGHT_M},
        {"step": "fly", "points": [*points, start_point], "curve": "smooth", "heading": "along_path"},
        {"step": "land"},
    ]
    return {"format": "offboard-gcs-mission", "name": "Round", "home": HOME, "steps": steps}


def run_times_s(flights: int, plan: dict[str, Any]) -> tuple[float, float, float]:
    """Predicted duration of the flight, and CPU time and elapsed time of its dry run [s].

    Args:
        flights: number of flights of a Monte Carlo run; 0: a single dry run.
        plan: a waypoint plan or an offboard mission.
    """
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        return process.submit(_run_times_s, json.dumps(plan), flights).result()


def _run_times_s(plan_text: str, flights: int) -> tuple[float, float, float]:
    plan, aircraft = documents.read(plan_text), Aircraft(HomePosition(**HOME), endurance_s=900.0)
    flyable: Flyable = (
        FlyablePlan.from_plan(plan, aircraft)
        if isinstance(plan, Plan)
        else FlyableMission.from_mission(plan, aircraft)
    )
    conditions = Conditions(WIND_NED_M_S, GUSTS_M_S)
    began_cpu_s, began_s = time.process_time(), time.perf_counter()
    if flights:
        run = monte_carlo(flyable, aircraft, conditions, flights=flights).nominal
    else:
        run = dry_run(flyable, aircraft, conditions)
    cpu_s, elapsed_s = time.process_time() - began_cpu_s, time.perf_counter() - began_s
    assert run.finished, run.findings
    return run.duration_s, cpu_s, elapsed_s


def compare(plan: dict[str, Any]) -> Comparison:
    """Predicts a flight through the server, then flies it in real time in the same wind.

    Args:
        plan: a waypoint plan or an offboard mission.
    """
    udp_port = free_port()
    wind_option = f"{WIND_NED_M_S[0]},{WIND_NED_M_S[1]},{GUSTS_M_S}"
    options = ["--wind", wind_option, "--home", ",".join(str(value) for value in HOME.values()), "--no-log"]
    with contextlib.ExitStack() as stack:
        url, _ = stack.enter_context(running_server([f"udpin://127.0.0.1:{udp_port}"]))
        for number in range(VEHICLE_COUNT):
            instance = ["--first-instance", str(FIRST_TEST_INSTANCE + number)]
            stack.enter_context(running_vehicles(udp_port, arguments=[*options, *instance]))
        return asyncio.run(_predict_and_fly(url, plan))


async def _predict_and_fly(url: str, plan: dict[str, Any]) -> Comparison:
    async with Gcs(url, client="bench") as gcs:
        first_vehicle = await gcs.wait_for_vehicle(VEHICLE_IDS[0], ready=True)
        await first_vehicle.request("POST", "/params/refresh", {"wait": True})
        conditions = {"wind_ned_m_s": list(WIND_NED_M_S), "gusts_m_s": GUSTS_M_S}
        run = await gcs.dry_runs().run(
            plan, vehicle_id=VEHICLE_IDS[0], flights=PREDICTED_FLIGHTS, settings={"conditions": conditions}
        )
        async with asyncio.TaskGroup() as group:
            flights = [group.create_task(_fly(gcs, vehicle_id, plan)) for vehicle_id in VEHICLE_IDS]
    return _comparison_of(run, [flight.result() for flight in flights])


async def _fly(gcs: Gcs, vehicle_id: str, plan: dict[str, Any]) -> RecordedFlight:
    drone = await gcs.wait_for_vehicle(vehicle_id, ready=True)
    is_mission = "steps" in plan
    if not is_mission:
        await drone.mission.upload(plan)
    flight = RecordedFlight([], [])
    async with asyncio.timeout(600.0), asyncio.TaskGroup() as group:
        group.create_task(_record_flight(gcs, vehicle_id, flight))
        await flight.receiving.wait()
        start = partial(drone.offboard_mission.start, plan) if is_mission else drone.mission.start
        await start(despite=ACCEPTED_ERRORS)
    return flight


@dataclass(slots=True)
class RecordedFlight:
    """Positions that the vehicle reported while it was armed."""

    t_s: list[float]
    """Times of the vehicle's own clock."""
    positions_ned_m: list[list[float]]
    receiving: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when the first position is received."""
    armed_at_s: float = math.nan
    disarmed_at_s: float = math.nan


async def _record_flight(gcs: Gcs, vehicle_id: str, flight: RecordedFlight) -> None:
    """Records the next flight until the vehicle reports that it is disarmed."""
    async for sample in gcs.telemetry(vehicles=[vehicle_id], topics=["local_position"], rate_hz=10.0):
        if sample["type"] == "sample":
            flight.receiving.set()
            flight.t_s.append(sample["vehicle_time_boot_s"])
            flight.positions_ned_m.append(sample["value"]["position_ned_m"])
        elif sample["vehicle"] != vehicle_id:
            continue  # events of all vehicles arrive
        elif sample["text"].startswith("Armed by"):
            flight.armed_at_s = flight.t_s[-1]
        elif sample["text"].startswith("Disarmed by"):
            flight.disarmed_at_s = flight.t_s[-1]
            return


def _comparison_of(run: dict[str, Any], flights: Sequence[RecordedFlight]) -> Comparison:
    """Times are those of the vehicle's own clock; only the parts of the paths in the air are compared."""
    path, duration_s = run["nominal"]["path"], run["monte_carlo"]["duration_s"]
    planned = _track_in_air(np.array(path["t_s"]), np.array(path["position_ned_m"]))
    distances_m: list[np.ndarray] = []
    lengths_m: list[float] = []
    for flight in flights:
        positions_ned_m = np.array(flight.positions_ned_m)
        track = _track_in_air(np.array(flight.t_s), positions_ned_m - positions_ned_m[0])
        distances_m.append(_distance_m(track.position_ned_m, planned.position_ned_m))
        lengths_m.append(track.length_m)
    all_distances_m = np.concatenate(distances_m)
    return Comparison(
        duration_s["p50"], duration_s["least"], duration_s["greatest"],
        tuple(flight.disarmed_at_s - flight.armed_at_s for flight in flights),
        planned.length_m, tuple(lengths_m),
        float(all_distances_m.mean()), float(all_distances_m.max()),
    )  # fmt: skip


def _distance_m(flown_ned_m: np.ndarray, planned_ned_m: np.ndarray) -> np.ndarray:
    """(N,) distance of each flown position from the nearest point of the predicted path [m]."""
    return np.linalg.norm(flown_ned_m[:, None] - planned_ned_m[None], axis=2).min(axis=1)


def _track_in_air(t_s: np.ndarray, positions_ned_m: np.ndarray) -> Track:
    """The part of a flight more than 0.5 m above the ground."""
    in_air = np.flatnonzero(positions_ned_m[:, 2] < -0.5)
    part = slice(int(in_air[0]), int(in_air[-1]) + 1)
    count = part.stop - part.start
    return Track(t_s[part] - t_s[part.start], positions_ned_m[part], np.ones(count), np.full(count, -1), ())


def table() -> Iterator[str]:
    """Rows of Markdown."""
    load = f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    yield f"| dry runs ({load}) | measured | goal |"
    yield "|---|---|---|"
    factor = 1.0 / flying_share(1, "", 20.0)
    yield f"| the simulator alone, one vehicle in flight without links | {factor:.1f} x real time | 20 |"
    for title, flights, plan, goal in SPEED_CASES:
        flight_s, cpu_s, elapsed_s = run_times_s(flights, plan)
        rates = f"{flight_s / cpu_s:.1f} x real time by CPU time, {flight_s / elapsed_s:.1f} by the clock"
        yield f"| {title} of {flight_s:.0f} s, on one core | {rates} | {goal} |"
    for name, plan in (("waypoint plan", plan_document()), ("offboard mission", mission_document())):
        yield from _comparison_rows(name, compare(plan))


def _comparison_rows(name: str, comparison: Comparison) -> Iterator[str]:
    time_error = median(comparison.flown_s) / comparison.predicted_s - 1.0
    length_error = median(comparison.flown_lengths_m) / comparison.predicted_length_m - 1.0
    predicted = (
        f"{comparison.least_s:.1f} to {comparison.greatest_s:.1f} s, median {comparison.predicted_s:.1f} s"
    )
    times = f"predicted {predicted}, flown {_sorted_text(comparison.flown_s)} s"
    yield f"| {name}: time from arming to disarming, {times} | {time_error:+.1%} | 3 % |"
    lengths = (
        f"predicted {comparison.predicted_length_m:.0f} m, flown {_sorted_text(comparison.flown_lengths_m)} m"
    )
    yield f"| {name}: length, {lengths} | {length_error:+.1%} | 3 % |"
    share = comparison.path_error_max_m / comparison.predicted_length_m
    distance = f"mean {comparison.path_error_mean_m:.2f} m, greatest {comparison.path_error_max_m:.2f} m"
    title = f"{name}: distance of flown paths from the prediction"
    yield f"| {title} | {distance} ({share:.1%} of the length) | 3 % |"


def _sorted_text(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.1f}" for value in sorted(values))


SPEED_CASES = (
    ("dry run of a waypoint plan", 0, plan_document(), 20),
    ("dry run of an offboard mission", 0, mission_document(), 20),
    (
        f"Monte Carlo of {TIMED_FLIGHTS} flights of a waypoint plan",
        TIMED_FLIGHTS,
        plan_document(((30.0, 0.0),)),
        5,
    ),
    (
        f"Monte Carlo of {TIMED_FLIGHTS} flights of an offboard mission",
        TIMED_FLIGHTS,
        mission_document(((30.0, 0.0),)),
        5,
    ),
)
"""Title, number of Monte Carlo flights (0: a single dry run), plan, and goal (x real time)."""
