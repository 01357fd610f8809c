"""Computes the shapes that the 3D view draws for a dry run: path, corridor of many flights, and the vehicle
at one time. No I/O.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from gcs_server.plans.dry_runs import read_result
from gcs_server.scene.frames import enu_from_ned, q_enu_flu_from_q_ned_frd
from gcs_server.scene.model import Mesh, Points
from gcs_server.scene.pose import VehiclePose
from gcs_server.scene.texts import metres_text
from missions.frames import IDENTITY, Vector3, conjugate, multiply, normalized, q_from_euler

MAX_POINTS = 600
"""Maximum number of drawn points of the path."""
MIN_HORIZONTAL_M = 0.01
"""Horizontal distance below which two points define no direction [m]."""

DryRunResults = Callable[[str], bytes]
"""Returns the result of a dry run by its id, as JSON; raises UnknownDryRun."""


class DryRunRequest(BaseModel):
    """The dry run that a page shows, and the shown time."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    id: str = Field(max_length=20, description="Id of the dry run, as in `GET /dry_runs/{d}`.")
    t_s: float | None = Field(
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="Time to show, since the start of the flight [s]; null: show only paths and corridor.",
    )
    follow: bool = Field(
        default=False,
        description="Whether the camera follows the simulated vehicle instead of the real vehicle.",
    )


@dataclass(frozen=True, slots=True, eq=False)
class DryRunPath:
    """One vehicle's nominal flight (N samples) and the corridor of all flights (M points), in ENU from
    `origin_deg_m`.
    """

    origin_deg_m: tuple[float, float, float]
    """Start position of the first vehicle: latitude, longitude, altitude AMSL."""
    t_s: NDArray[np.float64]
    """(N,) times since the start [s]."""
    position_enu_m: NDArray[np.float64]
    """(N, 3)."""
    q_ned_frd: NDArray[np.float64]
    """(N, 4), order w, x, y, z."""
    gimbal_rad: NDArray[np.float64]
    """(N, 2): pitch, up is positive; yaw from north."""
    corridor_enu_m: NDArray[np.float64] | None
    """(M, 4, 3): corners of the corridor at each point, in the order left low, right low, right high, left
    high."""
    role: str | None = None
    """The vehicle's role in a mission of several vehicles."""


@dataclass(frozen=True, slots=True)
class DryRunMoment:
    """The paths of the dry run that a page shows, and the shown time."""

    id: str
    paths: tuple[DryRunPath, ...]
    """Path of each vehicle that flew; the camera follows the first vehicle."""
    t_s: float | None
    """Time since the start of the flight [s]; None: the vehicles are not shown."""
    follow: bool


def read_paths(result: bytes) -> tuple[DryRunPath, ...]:
    """`paths_of` a result as JSON."""
    return paths_of(read_result(result))


def paths_of(result: Mapping[str, Any]) -> tuple[DryRunPath, ...]:
    """The paths of all vehicles that flew, from the result of a dry run."""
    group = result["group"]
    if group is None:
        path = _path_of(None, result["nominal"], result["monte_carlo"])
        return () if path is None else (path,)
    monte_carlo = group["monte_carlo"]
    paths = (
        _path_of(role, flight, None if monte_carlo is None else monte_carlo["roles"][role])
        for role, flight in group["roles"].items()
    )
    return tuple(path for path in paths if path is not None)


def _path_of(
    role: str | None, flight: Mapping[str, Any], monte_carlo: Mapping[str, Any] | None
) -> DryRunPath | None:
    path, origin = flight["path"], flight["origin"]
    corridor = None if monte_carlo is None else monte_carlo["corridor"]
    if path is None or not path["t_s"]:
        return None
    return DryRunPath(
        (origin["lat_deg"], origin["lon_deg"], origin["alt_amsl_m"]),
        np.asarray(path["t_s"], float),
        _enu(path["position_ned_m"]),
        np.asarray(path["q_ned_frd"], float),
        np.asarray(path["gimbal_rad"], float),
        None if corridor is None else _corners(corridor),
        role,
    )


