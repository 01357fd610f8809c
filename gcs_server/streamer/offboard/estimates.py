"""The vehicle's estimates that a stream needs, from its newest samples."""

from __future__ import annotations

import math

from gcs_server.streamer.values.snapshot import Leader, Snapshot
from gcs_server.vehicle.mode_cause import MAV_SYS_STATUS_SENSOR_RC_RECEIVER
from gcs_server.vehicle.samples import (
    Attitude,
    Estimator,
    GlobalPosition,
    Health,
    Home,
    LocalPosition,
    TargetAttitude,
    TargetLocal,
)
from gcs_server.vehicle.scans import scans_of
from gcs_server.vehicle.vehicle import Vehicle
from missions.avoidance.scans import Scan
from missions.geodesy import LocalOrigin

MAX_ESTIMATE_AGE_S = 1.0
MAX_ACCURACY_AGE_S = 10.0
"""Maximum age of ESTIMATOR_STATUS [s]; PX4 sends it every one or two seconds."""
MAX_PAIR_DIFFERENCE_S = 0.3
"""Maximum difference between the reception times of a local and a global position that are used as a pair
[s]."""
# ESTIMATOR_STATUS_FLAGS
ATTITUDE, VELOCITY_HORIZONTAL, VELOCITY_VERTICAL = 1, 2, 4
POSITION_HORIZONTAL = 8 | 16
POSITION_VERTICAL = 32 | 64


