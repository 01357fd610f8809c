"""While a vehicle is disarmed, compiles the missions that begin when it is armed in their mode."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable

from gcs_server.clock import Clock
from gcs_server.errors import GcsError
from gcs_server.streamer.missions.mode_events import NOTICE, WARNING, add_event, with_remedy
from gcs_server.streamer.missions.mode_status import MissionAsMode
from gcs_server.streamer.missions.preparation import CompileInputs, Preparation
from gcs_server.streamer.missions.start import Start
from gcs_server.streamer.process.streams import Streams
from gcs_server.supervise import Supervisor
from gcs_server.vehicle.vehicle import Vehicle


class Preparer:
    """Compiles missions before arming, and reports to the stream process whether PX4 may arm.

    Args:
        clock: the server's clock.
        supervisor: runs the compilations.
        streams: replies to PX4's arming checks.
        prepare: compiles a mode's mission from the vehicle's current position, and checks it.
        inputs: the vehicle's position, yaw and settings with which a mission is compiled; None: no valid
            position.
    """

    def __init__(
        self,
        clock: Clock,
        supervisor: Supervisor,
        streams: Streams,
        prepare: Callable[[str, MissionAsMode], Awaitable[Start]],
        inputs: Callable[[str], CompileInputs | None],
    ) -> None:
        self._clock, self._supervisor, self._streams = clock, supervisor, streams
        self._prepare, self.inputs = prepare, inputs

    def update(self, vehicle: Vehicle, missions: Iterable[tuple[MissionAsMode, Preparation]]) -> None:
        """Compiles the missions that are not compiled for the vehicle's present position and settings; called
        periodically while the vehicle is disarmed."""
        missions = list(missions)
        inputs = self.inputs(vehicle.id) if missions else None
        for mode, preparation in missions:
            if preparation.update(self._clock.monotonic_s(), inputs):
                work = self._compile(vehicle, mode, preparation, inputs)
                self._supervisor.spawn(f"vehicle {vehicle.id}: mission mode", work)
            if preparation.ready != preparation.reported:
                preparation.reported = preparation.ready
                self._streams.set_mode_ready(vehicle.id, mode.name, preparation.ready)

    async def _compile(
        self, vehicle: Vehicle, mode: MissionAsMode, preparation: Preparation, inputs: CompileInputs | None
    ) -> None:
        previous_problem = preparation.problem
        try:
            start = await self._prepare(vehicle.id, mode)
        except GcsError as error:
            preparation.failed(with_remedy(error), self._clock.monotonic_s())
            if preparation.problem != previous_problem:
                text = (
                    f"The mission of the mode {mode.name!r} cannot begin here: {preparation.problem} "
                    "PX4 does not arm in this mode until the mission can begin."
                )
                add_event(vehicle, self._clock, mode.name, "not_ready", text, WARNING)
        else:
            preparation.succeeded(start, inputs, self._clock.monotonic_s())
            if previous_problem:
                text = f"The mission of the mode {mode.name!r} can begin here now."
                add_event(vehicle, self._clock, mode.name, "ready", text, NOTICE)
