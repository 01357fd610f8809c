"""Random flights with one random fault each, flown together in one fleet, and the errors of their estimates.

The kinds of faults, and their ranges of errors divided by stated accuracies, come from recorded faults of a
real PX4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from vehicle_sim.control.setpoints import ControlLevel
from vehicle_sim.geodesy import to_local
from vehicle_sim.sensors.suite import Driver
from vehicle_sim.simulation import Simulation

SETTLED_S = 8.0
"""Time of the faults: the estimates have settled."""
AIRBORNE_AT_S = 1.0
"""From this time the test reports the vehicles as airborne, in place of the land detector."""
CHECK_EVERY_STEPS = 10
"""Simulation steps from one check to the next: the estimator publishes at this interval."""
GPS_DISPLACEMENT_M = 30.0
NEW_SETPOINTS_EVERY_S = 3.0
EVALUATED_AFTER_S = 1.0
FLYING_ABOVE_M = 1.0
DESCENT_M_S = 0.7


@dataclass(frozen=True, slots=True)
class FaultKind:
    """A kind of fault, and a real PX4's largest ratios of error to stated accuracy, 1 to 20 s after the
    fault."""

    inject: Callable[[Simulation, int, np.random.Generator], None]
    aided: bool | None
    """Whether GNSS still aids the estimate after the fault; None: this depends on the random flight."""
    horizontal_ratios: tuple[float, float]
    """Smallest and largest horizontal ratio of the recorded flights."""
    vertical_ratios: tuple[float, float]
    tolerance: float = 1.1
    """Nine of ten flights have ratios below this factor times the upper value of `horizontal_ratios` and
    `vertical_ratios`. The factor is greater for faults whose random flights differ from the recorded
    flights."""


def _set_parameter(sim: Simulation, row: int, name: str, value: float) -> None:
    sim.parameters[row].set(name, value)
    sim.reload_parameters(row)


def _reduce_satellites(sim: Simulation, row: int, random: np.random.Generator) -> None:
    _set_parameter(sim, row, "SIM_GPS_USED", int(random.integers(0, 6)))


def _remove_fix(sim: Simulation, row: int, _: np.random.Generator) -> None:
    _set_parameter(sim, row, "SIM_GPS_USED", 3)


def _stop(driver: Driver) -> Callable[[Simulation, int, np.random.Generator], None]:
    return lambda sim, row, _: sim.set_driver(row, driver, False)


def _freeze(driver: Driver) -> Callable[[Simulation, int, np.random.Generator], None]:
    return lambda sim, row, _: sim.sensor_faults.stuck[driver].__setitem__(row, True)


def _displace_gps(sim: Simulation, row: int, random: np.random.Generator) -> None:
    azimuth = random.uniform(-np.pi, np.pi)
    sim.set_gps_offset(row, GPS_DISPLACEMENT_M * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))


def _pressure_step(sim: Simulation, row: int, random: np.random.Generator) -> None:
    _set_parameter(sim, row, "SIM_BARO_OFF_P", float(random.choice([-1, 1]) * random.uniform(20.0, 1500.0)))


def _magnetic_field_step(sim: Simulation, row: int, random: np.random.Generator) -> None:
    _set_parameter(sim, row, f"SIM_MAG_OFFSET_{random.choice(list('XYZ'))}", float(random.uniform(-0.5, 0.5)))


def _wind_step(sim: Simulation, row: int, random: np.random.Generator) -> None:
    azimuth = random.uniform(-np.pi, np.pi)
    sim.set_wind(random.uniform(3.0, 10.0) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), row)


def _accelerometer_offset(sim: Simulation, row: int, random: np.random.Generator) -> None:
    sim.sensor_faults.set_imu_offset(row, np.zeros(3), np.array([0.0, 0.0, random.uniform(1.0, 2.0)]))


TEMPORARY_GPS_LOSS = "temporary GPS loss"
UNAFFECTED_HORIZONTAL, UNAFFECTED_VERTICAL = (0.4, 2.1), (0.4, 3.4)
"""Ranges of the ratios in recorded flights whose fault affects neither position nor altitude."""
DIVERGING = (103.0, 413.0), (19.6, 46.7)
"""With a frozen fix the position control has no feedback, and the speed of the divergence is random: the
horizontal ratio of the four recorded flights was 103 to 289 after 20 s, and at least 413 at their end."""
RECORDED_HEIGHT_M = 10.0
"""Height of the recorded flights with a frozen fix, which kept one setpoint. The height limits the vertical
error that is possible before the vehicle hits the ground."""
STUCK_GPS = "stuck GPS"
DIVERGING_TOLERANCE = 1.5
"""A vehicle whose setpoint changes while its fix is frozen diverges faster than the recorded vehicles."""
TILTED_HORIZONTAL, TILTED_TOLERANCE = (0.4, 2.7), 1.3
"""The recorded vehicles hovered. These vehicles tilt, so that the offset of the accelerometer's z axis also
has a horizontal component."""
SHORT_LOSS_TOLERANCE = 1.3
"""Some of the random GPS losses are shorter than the recorded losses and cause smaller errors."""
FAULT_KINDS = {
    TEMPORARY_GPS_LOSS: FaultKind(_remove_fix, None, (1.0, 3.6), (0.4, 4.6), SHORT_LOSS_TOLERANCE),
    "few satellites": FaultKind(_reduce_satellites, False, (1.0, 3.6), (0.4, 4.6)),
    "silent GPS": FaultKind(_stop(Driver.GPS), False, (1.0, 3.6), (0.4, 4.6)),
    STUCK_GPS: FaultKind(_freeze(Driver.GPS), None, *DIVERGING, DIVERGING_TOLERANCE),
    "displaced GPS": FaultKind(_displace_gps, True, (100.0, 100.2), UNAFFECTED_VERTICAL),
    "pressure step": FaultKind(_pressure_step, True, UNAFFECTED_HORIZONTAL, (0.4, 7.5)),
    "silent barometer": FaultKind(_stop(Driver.BARO), True, UNAFFECTED_HORIZONTAL, UNAFFECTED_VERTICAL),
    "stuck barometer": FaultKind(_freeze(Driver.BARO), True, UNAFFECTED_HORIZONTAL, UNAFFECTED_VERTICAL),
    "field step": FaultKind(_magnetic_field_step, True, UNAFFECTED_HORIZONTAL, UNAFFECTED_VERTICAL),
    "silent compass": FaultKind(_stop(Driver.MAG), True, UNAFFECTED_HORIZONTAL, UNAFFECTED_VERTICAL),
    "wind step": FaultKind(_wind_step, True, UNAFFECTED_HORIZONTAL, UNAFFECTED_VERTICAL),
    "lifted accelerometer": FaultKind(
        _accelerometer_offset, True, TILTED_HORIZONTAL, (19.8, 20.5), TILTED_TOLERANCE
    ),
}


@dataclass(slots=True)
class FaultFlight:
    """The estimate of one vehicle after its fault: its validity and its errors."""

    kind: str
    fixes_s: list[float]
    """Times of the GPS fixes after the fault [s]; the same for all vehicles."""
    gps_returns_s: float
    """Time after the fault at which a lost GPS returns."""
    origin_ned_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """(3,) origin of the estimate's local frame, relative to the world's origin."""
    invalid_at_s: list[float] = field(default_factory=list)
    valid_at_s: list[float] = field(default_factory=list)
    dead_reckoning_at_s: list[float] = field(default_factory=list)
    aided_again_at_s: list[float] = field(default_factory=list)
    """Ends of the periods of dead reckoning; the last period may have none."""
    horizontal_ratio: float = 0.0
    """Largest ratio of error to stated accuracy while the vehicle flew."""
    vertical_ratio: float = 0.0


def fly_with_random_faults(count: int, seed: int, seconds: float) -> list[FaultFlight]:
    """Flies random setpoints with one fault for each vehicle.

    Raises:
        AssertionError: an estimate is not finite.
    """
    random = np.random.default_rng(seed)
    sim = Simulation(count, seed=seed, start_ned_m=np.zeros((count, 3)))
    fixes_s: list[float] = []
    kinds = list(FAULT_KINDS)
    flights = [
        FaultFlight(kinds[row % len(kinds)], fixes_s, float(random.uniform(0.5, 1.5 * seconds)))
        for row in range(count)
    ]
    sim.setpoints.armed[:] = True
    sim.setpoints.level[:] = ControlLevel.TRAJECTORY
    fault_step = round(SETTLED_S / sim.dt_s)
    has_stuck_gps = np.array([flight.kind == STUCK_GPS for flight in flights])
    valid, dead_reckoning = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    flying = np.ones(count, dtype=bool)
    for step in range(fault_step + round(seconds / sim.dt_s)):
        if step % round(NEW_SETPOINTS_EVERY_S / sim.dt_s) == 0:
            _set_new_setpoints(sim, random, has_stuck_gps, has_stuck_gps & (step > 0))
        if step == round(AIRBORNE_AT_S / sim.dt_s):
            sim.setpoints.in_air[:] = True
        if step == fault_step:
            assert sim.estimate.valid_position.all()
            for row, flight in enumerate(flights):
                flight.origin_ned_m = _origin(sim, row)
                FAULT_KINDS[flight.kind].inject(sim, row, random)
        for row, flight in enumerate(flights):
            if flight.kind == TEMPORARY_GPS_LOSS and step == fault_step + round(
                flight.gps_returns_s / sim.dt_s
            ):
                _set_parameter(sim, row, "SIM_GPS_USED", 10)
        old_fix_count = sim.sensors.gps_count
        sim.step()
        if sim.sensors.gps_count != old_fix_count:
            fixes_s.append((step - fault_step) * sim.dt_s)
        if step < fault_step or step % CHECK_EVERY_STEPS:
            continue
        now_s = (step - fault_step) * sim.dt_s
        estimate = sim.estimate
        for row in np.flatnonzero(estimate.valid_position != valid):
            changes = flights[row].invalid_at_s if valid[row] else flights[row].valid_at_s
            changes.append(now_s)
        for row in np.flatnonzero(sim.fusion.dead_reckoning != dead_reckoning):
            changes = (
                flights[row].aided_again_at_s if dead_reckoning[row] else flights[row].dead_reckoning_at_s
            )
            changes.append(now_s)
        valid, dead_reckoning = estimate.valid_position.copy(), sim.fusion.dead_reckoning.copy()
        _descend(sim, ~valid)
        flying &= sim.truth.position_ned_m[:, 2] < -FLYING_ABOVE_M
        _update_ratios(sim, flights, flying if now_s >= EVALUATED_AFTER_S else np.zeros(count, dtype=bool))
    return flights


def _origin(sim: Simulation, row: int) -> np.ndarray:
    """(3,) vector from the world's origin to the origin of the estimate."""
    estimate, home = sim.estimate, sim.origin
    north, east = to_local(
        estimate.origin_lat_deg[row], estimate.origin_lon_deg[row],
        np.asarray(home.lat_deg), np.asarray(home.lon_deg),
    )  # fmt: skip
    return np.array([float(north), float(east), home.alt_amsl_m - float(estimate.origin_alt_amsl_m[row])])


