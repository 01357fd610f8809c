"""The 3D view of the fleet: reads the topics 30 times a second, only while a view is open.

The scene reads data and never sends commands. A vehicle that cannot be drawn is left out. Any other error
ends `run()`, and the supervisor reports and restarts it. No other part of the server waits for the scene.
"""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace

from fastapi import APIRouter

from gcs_server.clock import Clock
from gcs_server.scene.clicks import ClickRequest, SceneClick
from gcs_server.scene.dry_runs import DryRunMoment, DryRunResults, paths_of
from gcs_server.scene.gizmo import Drag, SceneGizmo, dragged
from gcs_server.scene.host import ViserHost
from gcs_server.scene.palette import Theme
from gcs_server.scene.ports import OffboardTargets, SceneFleet
from gcs_server.scene.proxy import BRIDGE_KEY, TOKEN, Bridges, ViewRequest, scene_router
from gcs_server.scene.stage import Stage
from gcs_server.scene.tracks import Tracks
from gcs_server.scene.views import CAMERAS, Mode, Preview, View

log = logging.getLogger(__name__)

PERIOD_S = 1.0 / 30.0
IDLE_PERIOD_S = 0.25
"""Period while no view is open: only checks whether one has opened [s]."""
MAX_STEP_S = 0.25
MAX_VIEWS = 64
"""Number of views whose settings are kept for pages that may reconnect."""


