"""The parts that fly plans, which the use cases of this package work on."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from gcs_server.clock import Clock
from gcs_server.flights.futures import FuturesWork
from gcs_server.flights.groups import Groups
from gcs_server.flights.mission_modes import MissionModes
from gcs_server.flights.mission_start import compile_inputs_of, prepare_mode
from gcs_server.flights.missions import OffboardMissions
from gcs_server.flights.preparation import Preparer
from gcs_server.flights.proofs import Proofs
from gcs_server.flights.resume import ProgressStore
from gcs_server.flights.vehicle_models import VehicleModels
from gcs_server.flights.waypoint_flights import WaypointFlights
from gcs_server.operations.operations import Operations
from gcs_server.plans.dry_runs import DryRuns
from gcs_server.plans.known_ground import KnownGround
from gcs_server.plans.store import PlanStore
from gcs_server.plans.work import PlanWork
from gcs_server.streamer.offboard.control import OffboardControl
from gcs_server.streamer.offboard.streamer import StopResult, Streamer
from gcs_server.streamer.process.streams import Streams
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.fleet import Fleet
from gcs_server.vehicle.vehicle import Vehicle


class Flights:
    """All parts that fly plans.

    Args:
        clock: the server's clock.
        fleet: the vehicles.
        streamer: the setpoint control of all vehicles; must have been attached to the fleet before.
        streams: the streams in the stream process.
        supervisor: runs background tasks.
        operations: the operations of the server.
        plans: the stored plans.
        plan_work: runs tasks on plans.
        progress: how far each vehicle has flown its plan; None: only in memory.
        models: models of vehicles that were found in flights; None: only in memory.
        in_control: returns whether the client with a key controls a vehicle; its futures come first.
    """

    def __init__(
        self,
        clock: Clock,
        fleet: Fleet,
        streamer: Streamer,
        streams: Streams,
        supervisor: Supervisor,
        operations: Operations,
        plans: PlanStore,
        plan_work: PlanWork,
        progress: ProgressStore | None = None,
        models: VehicleModels | None = None,
        in_control: Callable[[str], bool] = lambda _: False,
    ) -> None:
        self._supervisor, self._streamer = supervisor, streamer
        self.fleet, self.operations, self.plans, self.plan_work = fleet, operations, plans, plan_work
        self.dry_runs = DryRuns()
        self.proofs = Proofs()
        self.futures = FuturesWork(in_control)
        self.known_ground = KnownGround(clock, fleet, plan_work)
        self.groups = Groups(clock, streams, fleet.events, streamer.offboard)
        self.missions = OffboardMissions(clock, streamer, streams, self.groups, supervisor)
        prepare, inputs = partial(prepare_mode, self), partial(compile_inputs_of, self)
        preparer = Preparer(clock, supervisor, streams, prepare, inputs)
        self.mission_modes = MissionModes(clock, streamer, streams, self.missions, supervisor, preparer)
        self.progress = progress or ProgressStore()
        self.models = models or VehicleModels()
        self.waypoint_flights = WaypointFlights(clock, supervisor, self.progress)

    def attach(self, vehicle: Vehicle) -> None:
        """Called when a vehicle was added, after `Streamer.attach`."""
        self.missions.attach(vehicle)
        self.waypoint_flights.attach(vehicle)

    def detach(self, vehicle: Vehicle) -> None:
        """Called when a vehicle is removed, before `Streamer.detach`."""
        self.waypoint_flights.detach(vehicle)
        self.missions.detach(vehicle)
        self.mission_modes.detach(vehicle)

    def offboard(self, vehicle_id: str) -> OffboardControl:
        """A vehicle's setpoint stream. Raises UnknownVehicle."""
        return self._streamer.offboard(self.fleet.get(vehicle_id).id)

    async def load(self) -> None:
        """Reads the stored progress of the flights, and the models of vehicles."""
        await self.progress.load()
        await self.models.load()

    def start(self) -> None:
        """Starts the periodic updates."""
        self.groups.start_updates(self._supervisor)
        self.missions.start()
        self.waypoint_flights.start()
        self.mission_modes.start()
        self._supervisor.start("known ground", self.known_ground.watch)

    async def stop_streams(self) -> list[StopResult]:
        """Puts all vehicles with a stream into Hold, for a clean shutdown."""
        self.groups.disable_guards()
        return await self._streamer.stop_all()

    def close(self) -> None:
        """Ends plan work and futures, and waits for pending writes of plans."""
        self.plans.close()
        self.plan_work.close()
        self.futures.close()