def _update_ratios(sim: Simulation, flights: list[FaultFlight], flying: np.ndarray) -> None:
    estimate, truth = sim.estimate, sim.truth
    estimated_values = (
        estimate.position_ned_m, estimate.velocity_ned_m_s, estimate.q_ned_frd,
        estimate.horizontal_accuracy_m, estimate.vertical_accuracy_m, estimate.speed_accuracy_m_s,
    )  # fmt: skip
    assert all(np.isfinite(values).all() for values in estimated_values)
    error = estimate.position_ned_m - truth.position_ned_m + [flight.origin_ned_m for flight in flights]
    horizontal = np.hypot(error[:, 0], error[:, 1]) / estimate.horizontal_accuracy_m
    vertical = np.abs(error[:, 2]) / estimate.vertical_accuracy_m
    for row in np.flatnonzero(flying):
        flight = flights[row]
        flight.horizontal_ratio = max(flight.horizontal_ratio, float(horizontal[row]))
        flight.vertical_ratio = max(flight.vertical_ratio, float(vertical[row]))


def _set_new_setpoints(
    sim: Simulation, random: np.random.Generator, at_recorded_height: np.ndarray, keeps_old: np.ndarray
) -> None:
    """Sets new setpoints at a height of 15 to 25 m: a nearby position or a velocity, each for half of the
    vehicles.

    Args:
        sim: the fleet.
        random: source of the setpoints.
        at_recorded_height: (N,) vehicles that fly at RECORDED_HEIGHT_M.
        keeps_old: (N,) vehicles that keep their setpoints.
    """
    count, setpoints = sim.count, sim.setpoints
    old_position, old_velocity = setpoints.position_ned_m[keeps_old], setpoints.velocity_ned_m_s[keeps_old]
    has_position_setpoint = random.random(count) < 0.5
    near_position_m = sim.estimate.position_ned_m[:, :2] + random.uniform(-8.0, 8.0, (count, 2))
    setpoints.position_ned_m[:, :2] = np.where(has_position_setpoint[:, None], near_position_m, np.nan)
    setpoints.position_ned_m[:, 2] = np.where(
        at_recorded_height, -RECORDED_HEIGHT_M, random.uniform(-25.0, -15.0, count)
    )
    velocity = random.uniform(-3.0, 3.0, (count, 2))
    setpoints.velocity_ned_m_s[:, :2] = np.where(has_position_setpoint[:, None], np.nan, velocity)
    setpoints.position_ned_m[keeps_old], setpoints.velocity_ned_m_s[keeps_old] = old_position, old_velocity
    yaw = random.uniform(-np.pi, np.pi, count)
    np.copyto(setpoints.yaw_ned_rad, yaw, where=sim.estimate.valid_position & ~keeps_old)


def _descend(sim: Simulation, vehicles: np.ndarray) -> None:
    """Sets a level descent for these vehicles (N,), which have no valid position, as PX4's failsafe does."""
    setpoints = sim.setpoints
    setpoints.position_ned_m[vehicles] = setpoints.velocity_ned_m_s[vehicles] = np.nan
    setpoints.acceleration_ned_m_s2[:, :2] = np.where(vehicles[:, None], 0.0, np.nan)
    setpoints.velocity_ned_m_s[vehicles, 2] = DESCENT_M_S
