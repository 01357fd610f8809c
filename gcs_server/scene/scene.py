"""Draws the fleet in the 3D views of all browsers. Runs in a separate process (`worker.py`).

A vehicle that cannot be drawn is left out. Any other error ends the process, and the server starts it again.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace

from gcs_server.clock import Clock
from gcs_server.language import LANGUAGES
from gcs_server.scene.browser_scene import BrowserScene
from gcs_server.scene.clicks import ClickRequest, SceneClick
from gcs_server.scene.dry_runs import DryRunMoment, DryRunPath
from gcs_server.scene.gizmo import Drag, SceneGizmo, apply_drag
from gcs_server.scene.host import ViserHost
from gcs_server.scene.messages import BRIDGE_KEY, MAX_VIEWS, TOKEN, ViewRequest, ViserAddress
from gcs_server.scene.palette import Theme
from gcs_server.scene.ports import OffboardTargets, SceneFleet
from gcs_server.scene.terrain import Terrain, TerrainShape
from gcs_server.scene.tracks import Tracks
from gcs_server.scene.views import CAMERAS, Mode, Preview, View

MAX_STEP_S = 0.25
"""Maximum time step of the smoothing between two pictures [s]."""


class Scene:
    """The 3D view.

    Args:
        fleet: the vehicles to draw; the scene does not change them.
        clock: clock for the steps.
        offboard: returns the setpoint that the server streams to a vehicle; None: draw the target that the
            vehicle reports.
        on_gizmo: called with the position to which a view's preview was dragged.
        dry_runs: returns the paths of a dry run that a page shows; None: no dry runs.
        stalled: whether the browser of a bridge does not read; nothing is drawn for it.
    """

    def __init__(
        self,
        fleet: SceneFleet,
        clock: Clock,
        offboard: OffboardTargets | None = None,
        on_gizmo: Callable[[SceneGizmo], None] | None = None,
        dry_runs: Callable[[str], tuple[DryRunPath, ...]] | None = None,
        stalled: Callable[[str], bool] = lambda _: False,
    ) -> None:
        self._dry_runs, self._on_gizmo, self._is_bridge_stalled = dry_runs, on_gizmo, stalled
        self._clock = clock
        self._host = ViserHost()
        self._tracks = Tracks(fleet, offboard, clock)
        self._views: OrderedDict[str, View] = OrderedDict()
        self._browser_scenes: dict[int, tuple[str, BrowserScene]] = {}
        """Token of the view, and the scene of the browser, by viser's client id."""
        self._preview_serial = 0
        self._terrain: Terrain | None = None
        self._shape: TerrainShape | None = None
        self._drawn_s = clock.monotonic_s()

    @property
    def viewers(self) -> int:
        """Number of connected browsers."""
        return len(self._browser_scenes)

    def faults(self) -> list[str]:
        """Messages about data that cannot be drawn now."""
        return self._tracks.isolation.faults

    @property
    def followed(self) -> frozenset[str]:
        """Vehicles that views follow."""
        selected = (
            self._tracks.selected(self._views[token].vehicle) for token, _ in self._browser_scenes.values()
        )
        return frozenset(track[0] for track in selected if track is not None)

    async def start(self) -> ViserAddress:
        """Starts viser; returns its address. Raises SceneError."""
        return await self._host.start()

    async def stop(self) -> None:
        """Stops viser and its threads."""
        self._browser_scenes.clear()
        await self._host.stop()

    def draw(self) -> None:
        """Sends each browser the changes since the last call."""
        now_s = self._clock.monotonic_s()
        self._step(now_s, min(MAX_STEP_S, now_s - self._drawn_s))
        self._drawn_s = now_s

    def _step(self, now_s: float, dt_s: float) -> None:
        clients = self._host.clients()
        for closed_client_id in [c for c in self._browser_scenes if c not in clients]:
            del self._browser_scenes[closed_client_id]
        reading_clients = {i: c for i, c in clients.items() if not self._is_client_stalled(i)}
        if not reading_clients:
            return
        tracks = self._tracks.update(now_s, dt_s, self.followed)
        for client_id, client in reading_clients.items():
            entry = self._browser_scenes.get(client_id)
            token = entry[0] if entry is not None else self._token(client_id)
            view = self._views[token]
            if entry is None or entry[1].theme != view.theme:
                previous = entry[1] if entry is not None else None
                if previous is not None:
                    previous.close()
                entry = (token, BrowserScene(client, view, self._tracks.isolation, previous))
                self._browser_scenes[client_id] = entry
            start_m = self._tracks.enu(view.dry_run.paths[0].origin_deg_m) if view.dry_run else None
            entry[1].update(view, tracks, now_s, start_m, self._tracks.origin_deg_m, self._terrain_shape())

    def set_terrain(self, terrain: Terrain | None) -> None:
        """Sets the known ground; None: it is not known, and a level grid is drawn."""
        self._terrain = terrain

    def _terrain_shape(self) -> TerrainShape | None:
        """The shape of the known ground; None: it is not known, or the world has no place on earth yet."""
        origin, terrain = self._tracks.origin_deg_m, self._terrain
        if origin is None or terrain is None:
            self._shape = None
        elif self._shape is None or self._shape.terrain is not terrain or self._shape.origin_deg_m != origin:
            self._shape = TerrainShape(terrain, origin)
        return self._shape

    def set_view(self, token: str, request: ViewRequest) -> View:
        """Sets the content of the view with a token."""
        earlier = self._views.get(token, View())
        view = View(
            request.mode or earlier.mode,
            request.vehicle or earlier.vehicle,
            request.theme or earlier.theme,
            earlier.language,
            self._preview(request, earlier),
            self._dry_run(request, earlier),
        )
        return self._store_view(token, view)

    def _preview(self, request: ViewRequest, earlier: View) -> Preview | None:
        """The preview after a request; an omitted preview stays, but not for another vehicle."""
        if "preview" not in request.model_fields_set:
            return earlier.preview if request.vehicle in (None, earlier.vehicle) else None
        requested = request.preview
        if requested is None:
            return None
        self._preview_serial += 1
        return Preview(
            requested.position_ned_m, requested.yaw_ned_rad, requested.handles, self._preview_serial
        )

    def _dry_run(self, request: ViewRequest, earlier: View) -> DryRunMoment | None:
        """The dry run after a request; an omitted dry run stays."""
        requested, previous = request.dry_run, earlier.dry_run
        if "dry_run" not in request.model_fields_set:
            return previous
        if requested is None or self._dry_runs is None:
            return None
        paths = previous.paths if previous and previous.id == requested.id else self._dry_runs(requested.id)
        return DryRunMoment(requested.id, paths, requested.t_s, requested.follow) if paths else None

    def drag(self, bridge: str, drag: Drag) -> None:
        """Handles a drag in the browser of this bridge, which moves only the preview of this browser's
        view."""
        for client_id, (token, browser_scene) in self._browser_scenes.items():
            if self._host.query_of(client_id).get(BRIDGE_KEY) == bridge:
                self._apply_drag(token, browser_scene, drag)
                return

    def _apply_drag(self, token: str, browser_scene: BrowserScene, drag: Drag) -> None:
        view = self._views[token]
        selected = self._tracks.selected(view.vehicle)
        pose = selected[1].smoother.pose if selected is not None else None
        origin = selected[1].local_origin_enu_m if selected is not None else None
        if view.preview is None or not view.preview.handles or view.mode != "free":
            return
        if selected is None or pose is None or origin is None:
            return
        preview = apply_drag(view.preview, drag, origin, pose.position_enu_m)
        if preview is None:
            return
        browser_scene.set_dragged_handle(changes_yaw=drag.changes_yaw)
        self._views[token] = replace(view, preview=preview)
        if self._on_gizmo is not None:
            released = drag.position_enu_m is None
            self._on_gizmo(
                SceneGizmo(token, selected[0], preview.position_ned_m, preview.yaw_ned_rad, released)
            )

    def click(self, token: str, click: ClickRequest) -> SceneClick | None:
        """The clicked position; None: not on the ground.

        Raises:
            Refused: no vehicle has reported a global position.
        """
        view = self._views.get(token, View())
        ground_position = self._tracks.ground_position(
            view.vehicle, click.eye_enu_m, click.ray_enu, self._terrain_shape()
        )
        if ground_position is None:
            return None
        return SceneClick(token, *ground_position, click.view_x, click.view_y)

    def _is_client_stalled(self, client_id: int) -> bool:
        return self._is_bridge_stalled(self._host.query_of(client_id).get(BRIDGE_KEY, ""))

    def _token(self, client_id: int) -> str:
        """The token of a browser's view. A view that does not exist yet is created as the browser's address
        requests."""
        query = self._host.query_of(client_id)
        token = query.get("view", "")
        if not TOKEN.fullmatch(token):
            token = f".{client_id}"  # no page can use this token
        asked = _view_from_query(query)
        view = self._views.get(token)
        # The page may have set the content before its stream began; only the address has the language.
        self._store_view(token, asked if view is None else replace(view, language=asked.language))
        return token

    def _store_view(self, token: str, view: View) -> View:
        self._views[token] = view
        self._views.move_to_end(token)
        in_use = {t for t, _ in self._browser_scenes.values()} | {token}
        for unused in [t for t in self._views if t not in in_use][: max(0, len(self._views) - MAX_VIEWS)]:
            del self._views[unused]
        return view


def _view_from_query(query: dict[str, str]) -> View:
    """The view that an address requests; an invalid value becomes the default, so that the browser shows
    a view and not an error.
    """
    mode: Mode = "chase"
    for valid_mode in CAMERAS:
        if valid_mode == query.get("mode"):
            mode = valid_mode
    theme: Theme = "light" if query.get("theme") == "light" else "dark"
    language = query.get("language", "")
    return View(
        mode=mode,
        vehicle=query.get("vehicle") or None,
        theme=theme,
        language=language if language in LANGUAGES else LANGUAGES[0],
    )
