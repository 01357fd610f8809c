"""The trajectory of the automatic modes: a target, smoothed axes towards the target, and the setpoints.

Lengths in metres, NED. The flight tasks advance the trajectory once per tick (50 Hz).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vehicle_sim.autopilot.setpoint_writer import SetpointWriter, float_view
from vehicle_sim.autopilot.smoothing import (
    YAW_ACCELERATION_DEG_S2,
    YAW_RATE_MAX_DEG_S,
    Smoothing,
    SpeedLimits,
    WaypointTriplet,
)
from vehicle_sim.autopilot.tick_arrays import Motion, SteadyTask, TickArrays
from vehicle_sim.autopilot.trajectory import ACCELERATION, POSITION, VELOCITY, YawRamp, advance_axis
from vehicle_sim.frames import wrap_angle
from vehicle_sim.state import FloatArray
from vehicle_sim.vehicle_view import Vector, VehicleView

TICK_S = 0.02
"""PX4's flight tasks run at 50 Hz."""
FACING_YAW_MODES = (0, 3, 4)
"""MPC_YAW_MODE: towards waypoint, along trajectory, towards waypoint (yaw first)."""
MAX_CONTINUED_M_S2 = 10.0
"""`restart` ignores a larger acceleration setpoint, because it comes from ground contact."""
TAKEOFF_CLIMB_M_S = 0.3
"""A vehicle on the ground takes off for a trajectory that climbs faster than this."""


class Reset(NamedTuple):
    """The quantities that the estimator has reset since the last call of `EstimateResets.take`."""

    horizontal_velocity: bool
    vertical_velocity: bool
    horizontal_position: bool
    height: bool
    heading_rad: float
    """Change of the heading; 0 without a reset."""


class EstimateResets:
    """Compares the estimator's reset counters from one tick to the next.

    Args:
        view: the vehicle.
        heading_rad: (1,) array that stores the estimated heading of the last tick.
    """

    def __init__(self, view: VehicleView, heading_rad: FloatArray) -> None:
        self._view = view
        self._counts = self._counters()
        self._heading_rad = float_view(heading_rad)

    def _counters(self) -> list[int]:
        """Counters of horizontal velocity, vertical velocity, horizontal position, height, heading."""
        fusion, i = self._view.simulation.fusion, self._view.row
        return [*fusion.resets[:, i].tolist(), int(fusion.heading_reset_counter[i])]

    @property
    def counts(self) -> list[int]:
        """The counters at the last check."""
        return self._counts

    def discard(self) -> None:
        """Ignores all resets so far."""
        self._counts, self._heading_rad[0] = self._counters(), self._view.estimate.yaw_ned_rad

    def take(self) -> Reset | None:
        """The resets since the last call; None: no reset. Call it once per tick."""
        previous, self._counts = self._counts, self._counters()
        old_rad = self._heading_rad[0]
        new_rad = self._heading_rad[0] = self._view.estimate.yaw_ned_rad
        if self._counts == previous:
            return None
        changed = [new != old for new, old in zip(self._counts, previous, strict=True)]
        turned_rad = wrap_angle(new_rad - old_rad) if changed[4] else 0.0
        return Reset(changed[0], changed[1], changed[2], changed[3], turned_rad)


