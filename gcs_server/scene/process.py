"""The server's side of the 3D view, which a separate process draws (`worker.py`).

The event loop also runs the flights, so for the view it only reads the vehicles' newest samples for a
snapshot, and passes on bytes between viser and the browsers. The server sends no further snapshot while the
process has not reported the last `MAX_UNREPORTED` snapshots: a slow view gets fewer pictures, and the event
loop does not wait for the view. docs/performance.md has measurements.
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from fastapi import APIRouter

from gcs_server.clock import Clock, until_next_s
from gcs_server.errors import GcsError
from gcs_server.scene import messages as m
from gcs_server.scene.clicks import ClickRequest, SceneClick
from gcs_server.scene.dry_runs import DryRunPath, DryRunResults, read_paths
from gcs_server.scene.gizmo import Drag, SceneGizmo
from gcs_server.scene.handle import REMEDY, SceneWorker
from gcs_server.scene.messages import MAX_VIEWS, ViewRequest
from gcs_server.scene.ports import OffboardTargets, SceneFleet
from gcs_server.scene.proxy import Bridges, ShownView, scene_router
from gcs_server.scene.snapshots import SnapshotBuilder
from gcs_server.scene.terrain import Terrain
from gcs_server.scene.terrain_watch import SceneGround

PERIOD_S = 1.0 / 30.0
IDLE_PERIOD_S = 0.25
"""Period of the check whether a view has opened, while no view is open [s]."""
MAX_UNREPORTED = 2 * m.MAX_SNAPSHOTS_PER_REPORT
"""Maximum number of sent snapshots that the process has not reported yet."""
RESPONSE_TIMEOUT_S = 5.0
GROUND_PERIOD_S = 2.0
"""Period of the check whether other ground is to be drawn [s]."""
HUNG_AFTER_S = 20.0
"""A process that takes no snapshot for longer than this is ended and started again [s]."""
NOT_RUNNING = "The 3D view is not running; it is being started."


class _Run:
    """The data of one run of the process."""

    def __init__(self, address: m.ViserAddress, worker: SceneWorker, builder: SnapshotBuilder) -> None:
        self.address, self.post, self.builder = address, worker.post, builder
        self.sent = 0
        """Number of sent snapshots."""
        self.newest = m.DrawingState(0, 0, frozenset(), ())
        self.dry_runs: OrderedDict[str, None] = OrderedDict()
        """Dry runs whose paths the process has; both sides keep the newest `MAX_DRY_RUNS`."""


class SceneProcess:
    """The 3D view.

    Args:
        fleet: the vehicles to draw; they are only read.
        clock: clock for the period.
        offboard: returns the setpoint that this server streams to a vehicle; None: draw the target that the
            vehicle reports.
        on_click: called with the clicked ground position and the view.
        on_gizmo: called with the position to which a view's preview was dragged.
        dry_runs: result of a dry run that a page shows; None: no dry runs.
        ground: the known ground around the vehicles that views follow; None: level grids.
    """

    def __init__(
        self,
        fleet: SceneFleet,
        clock: Clock,
        offboard: OffboardTargets | None = None,
        on_click: Callable[[SceneClick], None] | None = None,
        on_gizmo: Callable[[SceneGizmo], None] | None = None,
        dry_runs: DryRunResults | None = None,
        ground: SceneGround | None = None,
    ) -> None:
        self._fleet, self._clock, self._offboard = fleet, clock, offboard
        self._on_click, self._on_gizmo, self._dry_runs = on_click, on_gizmo, dry_runs
        self._paths: OrderedDict[str, tuple[DryRunPath, ...]] = OrderedDict()
        """Paths of the dry runs that pages have shown last."""
        self._bridges = Bridges(clock)
        self._ground = ground
        self._run: _Run | None = None
        self._worker: SceneWorker | None = None
        self._failed = False
        self._views: OrderedDict[str, ViewRequest] = OrderedDict()
        """Content of each view, by the token of its page; sent again to a restarted process."""
        self._pending: dict[int, asyncio.Future[Any]] = {}
        self._number = 0
        self._router = scene_router(
            lambda: None if self._run is None else self._run.address,
            self._set_view,
            self._click,
            self._drag,
            self._bridges,
        )

    def router(self) -> APIRouter:
        """The routes `/scene/…`, to be included in the server's application."""
        return self._router

    @property
    def pid(self) -> int | None:
        """Process id; None while there is no process."""
        return None if self._worker is None else self._worker.pid

    @property
    def viewers(self) -> int:
        """Number of connected browsers."""
        return 0 if self._run is None else self._run.newest.viewers

    def faults(self) -> list[str]:
        """Texts about everything that cannot be drawn now."""
        return [] if self._run is None else [*self._run.builder.faults, *self._run.newest.faults]

    def warning(self) -> str | None:
        """A text while the process has ended and is not running again."""
        if self._run is not None or not self._failed:
            return None
        return "The 3D view has stopped and is being started again. Flying is not affected."

    async def run(self) -> None:
        """Runs the process until this call is cancelled. The supervisor calls this again after an error.

        Raises:
            SceneError: the process could not be started, has ended, or no longer draws.
        """
        self._worker = worker = SceneWorker(self._handle)
        try:
            address = await worker.start()
            run = self._run = _Run(address, worker, SnapshotBuilder(self._fleet, self._offboard, self._clock))
            self._failed = False
            self._restore_views(run)
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._send_snapshots(run), name="scene snapshots")
                tasks.create_task(worker.wait(), name="scene process")
                if self._ground is not None:
                    tasks.create_task(self._send_terrain(run, self._ground), name="scene terrain")
        except* Exception as errors:
            self._failed = True
            raise errors.exceptions[0] from None
        finally:
            self._run = self._worker = None
            pending, self._pending = self._pending, {}
            for future in pending.values():
                if not future.done():
                    future.set_exception(m.SceneError(NOT_RUNNING, remedy=REMEDY))
            await worker.end()

    # --- pictures ---------------------------------------------------------------------------------

    async def _send_snapshots(self, run: _Run) -> None:
        last_progress_s = self._clock.monotonic_s()
        while True:
            open_bridges, stalled = self._bridges.names(), self._bridges.stalled_names()
            # When the last view has closed, one more snapshot lets the process remove its scene.
            needs_snapshot = len(stalled) < len(open_bridges) or (run.newest.viewers and not open_bridges)
            now_s = self._clock.monotonic_s()
            if run.sent - run.newest.snapshots < MAX_UNREPORTED:
                last_progress_s = now_s
                if needs_snapshot:
                    run.sent += 1
                    run.post(m.Snapshot(run.builder.snapshot(run.newest.followed, stalled)))
            elif now_s - last_progress_s > HUNG_AFTER_S:
                raise m.SceneError("The 3D view no longer draws; it is ended.", remedy=REMEDY)
            period_s = PERIOD_S if open_bridges else IDLE_PERIOD_S
            await self._clock.sleep(until_next_s(self._clock, period_s))

    async def _send_terrain(self, run: _Run, ground: SceneGround) -> None:
        """Keeps the ground around a followed vehicle drawn, while a view is open."""
        sent: Terrain | None = None
        while True:
            if self._bridges.names():
                terrain = await ground.around(self._fleet, run.newest.followed)
                if terrain is not sent:
                    sent = terrain
                    run.post(m.NewTerrain(terrain))
            await self._clock.sleep(GROUND_PERIOD_S)

    def _handle(self, message: object) -> None:
        run = self._run
        if run is None:
            return
        match message:
            case m.DrawingState():
                run.newest = message
            case m.Response(number, result, error):
                future = self._pending.get(number)
                if future is not None and not future.done():
                    future.set_result(result) if error is None else future.set_exception(error)
            case m.HistoryRequest(number, topics, since_unix_s):
                run.post(m.HistoryResponse(number, run.builder.history(number, topics, since_unix_s)))
            case m.GizmoMoved(gizmo):
                self._on_gizmo_moved(gizmo)
            case _:
                raise TypeError(f"an unknown message: {message!r}")

    # --- requests of pages ------------------------------------------------------------------------

    async def _set_view(self, token: str, request: ViewRequest) -> ShownView:
        """Raises UnknownVehicle, UnknownDryRun, SceneError."""
        if request.vehicle is not None:
            self._fleet.get(request.vehicle)
        await self._read_dry_run(request)
        run = self._require_run()
        self._send_dry_run(run, request)
        self._store_view(token, request)
        return await self._request(run, lambda number: m.SetView(number, token, request))

    async def _click(self, token: str, request: ClickRequest) -> SceneClick | None:
        """Raises Refused if no vehicle has reported a global position, and SceneError."""
        click: SceneClick | None = await self._request(
            self._require_run(), lambda number: m.Click(number, token, request)
        )
        if click is not None and self._on_click is not None:
            self._on_click(click)
        return click

    def _drag(self, bridge: str, drag: Drag) -> None:
        run = self._run
        # A drag is dropped while the process does not keep up with the snapshots.
        if run is not None and run.sent - run.newest.snapshots < MAX_UNREPORTED:
            run.post(m.HandleDragged(bridge, drag))

    def _require_run(self) -> _Run:
        if self._run is None:
            raise m.SceneError(NOT_RUNNING, remedy=REMEDY)
        return self._run

    async def _request(self, run: _Run, message: Callable[[int], object]) -> Any:
        self._number += 1
        number = self._number
        future = self._pending[number] = asyncio.get_running_loop().create_future()
        try:
            run.post(message(number))
            async with asyncio.timeout(RESPONSE_TIMEOUT_S):
                return await future
        except TimeoutError:
            raise m.SceneError("The 3D view does not answer.", remedy=REMEDY) from None
        finally:
            self._pending.pop(number, None)

    async def _read_dry_run(self, request: ViewRequest) -> None:
        """Reads the paths of the dry run that a page shows, in a thread; raises UnknownDryRun."""
        requested = request.dry_run
        if requested is None or self._dry_runs is None or requested.id in self._paths:
            return
        self._paths[requested.id] = await asyncio.to_thread(read_paths, self._dry_runs(requested.id))
        while len(self._paths) > m.MAX_DRY_RUNS:
            self._paths.popitem(last=False)

    def _send_dry_run(self, run: _Run, request: ViewRequest) -> None:
        """Sends the paths of a dry run that the process does not have."""
        requested = request.dry_run
        if requested is None or requested.id not in self._paths or requested.id in run.dry_runs:
            return
        run.post(m.DryRunPaths(requested.id, self._paths[requested.id]))
        run.dry_runs[requested.id] = None
        while len(run.dry_runs) > m.MAX_DRY_RUNS:
            run.dry_runs.popitem(last=False)

    # --- for the next run -------------------------------------------------------------------------

    def _store_view(self, token: str, request: ViewRequest) -> None:
        earlier = self._views.get(token, ViewRequest())
        changes = {field: getattr(request, field) for field in request.model_fields_set}
        if request.vehicle not in (None, earlier.vehicle):
            changes = {"preview": None, **changes}
        self._views[token] = earlier.model_copy(update=changes)
        self._views.move_to_end(token)
        while len(self._views) > MAX_VIEWS:
            self._views.popitem(last=False)

    def _on_gizmo_moved(self, gizmo: SceneGizmo) -> None:
        view = self._views.get(gizmo.view)
        if view is not None and view.preview is not None:
            changes = {"position_ned_m": gizmo.position_ned_m, "yaw_ned_rad": gizmo.yaw_ned_rad}
            preview = view.preview.model_copy(update=changes)
            self._views[gizmo.view] = view.model_copy(update={"preview": preview})
        if self._on_gizmo is not None:
            self._on_gizmo(gizmo)

    def _restore_views(self, run: _Run) -> None:
        for token, request in self._views.items():
            try:
                self._send_dry_run(run, request)
            except GcsError:  # the dry run was dropped meanwhile
                request = request.model_copy(update={"dry_run": None})
            run.post(m.SetView(0, token, request))
