"""GNSS in the filter: PX4's quality checks (EKF2_REQ_*), gates, timeouts, stops and resets.

A fix must have been good for a second before it is used (for EKF2_REQ_GPS_H the first time). Position and
velocity are refused as a whole when one axis lies outside its gate. Refused for 7 s both, or for 14 s the
position alone, the estimate is reset to them; without a good fix for 7 s the fusion stops.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.estimator.fusion import HEIGHT_TIMEOUT_S, HORIZON_S, RESET_TIMEOUT_S, Fusion
from vehicle_sim.estimator.kalman import POSITION, UNUSED, VELOCITY, Kalman
from vehicle_sim.estimator.yaw_estimator import SURE_RAD, YawEstimator
from vehicle_sim.frames import wrap_pi, yaw_of
from vehicle_sim.geodesy import to_local
from vehicle_sim.parameters import Parameters
from vehicle_sim.state import EstimateState, SensorState

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

POSITION_BIT, HEIGHT_BIT, VELOCITY_BIT = 1, 2, 4
"""EKF2_GPS_CTRL."""
GOOD_AGAIN_S = 1.0 + HORIZON_S
SILENT_S = 1.0
"""Height from a receiver that says nothing for so long is no more used."""
YAW_RESET_AFTER_S = 1.0
YAW_OFF_RAD = math.radians(25.0)
"""With velocities refused for so long a heading that is so far from the second one is reset to it."""
POSITION_RESET_S = 2.0 * RESET_TIMEOUT_S + HORIZON_S
VERTICAL_SPEED_FACTOR = 1.5
"""GNSS velocity is taken to be this much worse vertically, GNSS height than the least noise of a position."""
LARGEST_RATIO = 2.0
"""ESTIMATOR_STATUS shows no greater test ratio."""
_CHECKS = {"EKF2_REQ_NSATS": 1, "EKF2_REQ_PDOP": 2, "EKF2_REQ_EPH": 4, "EKF2_REQ_EPV": 8, "EKF2_REQ_SACC": 16}
"""Bits of EKF2_GPS_CHECK."""


class Gnss:
    """The GNSS aiding of N vehicles.

    Args:
        count: N.
        kalman: the filter.
        fusion: its flags.
        yaw: the second heading.
    """

    def __init__(self, count: int, kalman: Kalman, fusion: Fusion, yaw: YawEstimator) -> None:
        self._kalman, self._fusion, self._yaw = kalman, fusion, yaw
        self.ratio = np.zeros((count, 3))
        """(N, 3) innovation over gate of velocity, position and height."""
        self.falling = np.zeros(count)
        """(N,) how far the estimate lies below GNSS height or velocity, over the innovation's sigma."""
        self._control = np.zeros(count, dtype=np.int64)
        self._limits = np.zeros((count, len(_CHECKS)))
        self._first_wait_s = np.zeros(count)
        self._noise = np.zeros((count, 2))
        self._gates = np.ones((count, 2))
        self._most_noise_m = np.full(count, np.inf)
        self._passed_once = np.zeros(count, dtype=np.bool_)
        self._heard_at_s = np.full(count, -math.inf)
        self._failed_at_s = np.zeros(count)
        self._passed_at_s = np.full(count, -math.inf)
        self._steady_since_s = np.zeros(count)
        self.position_at_s = np.full(count, -math.inf)
        """(N,) when a position was fused last."""
        self.velocity_at_s = np.full(count, -math.inf)
        self._height_at_s = np.full(count, -math.inf)

    def configure(self, i: int, parameters: Parameters) -> None:
        """Read EKF2_GPS_* and EKF2_REQ_* of vehicle `i`."""
        value = parameters.usable
        self._control[i] = int(parameters.get("EKF2_GPS_CTRL"))
        checks = int(parameters.get("EKF2_GPS_CHECK"))
        for k, (name, bit) in enumerate(_CHECKS.items()):
            self._limits[i, k] = value(name) if checks & bit else (0.0 if k == 0 else math.inf)
        self._first_wait_s[i] = value("EKF2_REQ_GPS_H")
        self._noise[i] = value("EKF2_GPS_P_NOISE"), value("EKF2_GPS_V_NOISE")
        self._gates[i] = max(value("EKF2_GPS_P_GATE"), 1.0), max(value("EKF2_GPS_V_GATE"), 1.0)
        self._most_noise_m[i] = max(value("EKF2_NOAID_NOISE"), 0.01)

    def reset(self, i: int, now_s: float) -> None:
        """Vehicle `i` starts anew."""
        self._passed_once[i] = False
        self._failed_at_s[i] = now_s
        self.ratio[i] = self.falling[i] = 0.0
        for times in (
            self._heard_at_s,
            self._passed_at_s,
            self.position_at_s,
            self.velocity_at_s,
            self._height_at_s,
        ):
            times[i] = -math.inf

    def watch(self, now_s: float) -> None:
        """Stop what has had no good fix for too long; a few times a second."""
        fusion = self._fusion
        np.copyto(fusion.gps_heard, now_s - self._heard_at_s <= SILENT_S)
        fusion.gps_hgt &= fusion.gps_heard
        stale = now_s - self._passed_at_s > RESET_TIMEOUT_S + HORIZON_S
        for flag in (fusion.gnss_pos, fusion.gnss_vel, fusion.gps_hgt):
            flag &= ~stale

    def fuse(self, now_s: float, sensors: SensorState, state: EstimateState, ready: BoolArray) -> BoolArray:
        """Take the newest fixes.

        Args:
            now_s: since boot.
            sensors: whose `gps_fresh` says which receivers have a new fix.
            state: whose origin is set by the first good fix.
            ready: (N,) whose attitude is known.

        Returns:
            (N,) who was aided.
        """
        fresh = sensors.gps_fresh & ready & (self._control != 0)
        self._heard_at_s[fresh] = now_s
        passed = self._check(now_s, sensors, fresh)
        missing = passed & np.isnan(state.origin_lat_deg)
        if missing.any():
            state.origin_lat_deg[missing] = sensors.gps_lat_deg[missing]
            state.origin_lon_deg[missing] = sensors.gps_lon_deg[missing]
            state.origin_alt_amsl_m[missing] = sensors.gps_alt_amsl_m[missing]
        position = self._measured(sensors, state, passed)
        velocity = np.where(passed[:, None], sensors.gps_velocity_ned_m_s, 0.0)
        return self._fuse(now_s, sensors, passed, position, velocity)

    def _check(self, now_s: float, sensors: SensorState, fresh: BoolArray) -> BoolArray:
        satellites, pdop, eph, epv, speed = self._limits.T
        good = (
            fresh
            & (sensors.gps_fix_type >= 3)
            & (sensors.gps_satellites >= satellites)
            & (np.hypot(sensors.gps_hdop, sensors.gps_vdop) <= pdop)
            & (sensors.gps_horizontal_accuracy_m <= eph)
            & (sensors.gps_vertical_accuracy_m <= epv)
            & (sensors.gps_speed_accuracy_m_s <= speed)
        )
        np.copyto(self._fusion.gps_quality_bad, ~good, where=fresh)
        self._failed_at_s[fresh & ~good] = now_s
        self._steady_since_s[good & (now_s - self._passed_at_s > SILENT_S)] = now_s
        waited_s = np.where(self._passed_once, GOOD_AGAIN_S, self._first_wait_s)
        passed = good & (now_s - self._failed_at_s >= waited_s)
        self._passed_once |= passed
        self._passed_at_s[passed] = now_s
        return passed

    def _measured(self, sensors: SensorState, state: EstimateState, passed: BoolArray) -> FloatArray:
        """(N, 3) local position by GNSS; zero where there is none."""
        position = np.zeros((len(passed), 3))
        if passed.any():
            lat, lon, alt = state.origin_lat_deg, state.origin_lon_deg, state.origin_alt_amsl_m
            north, east = to_local(sensors.gps_lat_deg, sensors.gps_lon_deg, lat, lon)
            np.copyto(position[:, 0], north, where=passed)
            np.copyto(position[:, 1], east, where=passed)
            np.copyto(position[:, 2], alt - sensors.gps_alt_amsl_m, where=passed)
        return position

    def _fuse(
        self,
        now_s: float,
        sensors: SensorState,
        passed: BoolArray,
        position: FloatArray,
        velocity: FloatArray,
    ) -> BoolArray:
        kalman, fusion, control = self._kalman, self._fusion, self._control
        places, moves = passed & (control & POSITION_BIT != 0), passed & (control & VELOCITY_BIT != 0)
        accuracy = np.maximum(sensors.gps_horizontal_accuracy_m, self._noise[:, 0])
        level = np.minimum(accuracy, self._most_noise_m) ** 2
        speed = np.maximum(sensors.gps_speed_accuracy_m_s, self._noise[:, 1]) ** 2
        climb = speed * VERTICAL_SPEED_FACTOR**2
        upright = np.maximum(sensors.gps_vertical_accuracy_m, VERTICAL_SPEED_FACTOR * self._noise[:, 0]) ** 2
        variances = np.stack([speed, speed, climb, level, level, upright], axis=1)
        measured = np.concatenate([velocity, position], axis=1)

        starts = (places & ~fusion.gnss_pos) | (moves & ~fusion.gnss_vel)
        lost = (now_s - self.velocity_at_s > RESET_TIMEOUT_S) & (now_s - self.position_at_s > RESET_TIMEOUT_S)
        displaced = places & fusion.gnss_pos & (now_s - self.position_at_s > POSITION_RESET_S)
        turned = self._turn(now_s, moves, velocity[:, :2], speed)
        renewed = passed & (starts | lost | displaced | turned) & (places | moves)
        if renewed.any():
            self._renew(now_s, renewed, places, moves, measured, variances)

        believed = kalman.vector[:, :6]
        covariance = kalman.variances(VELOCITY, POSITION + 3)
        innovation = np.where(passed[:, None], measured - believed, 0.0)
        sigma = np.sqrt(covariance + variances)
        over = innovation / sigma
        ratio = np.abs(over)
        worst = np.stack([ratio[:, :3].max(axis=1), ratio[:, 3:5].max(axis=1), ratio[:, 5]], axis=1)
        worst /= self._gates[:, (1, 0, 0)]
        np.copyto(self.ratio, np.minimum(worst, LARGEST_RATIO), where=passed[:, None])
        # Down is positive: an estimate below the measurement has a negative innovation.
        np.copyto(self.falling, -np.minimum(over[:, 2], over[:, 5]), where=passed)

        speed_good, place_good = moves & (worst[:, 0] <= 1.0), places & (worst[:, 1] <= 1.0)
        # With a bad accelerometer a vertical speed outside its gate is believed as far as the gate reaches.
        bent = moves & fusion.bad_acc_vertical & (ratio[:, :2].max(axis=1) <= self._gates[:, 1])
        if bent.any():
            limit = self._gates[:, 1] * sigma[:, 2]
            near = believed[:, 2] + np.clip(innovation[:, 2], -limit, limit)
            np.copyto(measured[:, 2], near, where=bent)
            speed_good |= bent
        height_good = passed & fusion.gps_hgt & (worst[:, 2] <= 1.0)
        taken = np.stack([speed_good] * 3 + [place_good] * 2 + [height_good], axis=1)
        if taken.any():
            innovation = np.where(taken, measured - believed, 0.0)
            kalman.fuse_states(VELOCITY, innovation, np.where(taken, variances, UNUSED))
        self.velocity_at_s[speed_good] = now_s
        self.position_at_s[place_good] = now_s
        self._height_at_s[height_good] = now_s
        fusion.height_fused_at_s[height_good] = now_s
        self._keep_height(now_s, passed, measured, upright, climb)
        return speed_good | place_good

    def _turn(
        self, now_s: float, moves: BoolArray, velocity_ne: FloatArray, variance: FloatArray
    ) -> BoolArray:
        """Ask the second heading; who was reset to it, since velocities are refused by the first."""
        kalman, fusion, yaw = self._kalman, self._fusion, self._yaw
        yaw.fuse(velocity_ne, variance, moves, fusion.in_air)
        taken_at_s = np.maximum(self.velocity_at_s, self._steady_since_s)
        refused = moves & fusion.gnss_vel & fusion.in_air & (now_s - taken_at_s > YAW_RESET_AFTER_S)
        if not refused.any():
            return refused
        heading, sureness = yaw.headings()
        off = wrap_pi(heading - yaw_of(kalman.q_ned_frd))
        turned = refused & (sureness < SURE_RAD**2) & (np.abs(off) > YAW_OFF_RAD)
        if turned.any():
            kalman.reset_heading(turned, off, sureness)
            fusion.heading_reset_counter += turned
        return turned

    def _renew(
        self, now_s: float, renewed: BoolArray, places: BoolArray, moves: BoolArray, measured: FloatArray,
        variances: FloatArray,
    ) -> None:  # fmt: skip
        """Take position and velocity as measured: the start of a fusion, or after being refused too long."""
        kalman, fusion = self._kalman, self._fusion
        placed, moved = renewed & places, renewed & moves
        for k in range(3):
            kalman.reset_one(moved, VELOCITY + k, measured[:, k], variances[:, k])
        for k in (3, 4):
            kalman.reset_one(placed, VELOCITY + k, measured[:, k], variances[:, k])
        fusion.xy_reset_counter += placed
        fusion.vxy_reset_counter += moved
        fusion.vz_reset_counter += moved
        fusion.aided_once |= renewed
        fusion.gnss_pos |= placed
        fusion.gnss_vel |= moved
        self.position_at_s[placed] = now_s
        self.velocity_at_s[moved] = now_s

    def _keep_height(
        self, now_s: float, passed: BoolArray, measured: FloatArray, upright: FloatArray, climb: FloatArray
    ) -> None:
        """Start, renew or give up the height of GNSS, by which the barometer's offset is learned."""
        kalman, fusion = self._kalman, self._fusion
        wanted = passed & (self._control & HEIGHT_BIT != 0)
        starts = wanted & ~fusion.gps_hgt
        refused = fusion.gps_hgt & passed & (now_s - self._height_at_s > HEIGHT_TIMEOUT_S)
        due = passed & fusion.gps_hgt & fusion.height_reset_due(now_s)
        renewed = starts | due
        fusion.gps_hgt &= ~(refused & ~due)
        if not renewed.any():
            return
        fusion.height_shift_m += np.where(renewed, measured[:, 5] - kalman.position[:, 2], 0.0)
        kalman.reset_one(renewed, POSITION + 2, measured[:, 5], upright)
        kalman.reset_one(renewed & fusion.gnss_vel, VELOCITY + 2, measured[:, 2], climb)
        fusion.z_reset_counter += renewed
        fusion.vz_reset_counter += due
        fusion.gps_hgt |= starts
        self._height_at_s[renewed] = now_s
        fusion.height_fused_at_s[renewed] = now_s
        fusion.accel_good_at_s[renewed] = now_s

    @property
    def rejected(self) -> BoolArray:
        """(N,) whose newest position or velocity lay outside its gate."""
        using = self._fusion.gnss_pos | self._fusion.gnss_vel
        return using & (self.ratio[:, :2] > 1.0).any(axis=1)
