"""Creates the snapshots of one vehicle for its stream."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from gcs_server.clock import Clock
from gcs_server.errors import GcsError
from gcs_server.streamer.frames import follow_offset_ned_m
from gcs_server.streamer.offboard.avoidance import AvoidanceControl
from gcs_server.streamer.offboard.configuration import OffboardConfiguration
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.offboard.limit_store import VehicleOperatorLimits
from gcs_server.streamer.values.limit_values import UNBOUNDED, Bounds, bounds_of, vehicle_limits
from gcs_server.streamer.values.snapshot import Leader, Snapshot
from gcs_server.streamer.values.stream_request import StreamRequest
from gcs_server.vehicle.endpoint import ROS2, protocol_in_use
from gcs_server.vehicle.vehicle import Vehicle
from missions.setpoints import Follow

FindVehicle = Callable[[str], Vehicle]


class VehicleSnapshots:
    """Snapshots of one vehicle.

    Args:
        clock: the server's clock.
        vehicle: the vehicle.
        estimates: the vehicle's estimates.
        configuration: the vehicle's parameters.
        operator: the operator's limits.
        avoidance: the settings of obstacle avoidance.
        find: finds other vehicles by id, for following them; raises UnknownVehicle.
    """

    def __init__(
        self,
        clock: Clock,
        vehicle: Vehicle,
        estimates: VehicleEstimates,
        configuration: OffboardConfiguration,
        operator: VehicleOperatorLimits,
        avoidance: AvoidanceControl,
        find: FindVehicle,
    ) -> None:
        self._clock = clock
        self._vehicle = vehicle
        self._estimates = estimates
        self._configuration = configuration
        self._operator = operator
        self._avoidance = avoidance
        self._find = find
        self._bounds = UNBOUNDED
        self._bounds_sources: tuple[object, ...] = ()

    def make(self, request: StreamRequest | None) -> Snapshot:
        """The current state of the vehicle, for a stream that flies this request."""
        attitude = self._estimates.attitude()
        return self._estimates.snapshot(
            q_ned_frd=None if attitude is None else attitude.q_ned_frd,
            bounds=self._current_bounds(),
            local_only=protocol_in_use(self._vehicle.endpoints, ROS2) == ROS2,
            hover_thrust=self._configuration.parameters().get("MPC_THR_HOVER"),
            leader=self.leader(request.setpoint)
            if request and isinstance(request.setpoint, Follow)
            else None,
            avoidance=self._avoidance.way,
            mission_avoidance=self._avoidance.mission_way,
        )

    def without_estimates(self) -> Snapshot:
        """A snapshot from the heartbeat and the previous limits only, used if `make` fails."""
        status = self._vehicle.status
        return Snapshot(
            self._clock.monotonic_s(),
            status.mode,
            None,
            None,
            None,
            armed=status.armed,
            lost=status.link_lost or not self._vehicle.endpoints,
            bounds=self._bounds,
        )

    def leader(self, follow: Follow) -> Leader | None:
        """The followed vehicle in this vehicle's frame; None if that vehicle is unknown or has no
        position."""
        try:
            leader = self._find(follow.vehicle)
        except GcsError:
            return None
        origin = self._estimates.origin()
        state = VehicleEstimates(leader).as_leader(origin)
        offset = None if state is None else follow_offset_ned_m(follow, state)
        if state is None or offset is None or origin is None:
            return state
        north, east, down = (a + b for a, b in zip(state.position_ned_m, offset, strict=True))
        lat_deg, lon_deg, _ = origin.to_geodetic((north, east, down))
        lowest_amsl_m = self._vehicle.command.floor.now().lowest_amsl_m(lat_deg, lon_deg)
        return (
            state
            if lowest_amsl_m is None
            else replace(state, lowest_down_m=origin.alt_amsl_m - lowest_amsl_m)
        )

    def _current_bounds(self) -> Bounds:
        """The bounds of the setpoints; recomputed only if a source has changed."""
        sources = (
            self._configuration.parameters(),
            self._operator.limits,
            self._estimates.home(),
            self._estimates.origin(),
        )
        if sources != self._bounds_sources:
            parameters, operator, home, origin = sources
            gains = (parameters.get("MPC_XY_P"), parameters.get("MPC_Z_P"))
            self._bounds = bounds_of(vehicle_limits(parameters), operator, home, origin, gains)
            self._bounds_sources = sources
        return self._bounds