def path_lines(path: DryRunPath) -> Points:
    """(K, 2, 3): the flown path as line segments, thinned."""
    stride = max(1, len(path.t_s) // MAX_POINTS)
    line = np.concatenate([path.position_enu_m[::stride], path.position_enu_m[-1:]]).astype(np.float32)
    return np.stack([line[:-1], line[1:]], axis=1)


def corridor_mesh(path: DryRunPath) -> Mesh | None:
    """The corridor as a mesh that is open at both ends; None if there is no corridor."""
    corners = path.corridor_enu_m
    if corners is None or len(corners) < 2:
        return None
    faces: list[tuple[int, int, int]] = []
    for index in range(len(corners) - 1):
        for side in range(4):
            a, b = 4 * index + side, 4 * index + (side + 1) % 4
            faces += [(a, b, a + 4), (b, b + 4, a + 4)]
    return Mesh(corners.reshape(-1, 3).astype(np.float32), np.asarray(faces, np.uint32))


def corridor_edges(path: DryRunPath) -> Points | None:
    """(K, 2, 3): the four edges of the corridor as line segments; None if there is no corridor."""
    corners = path.corridor_enu_m
    if corners is None or len(corners) < 2:
        return None
    return np.stack([corners[:-1], corners[1:]], axis=2).reshape(-1, 2, 3).astype(np.float32)


def pose_at(path: DryRunPath, t_s: float, origin_enu_m: Vector3) -> VehiclePose:
    """The vehicle's pose at a time; before and after the flight its first and last pose.

    Args:
        origin_enu_m: start of the flight, in the world's ENU frame.
    """
    last = len(path.t_s) - 1
    after = int(np.clip(np.searchsorted(path.t_s, t_s, side="right"), 1, max(1, last)))
    before, after = min(after - 1, last), min(after, last)
    span_s = path.t_s[after] - path.t_s[before]
    fraction = float(np.clip((t_s - path.t_s[before]) / span_s, 0.0, 1.0)) if span_s > 0 else 1.0
    position_enu_m = path.position_enu_m[before] * (1 - fraction) + path.position_enu_m[after] * fraction
    nearest = after if fraction > 0.5 else before
    w, x, y, z = (float(value) for value in path.q_ned_frd[nearest])
    q_enu_flu = q_enu_flu_from_q_ned_frd(normalized((w, x, y, z)) or IDENTITY)
    pitch_rad, yaw_rad = (float(value) for value in path.gimbal_rad[nearest])
    q_camera = q_enu_flu_from_q_ned_frd(q_from_euler(0.0, pitch_rad, yaw_rad))
    east_m, north_m, up_m = (float(value) for value in position_enu_m)
    return VehiclePose(
        position_enu_m=(origin_enu_m[0] + east_m, origin_enu_m[1] + north_m, origin_enu_m[2] + up_m),
        q_enu_flu=q_enu_flu,
        ground_z_m=origin_enu_m[2],
        home_enu_m=None,
        q_body_camera=normalized(multiply(conjugate(q_enu_flu), q_camera)),
        motors=None,
        target=None,
        lost=False,
        label=f"{path.role or 'dry run'} · {metres_text(up_m)} above the start",
        note=f"{int(t_s) // 60:02d}:{int(t_s) % 60:02d}",
    )


def _enu(positions_ned_m: Any) -> NDArray[np.float64]:
    ned = np.asarray(positions_ned_m, float).reshape(-1, 3)
    return np.stack(enu_from_ned((ned[:, 0], ned[:, 1], ned[:, 2])), axis=1)  # type: ignore[arg-type]


def _corners(corridor: Mapping[str, Any]) -> NDArray[np.float64]:
    """Corners of the corridor, which contains 95 % of the flights sideways and the middle 90 % vertically."""
    middle = _enu(corridor["position_ned_m"])
    direction = np.gradient(middle[:, :2], axis=0) if len(middle) > 1 else np.zeros((len(middle), 2))
    length_m = np.hypot(direction[:, 0], direction[:, 1])
    has_direction = length_m > MIN_HORIZONTAL_M
    # During a vertical climb the corridor keeps the direction of the previous leg.
    index = np.maximum.accumulate(np.where(has_direction, np.arange(len(middle)), 0))
    direction = np.where(
        has_direction[:, None], direction / np.maximum(length_m, MIN_HORIZONTAL_M)[:, None], 0.0
    )[index]
    # Before the first horizontal leg, the corridor points north.
    direction[np.hypot(direction[:, 0], direction[:, 1]) < 0.5] = (0.0, 1.0)
    left = np.stack([-direction[:, 1], direction[:, 0], np.zeros(len(middle))], axis=1)
    sideways = left * np.asarray(corridor["horizontal_m"]["p95"], float)[:, None]
    up = np.array([0.0, 0.0, 1.0])
    low = up * np.asarray(corridor["vertical_m"]["p5"], float)[:, None]
    high = up * np.asarray(corridor["vertical_m"]["p95"], float)[:, None]
    return np.stack(
        [
            middle + sideways + low,
            middle - sideways + low,
            middle - sideways + high,
            middle + sideways + high,
        ],
        axis=1,
    )
