"""The messages between the server and the process of the 3D view."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from gcs_server.errors import GcsError
from gcs_server.scene.clicks import ClickRequest
from gcs_server.scene.dry_runs import DryRunPath, DryRunRequest
from gcs_server.scene.gizmo import Drag, PreviewRequest, SceneGizmo
from gcs_server.scene.terrain import Terrain

TOKEN = re.compile(r"[A-Za-z0-9_-]{1,64}")
BRIDGE_KEY = "bridge"
"""Query key of the bridge through which viser's client connected."""
MAX_VIEWS = 64
"""Maximum number of views whose settings are stored for pages that may reconnect."""


class ViewRequest(BaseModel):
    """The content of one view of a page; omitted fields stay unchanged."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    mode: Literal["chase", "free", "gimbal", "top"] | None = None
    vehicle: str | None = Field(default=None, max_length=32, description="Id of the vehicle to show.")
    theme: Literal["dark", "light"] | None = None
    preview: PreviewRequest | None = Field(
        default=None,
        description="Preview of a setpoint that is not sent; null or a change of the vehicle removes it.",
    )
    dry_run: DryRunRequest | None = Field(
        default=None,
        description="Dry run to draw, with path, corridor and the vehicle at one time; null removes it.",
    )


SECRET_HEADER = "X-Scene-Secret"
MAX_SNAPSHOTS_PER_REPORT = 4
"""The process sends a `DrawingState` at the latest after this number of snapshots."""
MAX_DRY_RUNS = 8
"""Number of newest dry runs that the server and the process keep."""


class SceneError(GcsError):
    """The 3D view is not available; flying is not affected."""

    code = "scene_unavailable"


@dataclass(frozen=True, slots=True)
class ViserAddress:
    """Path of viser's socket, and the secret that its clients must send."""

    socket_path: str
    secret: str


# --- from the process ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Started:
    """The 3D view is running."""

    address: ViserAddress


@dataclass(frozen=True, slots=True)
class Response:
    """Result or error of the request with this number."""

    number: int
    result: object
    error: GcsError | None = None


@dataclass(frozen=True, slots=True)
class DrawingState:
    """State of the drawing; sent when it changes, and after every few snapshots."""

    snapshots: int
    """Number of snapshots received so far."""
    viewers: int
    """Number of connected browsers."""
    followed: frozenset[str]
    """Vehicles that views follow."""
    faults: tuple[str, ...]
    """Messages about everything that cannot be drawn now."""


@dataclass(frozen=True, slots=True)
class HistoryRequest:
    """Requests the history of the vehicle with this number in the snapshots."""

    vehicle: int
    topics: tuple[str, ...]
    since_unix_s: float


@dataclass(frozen=True, slots=True)
class GizmoMoved:
    """A browser has dragged a preview."""

    gizmo: SceneGizmo


# --- from the server ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A snapshot of all vehicles, encoded (`snapshots.py`)."""

    data: bytes


@dataclass(frozen=True, slots=True)
class HistoryResponse:
    """The history of a vehicle, encoded (`snapshots.py`)."""

    vehicle: int
    samples: bytes


@dataclass(frozen=True, slots=True)
class SetView:
    """Sets the content of the view with this token; the result is (mode, vehicle, theme)."""

    number: int
    token: str
    request: ViewRequest


@dataclass(frozen=True, slots=True)
class Click:
    """A click in the view with this token; the result is a SceneClick, or None if the click was not on the
    ground."""

    number: int
    token: str
    request: ClickRequest


@dataclass(frozen=True, slots=True)
class HandleDragged:
    """A drag in one browser. `bridge` identifies the browser's connection to viser."""

    bridge: str
    drag: Drag


@dataclass(frozen=True, slots=True)
class NewTerrain:
    """The known ground around the vehicle that a view follows."""

    terrain: Terrain | None
    """None: the ground is not known."""


@dataclass(frozen=True, slots=True)
class DryRunPaths:
    """The paths of a dry run that a later request shows."""

    id: str
    paths: tuple[DryRunPath, ...]
