"""The same client for programs without an event loop: `with SyncGcs() as gcs`.

Each call runs the asynchronous call in an event loop on a separate thread, and waits for its result.
Made by tools/build_sync_client.py from the asynchronous client: change that, then run `make types`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from anyio.from_thread import BlockingPortal

from gcs_server.client import (
    dry_runs,
    mission_modes,
    operations,
    plans,
)
from gcs_server.client.dry_runs import RUN_TIMEOUT_S
from gcs_server.client.plans import Plan
from gcs_server.client.setpoints import Body


class SyncDryRuns:
    """Dry runs of the server; they command no vehicle."""

    def __init__(self, inner: dry_runs.DryRuns, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def start(
        self,
        plan: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        vehicle_id: str | None = None,
        flights: int | None = None,
        settings: Body | None = None,
    ) -> dict[str, Any]:
        """Starts a dry run and returns its operation.

        Args:
            plan: the document of a waypoint plan or an offboard mission.
            plan_id: id of a stored plan, instead of `plan`.
            version: version of the stored plan; default: the newest.
            vehicle_id: the vehicle whose parameters, position and battery charge are used.
            flights: number of additional flights in varied conditions (Monte Carlo).
            settings: `conditions`, `spread`, `obstacles`, `seed`, `endurance_s`, `battery_reserve`;
                `vehicles` by role, for a mission of several vehicles.
        """
        return self._portal.call(
            lambda: self._inner.start(
                plan,
                plan_id=plan_id,
                version=version,
                vehicle_id=vehicle_id,
                flights=flights,
                settings=settings,
            )
        )

    def get(self, dry_run_id: str) -> dict[str, Any]:
        """The result of a dry run: `nominal` (path, steps, findings, …) and `monte_carlo`."""
        return self._portal.call(lambda: self._inner.get(dry_run_id))

    def run(
        self,
        plan: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        vehicle_id: str | None = None,
        flights: int | None = None,
        settings: Body | None = None,
        timeout_s: float = RUN_TIMEOUT_S,
    ) -> dict[str, Any]:
        """Starts a dry run as `start` does, waits for its end, and returns the result.

        Raises:
            ApiError: the dry run failed; the error contains the reason.
            Timeout: the dry run is still running, and continues without this program.
        """
        return self._portal.call(
            lambda: self._inner.run(
                plan,
                plan_id=plan_id,
                version=version,
                vehicle_id=vehicle_id,
                flights=flights,
                settings=settings,
                timeout_s=timeout_s,
            )
        )


class SyncMissionModes:
    """The offboard missions that this server has registered as flight modes of a vehicle.

    The server must be connected to the vehicle over ROS 2. `vehicle.set_mode(mode["mode"])`, another ground
    station or an RC transmitter selects a mode. A mission that begins with a take-off starts when the vehicle
    is armed in the mode; any other mission starts when the mode is selected in the air. The server
    unregisters its modes when it is shut down.
    """

    def __init__(self, inner: mission_modes.MissionModes, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def all(self) -> list[dict[str, Any]]:
        """The modes: `name`, `state`, `mode` (as in the vehicle's status), `mission`, …"""
        return self._portal.call(lambda: self._inner.all())

    def register(
        self,
        name: str,
        mission: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        despite: Sequence[str] = (),
        defer_failsafes_s: int = 0,
    ) -> dict[str, Any]:
        """Registers a mission (a document, or one stored on the server) under this name; returns the mode
        once PX4 can select it.

        With `defer_failsafes_s` PX4 defers its reaction to a lost ground station connection, lost manual
        control or a low battery by up to this time, while the vehicle flies in the mode.

        Raises:
            Refused: the server has no ROS 2 connection to the vehicle, PX4 refuses the mode, the mission has
                errors that `despite` does not list, or the vehicle has a mode of this name.
        """
        return self._portal.call(
            lambda: self._inner.register(
                name,
                mission,
                plan_id=plan_id,
                version=version,
                despite=despite,
                defer_failsafes_s=defer_failsafes_s,
            )
        )

    def unregister(self, name: str) -> list[dict[str, Any]]:
        """Removes a mode; returns the remaining modes.

        Raises:
            Refused: there is no such mode, or the vehicle flies in it.
        """
        return self._portal.call(lambda: self._inner.unregister(name))


class SyncOperations:
    """The server's operations, running or recently ended, each in the form of `GET /operations/{o}`."""

    def __init__(self, inner: operations.Operations, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def all(self, vehicle_id: str | None = None) -> list[dict[str, Any]]:
        """The operations of one vehicle, or all; oldest first."""
        return self._portal.call(lambda: self._inner.all(vehicle_id))

    def get(self, operation_id: str) -> dict[str, Any]:
        """One operation: `state`, `progress`, `text`, and at the end `result` or `error`."""
        return self._portal.call(lambda: self._inner.get(operation_id))

    def wait(self, operation_id: str, *, timeout_s: float = 60.0) -> dict[str, Any]:
        """Waits for the end and returns the operation; its `state` is `succeeded` or `cancelled`.

        Raises:
            ApiError: the operation failed; the error contains the reason.
            Timeout: the operation is still running, and continues without this program.
        """
        return self._portal.call(lambda: self._inner.wait(operation_id, timeout_s=timeout_s))

    def cancel(self, operation_id: str) -> dict[str, Any]:
        """Cancels an operation and returns its final state; an ended operation is not changed."""
        return self._portal.call(lambda: self._inner.cancel(operation_id))


class SyncPlans:
    """The plans of the server, each in the form of `GET /plans/{plan}`: `id`, `version`, `plan`, …"""

    def __init__(self, inner: plans.Plans, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def all(self) -> list[dict[str, Any]]:
        """The newest version of each plan, by name, without the documents."""
        return self._portal.call(lambda: self._inner.all())

    def get(self, plan_id: str, version: int | None = None) -> dict[str, Any]:
        """A plan with its document; default: the newest version."""
        return self._portal.call(lambda: self._inner.get(plan_id, version))

    def versions(self, plan_id: str) -> list[dict[str, Any]]:
        """The stored versions of a plan, newest first."""
        return self._portal.call(lambda: self._inner.versions(plan_id))

    def create(self, name: str, plan: Plan) -> dict[str, Any]:
        """Stores a new plan."""
        return self._portal.call(lambda: self._inner.create(name, plan))

    def save(self, plan_id: str, name: str, plan: Plan, *, base_version: int) -> dict[str, Any]:
        """Adds a version, based on `base_version`.

        Raises:
            Refused: another client has saved a newer version (`conflict`); nothing is overwritten.
        """
        return self._portal.call(lambda: self._inner.save(plan_id, name, plan, base_version=base_version))

    def delete(self, plan_id: str, *, base_version: int) -> None:
        """Deletes a plan with all its versions; raises the same errors as `save`."""
        self._portal.call(lambda: self._inner.delete(plan_id, base_version=base_version))

    def check(
        self, plan: Plan, *, vehicle_id: str | None = None, power: Mapping[str, float] | None = None
    ) -> dict[str, Any]:
        """Checks a plan: `findings` and `estimates`, and for an offboard mission `flight` with its path and
        the duration of each step.

        With `vehicle_id`, the vehicle's parameters and home are used if they are known. With `power`
        (`hover_power_w`, `battery_wh`, `mass_kg`), the energy is checked as well.
        """
        return self._portal.call(lambda: self._inner.check(plan, vehicle_id=vehicle_id, power=power))

    def convert(self, plan: Plan, name: str, *, vehicle_id: str | None = None) -> dict[str, Any]:
        """Converts a waypoint plan to an offboard mission: `plan` and `notes`. Saves nothing."""
        return self._portal.call(lambda: self._inner.convert(plan, name, vehicle_id=vehicle_id))

    def insert(
        self,
        plan: Plan,
        at: Sequence[str | int],
        *,
        plan_id: str | None = None,
        version: int | None = None,
        mission: Plan | None = None,
        in_air: bool = False,
        positions: str | None = None,
    ) -> dict[str, Any]:
        """Inserts a stored offboard mission (`plan_id`) or the document `mission` into the offboard mission
        `plan`. Returns the result as `plan`, the name of the `called` list, and `notes`; saves nothing.

        `at` is the place of the new call step, such as `["steps", 2]`. With `in_air`, the inserted take-off
        and last landing are left out. If the planned starts differ, `positions` states whether positions
        relative to start or home refer to the start of `plan` ("from_start"), or are converted so that they
        stay at the same places ("same_places").
        """
        return self._portal.call(
            lambda: self._inner.insert(
                plan,
                at,
                plan_id=plan_id,
                version=version,
                mission=mission,
                in_air=in_air,
                positions=positions,
            )
        )

    def follow_ground(self, plan: Plan, *, tolerance_m: float | None = None) -> dict[str, Any]:
        """Converts a waypoint plan's altitudes above the ground to AMSL with the elevation files. Returns
        `plan`; saves nothing.

        With `tolerance_m`, waypoints are added until the height above the ground is within this tolerance.
        """
        return self._portal.call(lambda: self._inner.follow_ground(plan, tolerance_m=tolerance_m))

    def elevation_files(self) -> dict[str, Any]:
        """The server's elevation files (`files`), their `folder`, and the files that cannot be used
        (`unreadable`).
        """
        return self._portal.call(lambda: self._inner.elevation_files())

    def schema(self, kind: str = "offboard_mission") -> dict[str, Any]:
        """The JSON Schema of `offboard_mission` or `waypoint_plan` documents."""
        return self._portal.call(lambda: self._inner.schema(kind))

    def read_file(self, data: bytes, filename: str = "", **altitude: str | float) -> dict[str, Any]:
        """Converts a file to a plan (`plan`, `areas`, `notes`); saves nothing.

        Points without an altitude get `altitude_m` with `altitude_reference`. Altitudes in a file that does
        not state their reference get `altitude_reference`. A file for which one of them is missing is refused
        (`field` of the error).
        """
        return self._portal.call(lambda: self._inner.read_file(data, filename, **altitude))

    def read_table(self, data: bytes, filename: str = "") -> dict[str, Any]:
        """Converts a trajectory from a CSV or NumPy file (.npy) to CSV `text` for `tables` of an offboard
        mission, with a `name`; saves nothing.
        """
        return self._portal.call(lambda: self._inner.read_table(data, filename))

    def write_file(self, plan: Plan, format: str) -> bytes:
        """Converts a plan to a file. Formats of waypoint plans: `json`, `plan`, `waypoints`, `csv`,
        `geojson`, `kml`, `kmz`; of offboard missions: `yaml`, `json`.
        """
        return self._portal.call(lambda: self._inner.write_file(plan, format))

    def pattern(
        self,
        kind: str,
        *,
        document: str = "waypoint_plan",
        vehicle_id: str | None = None,
        tolerance_m: float | None = None,
        **fields: Any,
    ) -> dict[str, Any]:
        """Generates a survey, corridor, perimeter, orbit or structure scan: `plan`, `lines`, `path`,
        `figures`, `notes`. Saves nothing.

        `plan` is a waypoint plan with the items, or with `document="offboard_mission"` a mission with the
        steps; the steps begin in the air, so insert them after a take-off. With `vehicle_id`, the vehicle's
        parameters are used. With `tolerance_m`, altitudes above the ground are converted, as in
        `follow_ground`.
        """
        return self._portal.call(
            lambda: self._inner.pattern(
                kind, document=document, vehicle_id=vehicle_id, tolerance_m=tolerance_m, **fields
            )
        )