class VehicleEstimates:
    """One vehicle's state for its stream; samples older than a second are ignored."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    def local(self) -> LocalPosition | None:
        """Local position and velocity, if fresh."""
        value = self._fresh("local_position")
        return value if isinstance(value, LocalPosition) else None

    def attitude(self) -> Attitude | None:
        """The attitude, if fresh."""
        value = self._fresh("attitude")
        return value if isinstance(value, Attitude) else None

    def global_position(self) -> GlobalPosition | None:
        """The global position, if fresh."""
        value = self._fresh("global_position")
        return value if isinstance(value, GlobalPosition) else None

    def home(self) -> Home | None:
        """Home position of any age, because PX4 sends it every two seconds and it rarely changes."""
        sample = self._vehicle.topic("home")
        return sample.value if sample is not None and isinstance(sample.value, Home) else None

    def target_local(self) -> tuple[TargetLocal, float] | None:
        """The position target that the vehicle reports, and its age [s]."""
        sample = self._vehicle.topic("target_local")
        if sample is None or not isinstance(sample.value, TargetLocal):
            return None
        return sample.value, self._age_s(sample.received_monotonic_s)

    def target_attitude(self) -> tuple[TargetAttitude, float] | None:
        """The attitude target that the vehicle reports, and its age [s]."""
        sample = self._vehicle.topic("target_attitude")
        if sample is None or not isinstance(sample.value, TargetAttitude):
            return None
        return sample.value, self._age_s(sample.received_monotonic_s)

    def has_any_flag(self, flags: int) -> bool:
        """Whether the estimator sets one of these flags. True if the vehicle sends no flags."""
        sample = self._vehicle.topic("estimator")
        return sample is None or not isinstance(sample.value, Estimator) or sample.value.flags & flags != 0

    def has_position(self) -> bool:
        """Whether the vehicle has a valid position estimate."""
        return (
            self.local() is not None
            and self.has_any_flag(POSITION_HORIZONTAL)
            and self.has_any_flag(POSITION_VERTICAL)
        )

    def has_velocity(self) -> bool:
        """Whether the vehicle has a valid velocity estimate."""
        return (
            self.local() is not None
            and self.has_any_flag(VELOCITY_HORIZONTAL)
            and self.has_any_flag(VELOCITY_VERTICAL)
        )

    def has_attitude(self) -> bool:
        """Whether the vehicle has a valid attitude estimate."""
        return self.attitude() is not None and self.has_any_flag(ATTITUDE)

    def accuracy_m(self) -> float | None:
        """Position accuracy: one sigma, the larger of horizontal and vertical [m]; None if unknown."""
        sample = self._vehicle.topic("estimator")
        if sample is None or not isinstance(sample.value, Estimator):
            return None
        accuracies_m = (sample.value.horizontal_accuracy_m, sample.value.vertical_accuracy_m)
        larger_m = max((each if each is not None else math.inf) for each in accuracies_m)
        stale = self._age_s(sample.received_monotonic_s) > MAX_ACCURACY_AGE_S
        return None if stale or not math.isfinite(larger_m) or larger_m < 0.0 else larger_m

    def scans(self) -> tuple[Scan, ...]:
        """Newest scans of the distance sensors; empty without an attitude, because the rays' directions
        are then unknown."""
        attitude = self.attitude()
        if attitude is None:
            return ()
        samples = (self._vehicle.topic("distance_sensors"), self._vehicle.topic("obstacle_distance"))
        return scans_of(samples, attitude.q_ned_frd, self._vehicle.clock.monotonic_s())

    def has_transmitter(self) -> bool:
        """Whether an RC transmitter is connected and healthy."""
        sample = self._vehicle.topic("health")
        if sample is None or not isinstance(sample.value, Health):
            return False
        health = sample.value
        return bool(health.sensors_present & health.sensors_healthy & MAV_SYS_STATUS_SENSOR_RC_RECEIVER)

    def origin(self) -> LocalOrigin | None:
        """Global position of the local frame's origin, computed from home, or else from the vehicle's
        position."""
        home = self.home()
        if home is not None and home.position_ned_m is not None:
            return LocalOrigin.from_position(home.lat_deg, home.lon_deg, home.alt_amsl_m, home.position_ned_m)
        local, position = self.local(), self.global_position()
        difference_s = abs(
            (self._received_s("local_position") or 0.0) - (self._received_s("global_position") or 0.0)
        )
        if local is None or position is None or difference_s > MAX_PAIR_DIFFERENCE_S:
            return None
        return LocalOrigin.from_position(
            position.lat_deg, position.lon_deg, position.alt_amsl_m, local.position_ned_m
        )

    def as_leader(self, origin: LocalOrigin | None) -> Leader | None:
        """State of this vehicle for a vehicle that follows it; None if a position is missing.

        Args:
            origin: origin of the following vehicle's local frame, in which the position is given.
        """
        position, received_s = self.global_position(), self._received_s("global_position")
        if position is None or received_s is None or origin is None or self._vehicle.status.link_lost:
            return None
        local, attitude = self.local(), self.attitude()
        return Leader(
            origin.to_ned(position.lat_deg, position.lon_deg, position.alt_amsl_m),
            position.velocity_ned_m_s if local is None else local.velocity_ned_m_s,
            None if attitude is None else attitude.yaw_ned_rad,
            received_s,
        )

    def snapshot(self, **values: object) -> Snapshot:
        """Snapshot of the vehicle for its stream; `values` are further fields of `Snapshot`."""
        vehicle, local, attitude = self._vehicle, self.local(), self.attitude()
        status, home = vehicle.status, self.home()
        command = vehicle.command.recent_command(status.mode)
        has_horizontal_position = local is not None and self.has_any_flag(POSITION_HORIZONTAL)
        return Snapshot(
            vehicle.clock.monotonic_s(),
            status.mode,
            local.position_ned_m if local is not None and has_horizontal_position else None,
            local.velocity_ned_m_s if local is not None else None,
            attitude.yaw_ned_rad if attitude is not None else None,
            None if command is None else f"{command.by or 'The server'} commanded {command.label!r}",
            estimate_s=self._received_s("local_position") if has_horizontal_position else None,
            armed=status.armed,
            failsafe=vehicle.in_failsafe,
            lost=status.link_lost or not vehicle.endpoints,
            home_alt_amsl_m=None if home is None else home.alt_amsl_m,
            accuracy_m=self.accuracy_m(),
            scans=self.scans(),
            **values,  # type: ignore[arg-type]
        )

    def _received_s(self, topic: str) -> float | None:
        sample = self._vehicle.topic(topic)
        return None if sample is None else sample.received_monotonic_s

    def _age_s(self, received_s: float) -> float:
        return max(0.0, self._vehicle.clock.monotonic_s() - received_s)

    def _fresh(self, topic: str) -> object | None:
        sample = self._vehicle.topic(topic)
        if sample is None or self._age_s(sample.received_monotonic_s) > MAX_ESTIMATE_AGE_S:
            return None
        return sample.value
