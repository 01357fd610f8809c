"""The result of one dry run: a plan flown once in simulation, with steps and findings."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from missions.dry_run.clearance import FenceDistance, obstacle_distance_m
from missions.dry_run.document import DryRunFinding, FlightResult, FlownPath, StepTime, plain
from missions.dry_run.flight import Flight, ReportProgress, fly
from missions.dry_run.plans import Flyable
from missions.dry_run.setup import LEVEL_SITE, Aircraft, AnyObstacle, Conditions, Site
from missions.dry_run.track import SAMPLE_PERIOD_S, Track
from missions.obstacles import NEAR_M

Array = NDArray[np.float64]
MAX_SAMPLES = 4000
"""Maximum number of path samples in the document."""
MAX_FINDINGS = 100
EMPTY_SHARE = 0.005
"""Battery charge, 0 to 1, at and below which the battery counts as empty."""
TOUCHING_M, FORWARD_M_S = 0.3, 2.0
"""A vehicle nearer to the ground than this [m] that moves horizontally faster than this [m/s] counts as
touching the ground; take-off and landing are slower."""


@dataclass(frozen=True, slots=True)
class DryRun(FlightResult):
    """Result of one dry run."""

    track: Track | None
    """None: the flight did not start."""
    aircraft: Aircraft
    ground_m: Array | None = None
    """Altitude of the ground below each sample of the track, above home; None: level ground."""

    def document(self, max_samples: int = MAX_SAMPLES) -> dict[str, Any]:
        """As JSON values, with a path of at most `max_samples` samples."""
        origin, path = asdict(self.aircraft.origin), self._path(max_samples)
        return {
            "px4": self.aircraft.px4,
            "origin": origin,
            **plain(self, FlightResult),
            "path": path and asdict(path),
        }

    def _path(self, max_samples: int) -> FlownPath | None:
        track = self.track
        if track is None:
            return None
        count = len(track.t_s)
        selected = np.unique(np.linspace(0, count - 1, min(count, max_samples)).round().astype(int))

        def rows(values: Array | None, digits: int) -> Any:
            return None if values is None else np.round(values[selected], digits).tolist()

        return FlownPath(
            t_s=rows(track.t_s, 2),
            position_ned_m=rows(track.position_ned_m, 2),
            velocity_ned_m_s=rows(track.velocity_ned_m_s, 2),
            q_ned_frd=rows(track.q_ned_frd, 4),
            gimbal_rad=rows(track.gimbal_rad, 3),
            battery_share=None if self.battery_end_share is None else rows(track.battery_share, 3),
            ground_m=rows(self.ground_m, 1),
            step=track.step[selected].tolist(),
            step_places=[step.place for step in track.steps],
        )


def dry_run(
    flyable: Flyable,
    aircraft: Aircraft,
    conditions: Conditions | None = None,
    *,
    seed: int = 0,
    site: Site = LEVEL_SITE,
    report: ReportProgress | None = None,
) -> DryRun:
    """Flies a plan once.

    Args:
        flyable: the plan.
        aircraft: the vehicle and its start position.
        conditions: wind, mass and battery; None: no wind, nominal vehicle.
        seed: seed of noise and gusts.
        site: ground and obstacles around the start.
        report: called with the progress; an exception from it ends the dry run.

    Raises:
        PlanError: PX4 refuses the plan.
    """
    conditions = conditions or Conditions()
    began_s = time.perf_counter()
    flight = fly(
        aircraft, [conditions], flyable.make_pilot, max_duration_s=flyable.max_duration_s, seed=seed,
        site=site, report=report,
    )[0]  # fmt: skip
    computing_s = time.perf_counter() - began_s
    return evaluate(flight, flyable, aircraft, site, computing_s)


def evaluate(flight: Flight, flyable: Flyable, aircraft: Aircraft, site: Site, computing_s: float) -> DryRun:
    """Evaluates one flight."""
    track = flight.track
    if track is None:
        return DryRun(
            flight.conditions, False, False, 0.0, 0.0, aircraft.battery_share, None, None, None, (),
            flight.findings, 0.0, None, aircraft,
        )  # fmt: skip
    fence = effective_fence(flyable, aircraft)
    fence_m = fence.distance_m(track.position_ned_m)
    obstacle_m, nearest = obstacle_distance_m(site.obstacles, track.position_ned_m)
    steps = tuple(_step_times(track, fence_m, obstacle_m))
    north_m, east_m, _ = track.position_ned_m.T
    ground_m = None if site.ground is None else site.ground.altitude_home_m(north_m, east_m)
    findings = [*flight.findings, *_fence_findings(track, fence_m)]
    if not flight.collided:
        findings += _obstacle_findings(track, obstacle_m, nearest, site.obstacles)
        findings += _ground_findings(track, ground_m)
    end_share = float(track.battery_share[_last_armed(track)]) if aircraft.battery_is_known else None
    findings += _battery_findings(track, aircraft, end_share)
    order = {"error": 0, "warning": 1}
    findings.sort(key=lambda each: order[each.severity])
    duration_s = float(track.t_s[-1])
    return DryRun(
        flight.conditions, flight.finished, flight.landed, duration_s, track.length_m, aircraft.battery_share,
        end_share, _finite_minimum(fence_m), _finite_minimum(obstacle_m), steps,
        tuple(findings[:MAX_FINDINGS]), duration_s / max(computing_s, 1e-9), track, aircraft, ground_m,
    )  # fmt: skip


def effective_fence(flyable: Flyable, aircraft: Aircraft) -> FenceDistance:
    """The effective geofence: the plan's zones and the cylinder of the vehicle's parameters."""
    parameters = aircraft.parameters
    return FenceDistance(
        flyable.fence,
        aircraft.origin,
        parameters.get("GF_MAX_HOR_DIST", 0.0),
        parameters.get("GF_MAX_VER_DIST", 0.0),
    )


def _finite_minimum(distances: Array) -> float | None:
    least = float(distances.min())
    return least if math.isfinite(least) else None


def _last_armed(track: Track) -> int:
    """Index of the last sample before disarming; the simulated battery is full again after disarming."""
    rises = np.flatnonzero(np.diff(track.battery_share) > 0.0)
    return int(rises[0]) if len(rises) else len(track.battery_share) - 1


def _step_times(track: Track, fence_m: Array, obstacle_m: Array) -> list[StepTime]:
    """The flown steps in order; a repeated step has one entry for each repetition."""
    steps: list[StepTime] = []
    changes = np.flatnonzero(np.diff(track.step)) + 1
    bounds = [0, *changes.tolist(), len(track.step)]
    for first, end in itertools.pairwise(bounds):
        index = int(track.step[first])
        if index < 0:
            continue
        step = track.steps[index]
        last = min(end, len(track.t_s) - 1)
        steps.append(
            StepTime(
                step.place, step.title, step.row, float(track.t_s[first]), float(track.t_s[last]),
                _finite_minimum(fence_m[first:end]), _finite_minimum(obstacle_m[first:end]),
            )
        )  # fmt: skip
    return steps


def _step_time_position(track: Track, sample: int) -> tuple[str | None, float, tuple[float, float, float]]:
    """Step, time [s] and NED position [m] of a sample."""
    index = int(track.step[sample])
    n, e, d = track.position_ned_m[sample].tolist()
    return (track.steps[index].place if index >= 0 else None), round(float(track.t_s[sample]), 2), (n, e, d)


def _fence_findings(track: Track, fence_m: Array) -> list[DryRunFinding]:
    """One finding for each time the flight leaves the fence."""
    outside = fence_m < 0.0
    exits = np.flatnonzero(outside & ~np.concatenate([[False], outside[:-1]]))
    findings: list[DryRunFinding] = []
    for first in exits.tolist():
        after = np.flatnonzero(~outside[first:])
        end = first + int(after[0]) if len(after) else len(outside)
        worst = first + int(fence_m[first:end].argmin())
        step, t_s, position_ned_m = _step_time_position(track, worst)
        message = (
            f"The flight leaves the geofence at {step or 'the start'}, by up to {-fence_m[worst]:.1f} m."
        )
        findings.append(DryRunFinding("fence_touched", message, step, t_s, position_ned_m))
    return findings


def _ground_findings(track: Track, ground_m: Array | None) -> list[DryRunFinding]:
    """A finding at the first sample where the vehicle touches the ground while flying forward."""
    if ground_m is None or len(track.t_s) < 2:
        return []
    north_m, east_m, down_m = track.position_ned_m.T
    speed_m_s = np.hypot(np.gradient(north_m, SAMPLE_PERIOD_S), np.gradient(east_m, SAMPLE_PERIOD_S))
    height_m = -down_m - ground_m
    touching = np.flatnonzero((height_m < TOUCHING_M) & (speed_m_s > FORWARD_M_S))
    if not len(touching):
        return []
    sample = int(touching[0])
    step, t_s, position_ned_m = _step_time_position(track, sample)
    return [
        DryRunFinding(
            "ground_touched",
            f"The flight touches the ground at {step or 'the start'}.",
            step,
            t_s,
            position_ned_m,
        )
    ]


def _obstacle_findings(
    track: Track, obstacle_m: Array, nearest: NDArray[np.intp], obstacles: Sequence[AnyObstacle]
) -> list[DryRunFinding]:
    sample = int(obstacle_m.argmin())
    if not obstacle_m[sample] < NEAR_M:
        return []
    step, t_s, position_ned_m = _step_time_position(track, sample)
    name = obstacles[int(nearest[sample])].name
    message = f"The flight comes within {obstacle_m[sample]:.1f} m of {name} at {step or 'the start'}."
    return [DryRunFinding("obstacle_near", message, step, t_s, position_ned_m)]


def _battery_findings(track: Track, aircraft: Aircraft, end_share: float | None) -> list[DryRunFinding]:
    if end_share is None:
        message = "The vehicle's battery discharge rate is unknown: enter its hover endurance."
        return [DryRunFinding("battery_unknown", message)]
    empty = np.flatnonzero(track.battery_share <= EMPTY_SHARE)
    if len(empty):
        step, t_s, position_ned_m = _step_time_position(track, int(empty[0]))
        message = f"The battery is empty after {t_s:.0f} s, at {step or 'the start'}."
        return [DryRunFinding("battery_empty", message, step, t_s, position_ned_m)]
    if end_share < aircraft.battery_reserve:
        remaining, reserve = f"{end_share:.0%}", f"{aircraft.battery_reserve:.0%}"
        message = f"{remaining} of the battery is left at the end; the reserve is {reserve}."
        step, t_s, position_ned_m = _step_time_position(track, len(track.t_s) - 1)
        return [DryRunFinding("battery_reserve", message, step, t_s, position_ned_m)]
    return []