class Path:
    """Position, motion and target of the trajectory.

    Args:
        view: the vehicle.
        setpoints: receives the setpoints.
        arrays: arrays of all vehicles; None: new arrays for this vehicle alone.
    """

    def __init__(
        self, view: VehicleView, setpoints: SetpointWriter, arrays: TickArrays | None = None
    ) -> None:
        index = 0 if arrays is None else view.row
        arrays = arrays or TickArrays.for_count(1)
        self._view = view
        self._setpoints = setpoints
        self._smoothing = Smoothing(
            view, arrays.axes[index], arrays.settings[index], arrays.triplet[index],
            arrays.before_turn_m_s[index],
        )  # fmt: skip
        self.x, self.y, self.z = self._smoothing.x, self._smoothing.y, self._smoothing.z
        self.yaw = YawRamp(arrays.yaw[index])
        self._triplet: WaypointTriplet | None = None
        """The waypoints to `target_ned_m`, starting at the vehicle's position when the target was set."""
        self.target_ned_m: tuple[float | None, float | None, float | None] = (None, None, None)
        """None: not set; the axis brakes, and its target is then the position where it stops."""
        self.face_target = False
        """Whether the nose points to the target while the target is farther away than NAV_ACC_RAD."""
        self.cruise_m_s = self.climb_m_s = self.descent_m_s = math.nan
        """Commanded speeds; NaN: the parameter applies."""
        self._resets = EstimateResets(view, arrays.last_heading_rad[index])

    def follow_resets(self) -> None:
        """Shifts the trajectory by a reset of the estimate, so that the reset does not move the vehicle."""
        reset = self._resets.take()
        if reset is None:
            return
        position, velocity = self._view.estimate.position_ned_m, self._view.estimate.velocity_ned_m_s
        position_reset = (reset.horizontal_position, reset.horizontal_position, reset.height)
        velocity_reset = (reset.horizontal_velocity, reset.horizontal_velocity, reset.vertical_velocity)
        for k, axis in enumerate((self.x, self.y, self.z)):
            if position_reset[k]:
                axis.position_m = position[k]
            if velocity_reset[k]:
                axis.velocity_m_s = velocity[k]
        self.yaw.yaw_ned_rad = wrap_angle(self.yaw.yaw_ned_rad + reset.heading_rad)

    def restart(self, *, in_air: bool, continue_setpoint: bool = False) -> None:
        """Starts the trajectory at the vehicle's position and velocity.

        Args:
            in_air: False if the trajectory starts at rest.
            continue_setpoint: start from the last setpoint of the previous flight task, on each axis that the
                task controlled.
        """
        estimate = self._view.estimate
        self._smoothing.begin()
        self._resets.discard()
        self._triplet = None
        continues = continue_setpoint and in_air
        last_setpoint = self._setpoints.last_trajectory() if continues else ((math.nan,) * 3,) * 3
        for k, axis in enumerate((self.x, self.y, self.z)):
            position, velocity, acceleration = (vector[k] for vector in last_setpoint)
            axis.reset(
                position if math.isfinite(position) else estimate.position_ned_m[k],
                velocity if math.isfinite(velocity) else estimate.velocity_ned_m_s[k] if in_air else 0.0,
            )
            if abs(acceleration) <= MAX_CONTINUED_M_S2:
                axis.acceleration_m_s2 = acceleration
        self.yaw.reset(estimate.yaw_ned_rad)
        self.yaw_target_rad = self.yaw.locked_rad = estimate.yaw_ned_rad
        self.face_target = False
        self.target_ned_m = (None, None, None)

    def keep_speed(self) -> None:
        """Lets the trajectory turn with its speed, where `restart` lets it brake first."""
        self._smoothing.begin(math.hypot(self.x.velocity_m_s, self.y.velocity_m_s))

    def stay_at_vehicle(self) -> None:
        """Sets the trajectory to the vehicle's position; for vehicles on the ground and in stick modes."""
        self._resets.discard()
        self._smoothing.stay_at_vehicle()

    @property
    def yaw_target_rad(self) -> float:
        """The target heading of the trajectory [rad, NED]."""
        return self.yaw.target_rad

    @yaw_target_rad.setter
    def yaw_target_rad(self, value: float) -> None:
        self.yaw.target_rad = value

    @property
    def kept_heading_rad(self) -> float:
        """The target heading near the point that the nose points to [rad, NED].

        Where MPC_YAWRAUTO_ACC applies, a turn ends there; otherwise it is completed.
        """
        return self.yaw.yaw_ned_rad if self._view.px4.smooths_heading else self.yaw.target_rad

    @property
    def starts_takeoff(self) -> bool:
        """Whether the trajectory climbs so fast that a vehicle on the ground takes off."""
        north, east, down = self.target_ned_m
        if north is None or east is None or down is None:
            return False
        triplet = self._triplet_to((north, east, down))
        _, _, down_m_s = self._smoothing.velocity_towards(triplet, self._limits)
        return down_m_s < -TAKEOFF_CLIMB_M_S

    @property
    def position_ned_m(self) -> Vector:
        """Current position of the trajectory."""
        return (self.x.position_m, self.y.position_m, self.z.position_m)

    def face(self, north_m: float, east_m: float) -> None:
        """Sets the target heading towards a position more than 1 m away; only in FACING_YAW_MODES."""
        dn, de = north_m - self.x.position_m, east_m - self.y.position_m
        if math.hypot(dn, de) > 1.0 and self._view.choice("MPC_YAW_MODE") in FACING_YAW_MODES:
            self.yaw_target_rad = math.atan2(de, dn)

    @property
    def _limits(self) -> SpeedLimits:
        return SpeedLimits(self.cruise_m_s, self.climb_m_s, self.descent_m_s)

    def _face_target(self) -> None:
        north, east, _ = self.target_ned_m
        if not self.face_target or north is None or east is None:
            return
        x, y, _ = self._view.estimate.position_ned_m
        if math.hypot(north - x, east - y) > self._view.parameter("NAV_ACC_RAD"):
            self.face(north, east)
        else:
            self.yaw_target_rad = self.kept_heading_rad

    def fly_to_target(self) -> None:
        """Advances all axes by one tick towards the target.

        An axis without a target brakes; its target is then the position where it stops.
        """
        self._face_target()
        north, east, down = self.target_ned_m
        if north is not None and east is not None and down is not None:
            self.fly_triplet(self._triplet_to((north, east, down)))
            return
        self.advance_vertical(self.advance_horizontal())
        self.write()

    def fly_triplet(self, triplet: WaypointTriplet) -> None:
        """Advances by one tick along the waypoints.

        All axes also advance during the take-off ramp. After DO_REPOSITION on the ground the trajectory is
        therefore above the vehicle before lift-off, and this altitude error lifts the vehicle off.
        """
        self._smoothing.fly(TICK_S, triplet, self._limits)
        self.write()

    def _triplet_to(self, target_ned_m: Vector) -> WaypointTriplet:
        if self._triplet is None or self._triplet.target_ned_m != target_ned_m:
            position_ned_m = self._view.estimate.position_ned_m
            self._triplet = WaypointTriplet(
                position_ned_m, target_ned_m, None, self._view.parameter("NAV_ACC_RAD")
            )
        return self._triplet

    def advance_horizontal(self) -> float:
        """Advances north and east by one tick.

        Returns:
            Time by which the trajectory advanced [s], to be used for the vertical axis too; less than a tick
            while the vehicle lags behind the trajectory.
        """
        return self._smoothing.fly_horizontal(TICK_S, self._horizontal_triplet(), self._limits)

    def _horizontal_triplet(self) -> WaypointTriplet | None:
        """The waypoints north and east; None: the trajectory brakes, then its target is where it stops."""
        north, east, down = self.target_ned_m
        if north is not None and east is not None:
            return self._triplet_to((north, east, self.z.position_m if down is None else down))
        if math.hypot(self.x.velocity_m_s, self.y.velocity_m_s) < 0.05:
            self.target_ned_m = (self.x.position_m, self.y.position_m, down)
        return None

    def climb(self, home_down_m: float) -> None:
        """Advances by one tick of a take-off to the target's altitude.

        Args:
            home_down_m: the home position's down.
        """
        down = self.target_ned_m[2]
        target_down_m = math.nan if down is None else down
        triplet = self._horizontal_triplet()
        self._smoothing.climb(TICK_S, triplet, self._limits, target_down_m, home_down_m)
        self.write()

    def descend(self) -> None:
        """Advances by one tick of a landing, slower near the ground."""
        self._smoothing.descend(TICK_S, self._horizontal_triplet(), self._limits)
        self.write()

    def advance_vertical(self, tick_s: float = TICK_S) -> None:
        """Advances the vertical axis by one tick."""
        north, east, down = self.target_ned_m
        velocity_m_s = 0.0
        if down is not None:
            distance_m = down - self.z.position_m
            velocity_m_s = math.copysign(self._smoothing.vertical_speed(distance_m, self._limits), distance_m)
        elif abs(self.z.velocity_m_s) < 0.05:
            self.target_ned_m = (north, east, self.z.position_m)
        advance_axis(self.z.row, tick_s)
        self._smoothing.plan_vertical(velocity_m_s)

    def turn(self) -> None:
        """Turns the heading by one tick towards its target.

        PX4 does not control the heading while `heading_good_for_control` is false; the target then follows
        the estimate. Example: after the in-flight magnetometer alignment, a climb continues with the
        corrected heading.
        """
        if not self._controls_heading:
            self.yaw.follow(self._view.estimate.yaw_ned_rad)
            return
        settings = self._smoothing.read_settings()
        self.yaw.advance(
            TICK_S,
            math.radians(settings[YAW_RATE_MAX_DEG_S]),
            math.radians(settings[YAW_ACCELERATION_DEG_S2]),
        )

    @property
    def _controls_heading(self) -> bool:
        return bool(self._view.simulation.fusion.heading_good_for_control[self._view.row])

    def steady_task(self, motion: Motion) -> SteadyTask | None:
        """The motion to the target; None: the trajectory does not follow waypoints to this target yet."""
        north, east, down = self.target_ned_m
        triplet = self._triplet
        if triplet is None or north is None or east is None or not self._smoothing.follows(triplet):
            return None
        if down is not None and triplet.target_ned_m != (north, east, down):
            return None
        down_m = math.nan if down is None else down
        return SteadyTask(motion, self.cruise_m_s, self.climb_m_s, self.descent_m_s, down_m)

    def read_settings(self) -> None:
        """Updates the parameters that the compiled ticks use."""
        self._smoothing.read_settings()

    def follows(self, triplet: WaypointTriplet) -> bool:
        """Whether the trajectory follows these waypoints."""
        return self._smoothing.follows(triplet)

    def commanded_state(self) -> tuple[object, ...]:
        """State that commands can change between two ticks; for comparison."""
        return self.target_ned_m, self._triplet, self.cruise_m_s, self.climb_m_s, self.descent_m_s

    @property
    def reset_counts(self) -> list[int]:
        """The estimator's reset counters at the last check."""
        return self._resets.counts

    def write(self) -> None:
        """Turns the heading by one tick, and writes the trajectory setpoint for the controllers."""
        self.turn()
        x, y, z = self.x.values, self.y.values, self.z.values
        yaw_rad = self.yaw.yaw_ned_rad if self._controls_heading else math.nan
        self._setpoints.trajectory(
            (x[POSITION], y[POSITION], z[POSITION]),
            (x[VELOCITY], y[VELOCITY], z[VELOCITY]),
            (x[ACCELERATION], y[ACCELERATION], z[ACCELERATION]),
            yaw_rad,
            self.yaw.rate_rad_s,
        )
