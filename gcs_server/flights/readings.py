"""The state of a vehicle for the mission runner, from the vehicle's newest samples and setpoint stream."""

from __future__ import annotations

from gcs_server.errors import Refused
from gcs_server.streamer.offboard.control import OffboardControl
from gcs_server.streamer.offboard.estimates import VehicleEstimates
from gcs_server.streamer.schedule.scheduler import StreamState
from gcs_server.vehicle.samples import Battery, DistanceSensors, GlobalPosition, Gps, Wind
from gcs_server.vehicle.vehicle import Vehicle
from missions.avoidance.scans import LEVEL_MAX_SINE
from missions.runner.reading import Reading, StreamPhase
from missions.setpoints import Estimate

MAX_DISTANCE_AGE_S, MAX_WIND_AGE_S = 3.0, 10.0
"""Maximum age of these messages [s]; by default PX4 sends DISTANCE_SENSOR and WIND_COV every two seconds."""
RUNNER_PHASES: dict[str, StreamPhase] = {
    "idle": "idle", "starting": "starting", "streaming": "flying", "interrupted": "interrupted",
}  # fmt: skip
"""The runner's name of a stream's phase; all other phases are "ending"."""


def estimates_of(estimates: VehicleEstimates) -> frozenset[Estimate]:
    """The estimates that are valid and fresh."""
    valid_by_estimate: dict[Estimate, bool] = {
        "position": estimates.has_position(),
        "velocity": estimates.has_velocity(),
        "heading": estimates.has_attitude(),
        "global_position": estimates.origin() is not None,
        "home": estimates.home() is not None,
    }
    return frozenset(name for name, valid in valid_by_estimate.items() if valid)


def distance_m(vehicle: Vehicle) -> float | None:
    """Distance measured by the downward sensor [m]; without such a sensor, the shortest distance of all
    sensors. None: nothing is in range."""
    sample = vehicle.topic("distance_sensors")
    if sample is None or not isinstance(sample.value, DistanceSensors):
        return None
    if vehicle.clock.monotonic_s() - sample.received_monotonic_s > MAX_DISTANCE_AGE_S:
        return None
    down = [each for each in sample.value.sensors if each.direction_frd[2] > LEVEL_MAX_SINE]
    measured = (
        each.distance_m
        for each in down or sample.value.sensors
        if each.distance_m is not None and each.distance_m <= each.range_max_m
    )
    return min(measured, default=None)


def above_home_m(vehicle: Vehicle) -> float:
    """The vehicle's altitude above home [m].

    Raises:
        Refused: the vehicle does not report it.
    """
    sample = vehicle.topic("global_position")
    if sample is None or not isinstance(sample.value, GlobalPosition):
        raise Refused(
            f"Vehicle {vehicle.id} reports no altitude above home.",
            remedy="Wait for GPS and the estimator, then resume the mission.",
        )
    return sample.value.alt_home_m


def wind_speed_m_s(vehicle: Vehicle) -> float | None:
    """Estimated wind speed; None if the vehicle sends no fresh estimate."""
    sample = vehicle.topic("wind")
    if sample is None or not isinstance(sample.value, Wind):
        return None
    fresh = vehicle.clock.monotonic_s() - sample.received_monotonic_s <= MAX_WIND_AGE_S
    return sample.value.speed_m_s if fresh else None


def reported_values(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the condition values that the vehicle sends. A condition on any other value stays false."""
    battery, gps, sensors = (vehicle.topic(name) for name in ("battery", "gps", "distance_sensors"))
    is_reported = {
        "battery_share": battery is not None
        and isinstance(battery.value, Battery)
        and battery.value.remaining_percent is not None,
        "wind_speed_m_s": vehicle.topic("wind") is not None,
        "ground_speed_m_s": vehicle.topic("local_position") is not None,
        "distance_m": sensors is not None,
        "satellites": gps is not None and isinstance(gps.value, Gps) and gps.value.satellites is not None,
        "horizontal_error_m": vehicle.topic("estimator") is not None,
    }
    return tuple(name for name, reported in is_reported.items() if reported)


def vehicle_reading(vehicle: Vehicle) -> Reading:
    """The current state of a vehicle, without its setpoint stream."""
    estimates, status, cause = VehicleEstimates(vehicle), vehicle.status, vehicle.mode_cause
    local, attitude = estimates.local(), estimates.attitude()
    holder = None if vehicle.control is None else vehicle.control.status()
    battery, gps = vehicle.topic("battery"), vehicle.topic("gps")
    percent = battery.value.remaining_percent if battery and isinstance(battery.value, Battery) else None
    return Reading(
        mode=status.mode,
        mode_source=None if cause is None else cause.source,
        mode_text=None if cause is None else cause.text[:1].upper() + cause.text[1:],
        armed=status.armed,
        landed=status.landed_state,
        position_ned_m=None if local is None else local.position_ned_m,
        velocity_ned_m_s=None if local is None else local.velocity_ned_m_s,
        yaw_ned_rad=None if attitude is None else attitude.yaw_ned_rad,
        # a lost link does not mean that the estimates are lost
        estimates=None if attitude is None else estimates_of(estimates),
        link_active=not status.link_lost and bool(vehicle.endpoints),
        control_holder=None if holder is None else holder.holder_key,
        control_holder_name=None if holder is None else holder.holder,
        battery_share=None if percent is None else percent / 100.0,
        wind_speed_m_s=wind_speed_m_s(vehicle),
        distance_m=distance_m(vehicle),
        satellites=gps.value.satellites if gps and isinstance(gps.value, Gps) else None,
        horizontal_error_m=estimates.accuracy_m(),
    )


def stream_reading(control: OffboardControl, state: StreamState) -> Reading:
    """The current state of a vehicle with its setpoint stream.

    Args:
        control: the vehicle's setpoint stream.
        state: state of the stream. A stream that does not belong to the mission counts as idle.
    """
    flies_mission = state.request is not None and state.request.owner == "mission"
    return vehicle_reading(control.vehicle)._replace(
        stream=RUNNER_PHASES.get(state.phase, "ending") if flies_mission else "idle",
        stream_text=None if state.last_end is None else state.last_end.text,
        progress=state.progress if flies_mission else None,
    )