class Scene:
    """The 3D view.

    Args:
        fleet: the vehicles to draw; the scene does not change them.
        clock: clock for the steps.
        offboard: target of this server's stream; None: draw the target that the vehicle reports.
        on_click: called with the clicked ground position and the view.
        on_gizmo: called with the position to which a view's preview was dragged.
        dry_runs: result of a dry run that a page shows; None: no dry runs.
    """

    def __init__(
        self,
        fleet: SceneFleet,
        clock: Clock,
        offboard: OffboardTargets | None = None,
        on_click: Callable[[SceneClick], None] | None = None,
        on_gizmo: Callable[[SceneGizmo], None] | None = None,
        dry_runs: DryRunResults | None = None,
    ) -> None:
        self._fleet = fleet
        self._dry_runs = dry_runs
        self._clock = clock
        self._on_click = on_click
        self._on_gizmo = on_gizmo
        self._host = ViserHost()
        self._tracks = Tracks(fleet, offboard, clock)
        self._views: OrderedDict[str, View] = OrderedDict()
        self._stages: dict[int, tuple[str, Stage]] = {}
        self._bridges = Bridges(clock)
        self._router = scene_router(self._host, self._set_view, self._click, self._drag, self._bridges)
        self._serial = 0
        self._started = False

    def router(self) -> APIRouter:
        """The routes `/scene/…`, to be included in the server's application."""
        return self._router

    @property
    def viewers(self) -> int:
        """Number of connected browsers."""
        return len(self._stages)

    def faults(self) -> list[str]:
        """Messages about data that cannot be drawn now."""
        return self._tracks.isolation.faults

    async def start(self) -> None:
        """Starts viser. Raises SceneError; `run` tries again by itself."""
        if not self._started:
            await self._host.start()
            self._started = True

    async def run(self) -> None:
        """Draws until cancelled; run by the supervisor."""
        await self.start()
        # After a failure every browser's scene is rebuilt, so that no partial scene remains.
        for _, stage in self._stages.values():
            stage.close()
        self._stages.clear()
        last_s = self._clock.monotonic_s()
        while True:
            now_s = self._clock.monotonic_s()
            self._step(now_s, min(MAX_STEP_S, now_s - last_s))
            last_s = now_s
            spent_s = self._clock.monotonic_s() - now_s
            period_s = PERIOD_S if self._stages else IDLE_PERIOD_S
            await self._clock.sleep(max(0.002, period_s - spent_s))

    async def stop(self) -> None:
        """Stops viser and its threads."""
        self._stages.clear()
        self._started = False
        await self._host.stop()

    def _step(self, now_s: float, dt_s: float) -> None:
        clients = self._host.clients()
        for gone in [c for c in self._stages if c not in clients]:
            del self._stages[gone]
        reading = {i: c for i, c in clients.items() if not self._stalled(i)}
        if not reading:
            return
        followed = (self._tracks.shown(self._views[token].vehicle) for token, _ in self._stages.values())
        wanted = {shown[0] for shown in followed if shown is not None}
        drawn = self._tracks.update(now_s, dt_s, wanted)
        for client_id, client in reading.items():
            known = self._stages.get(client_id)
            token = known[0] if known is not None else self._token(client_id)
            view = self._views[token]
            if known is None or known[1].theme != view.theme:
                before = known[1] if known is not None else None
                if before is not None:
                    before.close()
                known = (token, Stage(client, view, self._tracks.isolation, before))
                self._stages[client_id] = known
            start_m = self._tracks.enu(view.dry_run.paths[0].origin_deg_m) if view.dry_run else None
            known[1].update(view, drawn, now_s, start_m)

    def _set_view(self, token: str, wanted: ViewRequest) -> View:
        if wanted.vehicle is not None:
            self._fleet.get(wanted.vehicle)
        old = self._views.get(token, View())
        view = View(
            wanted.mode or old.mode,
            wanted.vehicle or old.vehicle,
            wanted.theme or old.theme,
            self._preview(wanted, old),
            self._dry_run(wanted, old),
        )
        return self._keep(token, view)

    def _preview(self, wanted: ViewRequest, old: View) -> Preview | None:
        """The preview after a request; an omitted preview stays, but not for another vehicle."""
        if "preview" not in wanted.model_fields_set:
            return old.preview if wanted.vehicle in (None, old.vehicle) else None
        requested = wanted.preview
        if requested is None:
            return None
        self._serial += 1
        return Preview(requested.position_ned_m, requested.yaw_ned_rad, requested.handles, self._serial)

    def _dry_run(self, wanted: ViewRequest, old: View) -> DryRunMoment | None:
        """The dry run after a request; an omitted one stays. Raises UnknownDryRun."""
        requested, before = wanted.dry_run, old.dry_run
        if "dry_run" not in wanted.model_fields_set:
            return before
        if requested is None or self._dry_runs is None:
            return None
        paths = (
            before.paths if before and before.id == requested.id else paths_of(self._dry_runs(requested.id))
        )
        return DryRunMoment(requested.id, paths, requested.t_s, requested.follow) if paths else None

    def _drag(self, bridge: str, drag: Drag) -> None:
        """Handles a drag in the browser of this bridge, which moves only the preview of its own view."""
        for client_id, (token, stage) in self._stages.items():
            if self._host.query_of(client_id).get(BRIDGE_KEY) == bridge:
                self._drag_in(token, stage, drag)
                return

    def _drag_in(self, token: str, stage: Stage, drag: Drag) -> None:
        view = self._views[token]
        shown = self._tracks.shown(view.vehicle)
        pose = shown[1].smoother.pose if shown is not None else None
        origin = shown[1].local_origin_enu_m if shown is not None else None
        if view.preview is None or not view.preview.handles or view.mode != "free":
            return
        if shown is None or pose is None or origin is None:
            return
        moved = dragged(view.preview, drag, origin, pose.position_enu_m)
        if moved is None:
            return
        stage.hold(turns=drag.turns)
        self._views[token] = replace(view, preview=moved)
        if self._on_gizmo is not None:
            released = drag.position_enu_m is None
            self._on_gizmo(SceneGizmo(token, shown[0], moved.position_ned_m, moved.yaw_ned_rad, released))

    def _click(self, token: str, click: ClickRequest) -> SceneClick | None:
        """Raises Refused if no vehicle has reported a global position."""
        view = self._views.get(token, View())
        at = self._tracks.on_ground(view.vehicle, click.eye_enu_m, click.ray_enu)
        if at is None:
            return None
        scene_click = SceneClick(token, *at, click.view_x, click.view_y)
        if self._on_click is not None:
            self._on_click(scene_click)
        return scene_click

    def _stalled(self, client_id: int) -> bool:
        return self._bridges.stalled(self._host.query_of(client_id).get(BRIDGE_KEY, ""))

    def _token(self, client_id: int) -> str:
        """The view's token, and the view that its address requests."""
        query = self._host.query_of(client_id)
        token = query.get("view", "")
        if not TOKEN.fullmatch(token):
            token = f".{client_id}"  # no page can use this token
        if token not in self._views:
            self._keep(token, _view_from_query(query))
        return token

    def _keep(self, token: str, view: View) -> View:
        self._views[token] = view
        self._views.move_to_end(token)
        in_use = {t for t, _ in self._stages.values()} | {token}
        for old in [t for t in self._views if t not in in_use][: max(0, len(self._views) - MAX_VIEWS)]:
            del self._views[old]
        return view


def _view_from_query(query: dict[str, str]) -> View:
    """The view that an address requests; invalid values become the default, because a picture is better than
    an error.
    """
    mode: Mode = "chase"
    for known in CAMERAS:
        if known == query.get("mode"):
            mode = known
    theme: Theme = "light" if query.get("theme") == "light" else "dark"
    return View(mode=mode, vehicle=query.get("vehicle") or None, theme=theme)
