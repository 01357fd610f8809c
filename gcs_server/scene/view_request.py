"""The request with which a page sets the content of its view."""

from __future__ import annotations

import re
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from gcs_server.scene.dry_runs import DryRunRequest
from gcs_server.scene.gizmo import PreviewRequest

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
