"""The simulated vehicles without autopilots: bodies, sensors, estimators and controllers.

One `step()` advances all N vehicles by 4 ms, module by module in a fixed order. Time is the step count times
4 ms, independent of real time. Between two steps the autopilots read `estimate`, `sensors` and `battery`, and
write `setpoints`; they never read `truth`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.airframe import Airframe
from vehicle_sim.control.allocation import mixer_from_parameters
from vehicle_sim.control.cascade import Cascade
from vehicle_sim.control.setpoints import ControlLevel, Setpoints
from vehicle_sim.estimator.estimator import RANGE_EVERY_STEPS, Estimator
from vehicle_sim.estimator.fusion import Fusion
from vehicle_sim.estimator.vision import VisionSample
from vehicle_sim.parameters import Parameters
from vehicle_sim.physics.battery import Batteries
from vehicle_sim.physics.rigid_body import RigidBodies
from vehicle_sim.physics.wind import Wind
from vehicle_sim.sensors.suite import Driver, RangeFinder, SensorFaults, SensorSuite
from vehicle_sim.state import (
    BatteryState,
    EstimateState,
    FlightMoment,
    SensorState,
    SimulationOrigin,
    TargetState,
    TruthState,
    VehicleEstimate,
    vehicle_estimates,
)
from vehicle_sim.world.contact import Collision, Contact
from vehicle_sim.world.lidar import Lidar
from vehicle_sim.world.world import World

__all__ = [
    "BatteryState",
    "ControlLevel",
    "EstimateState",
    "SensorState",
    "Setpoints",
    "Simulation",
    "SimulationOrigin",
    "TargetState",
    "TruthState",
]

FloatArray = NDArray[np.float64]

STEP_S = 0.004
"""PX4's SIH runs at 250 Hz."""
AUTOPILOT_EVERY_STEPS = 5
"""The autopilots run at 50 Hz, like PX4's flight tasks."""
FOREIGN_FROM_STEP = (2, 2, 1)
"""First step, in an autopilot's successive ticks, in which a foreign trajectory setpoint takes effect; by
recordings of streams at 10, 20 and 50 Hz."""
BATTERY_EVERY_STEPS = 5
CPU_LOAD = 0.105
"""Recorded load of a simulated PX4."""
WIND_EVERY_STEPS = 5


class Simulation:
    """N simulated quadrotors with estimators and controllers.

    Args:
        count: number of vehicles.
        parameters: one store for each vehicle; default: PX4's boot values.
        seed: seed of sensor noise and gusts.
        noise_numbers: one for each vehicle; noise and gusts of a vehicle depend only on seed and number.
            Default: 0, 1, 2, …
        origin: global position of local NED (0, 0, 0).
        start_ned_m: (N, 3) start position of each vehicle; default: a row to the east, 3 m apart.
        yaw_ned_rad: (N,) start headings; default: north.
        wind_ned_m_s: (3,) or (N, 3) steady wind, which changes the drag.
        sensor_noise: False: no noise (for tests of exact equality).
        world: ground and obstacles; default: flat and empty, as in PX4's own simulation.

    Raises:
        ValueError: counts or shapes do not match, or the parameters describe no valid airframe.
    """

    def __init__(
        self,
        count: int = 1,
        *,
        parameters: Sequence[Parameters] | None = None,
        seed: int = 0,
        noise_numbers: Sequence[int] | None = None,
        origin: SimulationOrigin | None = None,
        start_ned_m: FloatArray | None = None,
        yaw_ned_rad: FloatArray | None = None,
        wind_ned_m_s: FloatArray | None = None,
        sensor_noise: bool = True,
        world: World | None = None,
    ) -> None:
        if count < 1:
            raise ValueError(f"count is {count}; a simulation needs at least one vehicle")
        stores = [Parameters() for _ in range(count)] if parameters is None else list(parameters)
        if len(stores) != count:
            raise ValueError(f"{len(stores)} parameter stores for {count} vehicles; give one each")
        self.count = count
        self.dt_s = STEP_S
        self.origin = origin or SimulationOrigin()
        self.parameters: tuple[Parameters, ...] = tuple(stores)
        self.setpoints = Setpoints.idle(count)
        self.steps = 0
        """Number of steps since boot."""
        self.time_s = 0.0
        """Simulated time since boot."""
        self._estimates: list[VehicleEstimate] | None = None
        start_ned_m = row_east(count) if start_ned_m is None else np.array(start_ned_m, dtype=float)
        start_yaw_rad = np.zeros(count) if yaw_ned_rad is None else np.array(yaw_ned_rad, dtype=float)
        if start_ned_m.shape != (count, 3) or start_yaw_rad.shape != (count,):
            raise ValueError(f"start_ned_m must be ({count}, 3) and yaw_ned_rad ({count},)")
        self._bodies = RigidBodies(count, STEP_S)
        vehicle_numbers = range(count) if noise_numbers is None else noise_numbers
        self._wind = Wind(STEP_S * WIND_EVERY_STEPS, seed=seed, vehicles=vehicle_numbers)
        self._batteries = Batteries(count, STEP_S * BATTERY_EVERY_STEPS)
        self._sensors = SensorSuite(
            STEP_S, self.origin, seed=seed, vehicles=vehicle_numbers, noise=sensor_noise
        )
        self._range_finder = RangeFinder(count)
        self._estimator = Estimator(count, STEP_S)
        self._cascade = Cascade(count, STEP_S)
        self.cpu_load = np.full(count, CPU_LOAD)
        """(N,) load of each autopilot's processor, 0..1; a value that is only logged."""
        self.motor_health = np.ones((count, 4))
        """(N, 4) factor on each motor's thrust; 1: the motor works, 0: the motor does not turn."""
        self.world = world or World()
        self._lidar = Lidar(self.world, self._bodies.state)
        self._contact = None if self.world.empty else Contact(self.world, count)
        self._collisions: list[Collision] = []
        if wind_ned_m_s is not None:
            self.set_wind(wind_ned_m_s)
        if self._contact is not None:
            self._bodies.ground_down_m[:] = self._contact.support_down_m(start_ned_m)
        for i in range(count):
            self._apply_parameters(i)
            self._bodies.place(i, start_ned_m[i], float(start_yaw_rad[i]))

    @property
    def truth(self) -> TruthState:
        """The true state; the autopilot must not read it."""
        return self._bodies.state

    @property
    def sensors(self) -> SensorState:
        """The newest sample of each sensor."""
        return self._sensors.state

    @property
    def sensor_faults(self) -> SensorFaults:
        """Injected faults of the sensors."""
        return self._sensors.faults

    @property
    def estimate(self) -> EstimateState:
        """The estimated state, which the autopilots use."""
        return self._estimator.state

    @property
    def fusion(self) -> Fusion:
        """Flags and counters of the estimators."""
        return self._estimator.fusion

    @property
    def estimates(self) -> list[VehicleEstimate]:
        """`estimate` as plain numbers, one item for each vehicle."""
        if self._estimates is None:
            self._estimates = vehicle_estimates(self._estimator.state)
        return self._estimates

    @property
    def battery(self) -> BatteryState:
        """Batteries of all vehicles."""
        return self._batteries.state

    @property
    def target(self) -> TargetState:
        """Setpoints that the controllers apply."""
        return self._cascade.target

    @property
    def motors_us(self) -> FloatArray:
        """(N, 4) motor signals: 900 disarmed, 1000..2000 armed."""
        return self._cascade.motors_us

    @property
    def torque_frd(self) -> FloatArray:
        """(N, 3) normalised torque setpoints of the mixer."""
        return self._cascade.torque_frd

    def step(self) -> None:
        """Advances all vehicles by `dt_s`."""
        self._sensors.sample(self._bodies.state, self._bodies.matrix, self.setpoints.armed)
        self._estimator.update(self._sensors.state)
        if self.steps % RANGE_EVERY_STEPS == 0:
            self._estimator.update_range(
                self._distances_down_m(), self.setpoints.in_air, self.setpoints.armed
            )
        self._cascade.update(self.setpoints, self._estimator.state)
        if self.steps % WIND_EVERY_STEPS == 0:
            self._bodies.wind_ned_m_s[:] = self._wind.step()
        if self._contact is not None:
            self._contact.store_velocity(self._bodies.state.velocity_ned_m_s)
        self._bodies.step(self._cascade.motor_signal, self.motor_health)
        if self.steps % BATTERY_EVERY_STEPS == 0:
            self._batteries.step(self.setpoints.armed, self._cascade.motor_signal)
        if self._contact is not None:
            self._update_contact(self._contact)
        self.steps += 1
        self.time_s = self.steps * STEP_S
        self._estimates = None

    @property
    def takes_foreign_trajectory(self) -> bool:
        """Whether a trajectory setpoint from outside takes effect in a mode with its own setpoints.

        In PX4 the position controller runs two or three times for each setpoint of a mode, the first time
        directly after it. A foreign setpoint before the last of these runs controls the rest of them; a later
        one is overwritten. So a stream at the mode's own rate controls about a quarter of the time.
        """
        tick, step = divmod(self.steps, AUTOPILOT_EVERY_STEPS)
        return step >= FOREIGN_FROM_STEP[tick % len(FOREIGN_FROM_STEP)]

    def _update_contact(self, contact: Contact) -> None:
        """Detects collisions, which stop the vehicle's motors, and updates the surface below each body."""
        state = self._bodies.state
        collisions = contact.collide(state.position_ned_m, state.velocity_ned_m_s)
        for collision in collisions:
            self.motor_health[collision.row] = 0.0
        self._collisions += collisions
        self._bodies.ground_down_m[:] = contact.support_down_m(state.position_ned_m)

    def take_collisions(self) -> list[Collision]:
        """The collisions since the last call."""
        collisions, self._collisions = self._collisions, []
        return collisions

    def distance_down_m(self, i: int) -> float:
        """Distance along the body's down axis from vehicle `i`'s range finder; NaN: out of range."""
        return float(self._distances_down_m()[i])

    def _distances_down_m(self) -> FloatArray:
        return self._range_finder.measure_m(self._lidar.down_m(self.steps, self._bodies.matrix))

    def distance_forward_m(self, i: int) -> float:
        """Distance from vehicle `i`'s forward lidar (`World.lidars`)."""
        return float(self._lidar.forward_m(self.steps, self._bodies.matrix)[i])

    def distances_around_m(self, i: int) -> FloatArray:
        """(72,) distances from vehicle `i`'s 360° lidar, clockwise from the nose (`World.lidars`)."""
        return self._lidar.around_m(self.steps, self._bodies.matrix)[i]

    def set_battery_empty(self, i: int, empty: bool) -> None:
        """Sets the battery of vehicle `i` to the voltage of an empty battery, or back to normal."""
        self._batteries.set_empty(i, empty)

    def set_battery_resistance(self, i: int, ohm: float) -> None:
        """Gives the battery of vehicle `i` an internal resistance, and measures its current."""
        self._batteries.set_resistance(i, ohm)

    def set_battery_remaining(self, i: int, remaining: float) -> None:
        """Sets the charge (0..1) of vehicle `i`, to test a low battery."""
        self._batteries.set_remaining(i, remaining)

    def set_gps_enabled(self, i: int, enabled: bool) -> None:
        """Connects or disconnects the GPS antenna of vehicle `i`."""
        self._sensors.set_gps_enabled(i, enabled)

    def set_gps_stuck(self, i: int, stuck: bool) -> None:
        """Makes the GPS receiver of vehicle `i` repeat its last fix (`stuck`), or measure again."""
        self._sensors.set_gps_stuck(i, stuck)

    def set_gps_offset(self, i: int, offset_ned_m: FloatArray) -> None:
        """Adds an offset (3,) to the GPS position of vehicle `i`, to simulate a glitch."""
        self._sensors.set_gps_offset(i, offset_ned_m)

    def set_driver(self, i: int, driver: Driver, running: bool) -> None:
        """Starts or stops the driver of a simulated sensor of vehicle `i`."""
        self._sensors.set_driver(i, driver, running)

    def driver_runs(self, i: int, driver: Driver) -> bool:
        """Whether the driver of a simulated sensor of vehicle `i` runs."""
        return self._sensors.driver_runs(i, driver)

    def set_attitude_if_disarmed(self, i: int, q_ned_frd: FloatArray) -> None:
        """Sets the attitude of vehicle `i` at its position; ignored while armed."""
        if not self.setpoints.armed[i]:
            self._bodies.set_attitude(i, q_ned_frd)

    def place_in_flight(self, i: int, moment: FlightMoment) -> None:
        """Moves vehicle `i`, which flies, to a moment of another flight. Its estimator is as far from the
        truth there as before, so that its sensors and the estimate still agree.

        Raises:
            ValueError: the vehicle is on the ground, or the moment is not above it.
        """
        truth = self._bodies.state
        if truth.on_ground[i]:
            raise ValueError(f"vehicle {i} is on the ground; only a vehicle that flies can be moved")
        if not moment.position_ned_m[2] < self._bodies.ground_down_m[i]:
            raise ValueError("the moment is not above the ground")
        error_m = self._estimator.state.position_ned_m[i] - truth.position_ned_m[i]
        self._bodies.place_in_flight(i, moment)
        self._estimator.place(i, moment.position_ned_m + error_m, moment.velocity_ned_m_s, moment.q_ned_frd)
        self._cascade.place(i, moment)
        self._estimates = None

    def add_vision(self, i: int, sample: VisionSample) -> None:
        """Passes an external measurement to the estimator of vehicle `i` (EKF2_EV_CTRL)."""
        self._estimator.add_vision(i, sample)

    def set_origin(self, i: int, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Sets the global origin of vehicle `i`'s local frame."""
        self._estimator.set_origin(i, lat_deg, lon_deg, alt_amsl_m)
        self._estimates = None

    def set_wind(self, wind_ned_m_s: FloatArray, i: int | None = None) -> None:
        """Sets the steady wind: (3,) for vehicle `i`; (3,) or (N, 3) for all vehicles."""
        rows = slice(None) if i is None else i
        self._wind.steady_ned_m_s[rows] = np.asarray(wind_ned_m_s, dtype=float)
        self._bodies.wind_ned_m_s[rows] = self._wind.steady_ned_m_s[rows]

    def set_gusts(self, sigma_m_s: float, i: int | None = None) -> None:
        """Sets gusts in addition to the steady wind; 0 ends the gusts.

        Args:
            sigma_m_s: standard deviation of the gusts in each horizontal axis.
            i: the vehicle; None: all vehicles.

        Raises:
            ValueError: the standard deviation is negative or not a number.
        """
        rows = slice(None) if i is None else i
        self._wind.set_gusts(sigma_m_s, i)
        self._bodies.wind_ned_m_s[rows] = self._wind.steady_ned_m_s[rows]

    def set_sensor_noise(self, i: int, factor: float) -> None:
        """Multiplies the sensor noise of PX4's SIH by a factor for vehicle `i`; 0: no noise.

        Raises:
            ValueError: the factor is negative or not a number.
        """
        self._sensors.set_noise(i, factor)

    def reload_parameters(self, i: int) -> str | None:
        """Applies changed parameters of vehicle `i` (gains, limits, airframe, battery).

        Returns:
            None, or why the parameters describe no valid airframe (SIH_MASS 0, rotors in a line); the old
            values then remain in use.
        """
        try:
            self._apply_parameters(i)
        except ValueError as error:
            return str(error)
        return None

    def _apply_parameters(self, i: int) -> None:
        parameters = self.parameters[i]
        airframe = Airframe.from_parameters(parameters)
        mixer_from_parameters(parameters)  # raises for an invalid geometry, before anything changes
        self._bodies.configure(i, airframe)
        self._batteries.configure(i, parameters)
        self._sensors.configure(i, parameters)
        self._range_finder.configure(i, parameters)
        self._estimator.configure(i, parameters)
        self._cascade.configure(i, parameters)


def row_east(count: int, first: int = 0) -> FloatArray:
    """(N, 3) default start positions of vehicles `first`, `first` + 1, …: a row to the east, 3 m apart."""
    position_ned_m = np.zeros((count, 3))
    position_ned_m[:, 1] = 3.0 * (first + np.arange(count))
    return position_ned_m
