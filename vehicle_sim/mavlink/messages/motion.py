"""Messages with position, motion, setpoints and actuator outputs of the vehicle."""

from __future__ import annotations

import math
from collections.abc import Sequence

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.control.setpoints import ControlLevel
from vehicle_sim.geodesy import to_global
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.messages.message_group import NAN, MessageGroup, i16, packer

_ATTITUDE = packer("ATTITUDE")
_ATTITUDE_QUATERNION = packer("ATTITUDE_QUATERNION")
_LOCAL_POSITION = packer("LOCAL_POSITION_NED")
_GLOBAL_POSITION = packer("GLOBAL_POSITION_INT")
_LOCAL_POSITION_TARGET = packer("POSITION_TARGET_LOCAL_NED")
_ATTITUDE_TARGET = packer("ATTITUDE_TARGET")
_SERVO_OUTPUTS = packer("SERVO_OUTPUT_RAW")

_NO_SETPOINT = (NAN, NAN, NAN)
_IDLE_ACCELERATION_NED = (0.0, 0.0, 100.0)
"""PX4's acceleration setpoint on the ground [m/s²]: downwards, so that the motors stay idle."""
UNUSED_OUTPUT_US = 900
OUTPUTS = 16
FIRST_MOTOR_FUNCTION, FIRST_GIMBAL_FUNCTION = 101, 420
"""Values of PWM_MAIN_FUNC*: the first of twelve motors; the gimbal's roll, which pitch and yaw follow."""
CENTRE_US = 1500
FUNCTION_NAMES = tuple(f"PWM_MAIN_FUNC{n}" for n in range(1, OUTPUTS + 1))
PREARM_ALWAYS = 2


RESET_COUNTERS = (
    "xy_reset_counter", "z_reset_counter", "vxy_reset_counter", "vz_reset_counter", "heading_reset_counter",
)  # fmt: skip


def _covariance(first: float, second: float, third: float) -> list[float]:
    """The upper right triangle of a 6x6 covariance matrix of which three variances are known."""
    triangle = [NAN] * 21
    triangle[0], triangle[6], triangle[11] = first, second, third
    return triangle


class MotionMessages(MessageGroup):
    """Builders of attitude, position, setpoint and output messages."""

    def __init__(self, autopilot: Autopilot) -> None:
        super().__init__(autopilot)
        self._functions: list[int] = []
        self._functions_revision = -1

    def attitude(self) -> bytes:
        estimate = self._view.estimate
        return _ATTITUDE(
            self._view.time_boot_ms(),
            estimate.roll_rad,
            estimate.pitch_rad,
            estimate.yaw_ned_rad,
            *estimate.rates_frd_rad_s,
        )

    def attitude_quaternion(self) -> bytes:
        estimate = self._view.estimate
        return _ATTITUDE_QUATERNION(
            self._view.time_boot_ms(), *estimate.q_ned_frd, *estimate.rates_frd_rad_s, 0.0, 0.0, 0.0, 0.0
        )

    def local_position_ned(self) -> bytes | None:
        estimate = self._view.estimate
        if not estimate.valid_altitude:
            return None
        return _LOCAL_POSITION(
            self._view.time_boot_ms(), *estimate.position_ned_m, *estimate.velocity_ned_m_s
        )

    def global_position_int(self) -> bytes | None:
        estimate, home = self._view.estimate, self._autopilot.home
        if not estimate.valid_position or not math.isfinite(estimate.lat_deg):
            return None
        above_home_m = estimate.alt_amsl_m - home.alt_amsl_m if home.valid else 0.0
        vn, ve, vd = estimate.velocity_ned_m_s
        return _GLOBAL_POSITION(
            self._view.time_boot_ms(),
            round(estimate.lat_deg * 1e7),
            round(estimate.lon_deg * 1e7),
            round(estimate.alt_amsl_m * 1000),
            round(above_home_m * 1000),
            i16(vn * 100),
            i16(ve * 100),
            i16(vd * 100),
            int(math.degrees(estimate.yaw_ned_rad) % 360.0 * 100.0) % 36000,
        )

    def odometry(self) -> bytes:
        estimate, simulation, row = self._view.estimate, self._view.simulation, self._view.row
        accuracies, fusion = simulation.estimate, simulation.fusion
        horizontal_m2 = 0.5 * float(accuracies.horizontal_accuracy_m[row]) ** 2
        vertical_m2 = float(accuracies.vertical_accuracy_m[row]) ** 2
        speed_m2_s2 = float(accuracies.speed_accuracy_m_s[row]) ** 2 / 3.0
        resets = sum(int(getattr(fusion, name)[row]) for name in RESET_COUNTERS)
        return pack(
            "ODOMETRY",
            time_usec=self._view.time_boot_us(),
            frame_id=1,
            child_frame_id=1,
            x=estimate.position_ned_m[0],
            y=estimate.position_ned_m[1],
            z=estimate.position_ned_m[2],
            q=estimate.q_ned_frd,
            vx=estimate.velocity_ned_m_s[0],
            vy=estimate.velocity_ned_m_s[1],
            vz=estimate.velocity_ned_m_s[2],
            rollspeed=estimate.rates_frd_rad_s[0],
            pitchspeed=estimate.rates_frd_rad_s[1],
            yawspeed=estimate.rates_frd_rad_s[2],
            pose_covariance=_covariance(horizontal_m2, horizontal_m2, vertical_m2),
            velocity_covariance=_covariance(speed_m2_s2, speed_m2_s2, speed_m2_s2),
            reset_counter=resets & 0xFF,
            estimator_type=8,
        )[1]

    def altitude(self) -> bytes:
        estimate, home = self._view.estimate, self._autopilot.home
        has_altitude = estimate.valid_position and math.isfinite(estimate.alt_amsl_m)
        above_home_m = estimate.alt_amsl_m - home.alt_amsl_m if has_altitude and home.valid else NAN
        above_ground_m = estimate.height_above_ground_m if has_altitude else NAN
        return pack(
            "ALTITUDE",
            time_usec=self._view.time_boot_us(),
            altitude_monotonic=self._baro_alt_amsl_m,
            altitude_amsl=estimate.alt_amsl_m if has_altitude else NAN,
            altitude_local=-estimate.position_ned_m[2] if has_altitude else NAN,
            altitude_relative=above_home_m,
            altitude_terrain=-estimate.position_ned_m[2] - above_ground_m,
            bottom_clearance=above_ground_m,
        )[1]

    @property
    def _baro_alt_amsl_m(self) -> float:
        return float(self._view.simulation.sensors.baro_alt_amsl_m[self._view.row])

    def vfr_hud(self) -> bytes:
        estimate = self._view.estimate
        vn, ve, vd = estimate.velocity_ned_m_s
        armed = self._autopilot.commander.armed
        thrust = float(self._view.simulation.target.thrust[self._view.row]) if armed else 0.0
        return pack(
            "VFR_HUD",
            airspeed=self._view.px4.airspeed_without_sensor_m_s,
            groundspeed=math.hypot(vn, ve),
            heading=int(math.degrees(estimate.yaw_ned_rad) % 360.0) % 360,
            throttle=max(0, min(100, int(100 * thrust))),
            alt=estimate.alt_amsl_m if math.isfinite(estimate.alt_amsl_m) else self._baro_alt_amsl_m,
            climb=-vd,
        )[1]

    def position_target_local_ned(self) -> bytes:
        time_ms, (p, v, a, yaw, yaw_rate) = self._view.time_boot_ms(), self._setpoint()
        ignored = 0
        for bit, value in enumerate((*p, *v, *a)):
            if math.isnan(value):
                ignored |= 1 << bit
        return _LOCAL_POSITION_TARGET(time_ms, *p, *v, *a, yaw, yaw_rate, ignored, 1)

    def _setpoint(self) -> tuple[Sequence[float], Sequence[float], Sequence[float], float, float]:
        """The position controller's setpoint (NED): position, velocity, acceleration, yaw and yaw rate."""
        target, i = self._view.simulation.target, self._view.row
        heading = self._view.estimate.yaw_ned_rad
        p, v = target.position_ned_m[i].tolist(), target.velocity_ned_m_s[i].tolist()
        a = target.acceleration_ned_m_s2[i].tolist()
        disarmed = int(self._view.simulation.setpoints.level[i]) == ControlLevel.DISARMED
        if disarmed or all(map(math.isnan, (*p, *v, *a))):
            return _NO_SETPOINT, _NO_SETPOINT, _IDLE_ACCELERATION_NED, heading, 0.0
        yaw, yaw_rate = float(target.yaw_ned_rad[i]), float(target.yaw_rate_ned_rad_s[i])
        # PX4's position controller replaces a missing yaw by the current heading, and a missing yaw rate by
        # zero.
        return (
            p,
            v,
            a,
            heading if math.isnan(yaw) else yaw,
            0.0 if math.isnan(yaw_rate) else yaw_rate,
        )

    def position_target_global_int(self) -> bytes | None:
        waypoint = self._autopilot.waypoint
        if waypoint is None:
            return None
        _, v, a, yaw, yaw_rate = self._setpoint()
        return pack(
            "POSITION_TARGET_GLOBAL_INT",
            time_boot_ms=self._view.time_boot_ms(),
            coordinate_frame=5,
            lat_int=round(waypoint[0] * 1e7),
            lon_int=round(waypoint[1] * 1e7),
            alt=waypoint[2],
            vx=v[0], vy=v[1], vz=v[2], afx=a[0], afy=a[1], afz=a[2], yaw=yaw, yaw_rate=yaw_rate,
        )[1]  # fmt: skip

    def attitude_target(self) -> bytes:
        target, i = self._view.simulation.target, self._view.row
        q, rates, thrust = target.q_ned_frd[i].tolist(), target.rates_frd_rad_s[i].tolist(), target.thrust[i]
        offboard = self._autopilot.offboard
        if self._autopilot.has_attitude_setpoint:
            thrust = offboard.reported_thrust
            if offboard.invalid_attitude is not None:
                q, rates = offboard.invalid_attitude, (NAN, NAN, NAN)
        return _ATTITUDE_TARGET(self._view.time_boot_ms(), *q, *rates, float(thrust), 0)

    def hil_state_quaternion(self) -> bytes:
        """Contains the true state, as in PX4's SIH; like PX4, it sends the acceleration in m/s²."""
        simulation, i = self._view.simulation, self._view.row
        truth, origin = simulation.truth, simulation.origin
        north, east, down = truth.position_ned_m[i].tolist()
        lat, lon = to_global(north, east, origin.lat_deg, origin.lon_deg)  # type: ignore[arg-type]
        vn, ve, vd = (i16(100.0 * speed) for speed in truth.velocity_ned_m_s[i].tolist())
        roll_rate, pitch_rate, yaw_rate = truth.rates_frd_rad_s[i].tolist()
        ax, ay, az = (i16(value) for value in truth.acceleration_ned_m_s2[i].tolist())
        return pack(
            "HIL_STATE_QUATERNION", time_usec=self._view.time_boot_us(),
            attitude_quaternion=truth.q_ned_frd[i].tolist(),
            rollspeed=roll_rate, pitchspeed=pitch_rate, yawspeed=yaw_rate,
            lat=round(float(lat) * 1e7), lon=round(float(lon) * 1e7),
            alt=round((origin.alt_amsl_m - down) * 1000),
            vx=vn, vy=ve, vz=vd, xacc=ax, yacc=ay, zacc=az,
        )[1]  # fmt: skip

    def actuator_output_status(self) -> bytes:
        outputs = [float(value) for value in self._outputs_us()]
        return pack(
            "ACTUATOR_OUTPUT_STATUS", time_usec=self._view.time_boot_us(), active=OUTPUTS,
            actuator=outputs + [0.0] * OUTPUTS,
        )[1]  # fmt: skip

    def servo_output_raw(self) -> bytes:
        values, port = self._outputs_us(), 0
        return _SERVO_OUTPUTS(self._view.time_boot_us() & 0xFFFFFFFF, *values[:8], port, *values[8:])

    def _outputs_us(self) -> list[int]:
        motors = [round(value) for value in self._view.simulation.motors_us[self._view.row].tolist()]
        functions = self._output_functions()
        servos = self._servos_us() if max(functions) >= FIRST_GIMBAL_FUNCTION else {}
        reversed_bits = self._view.choice("PWM_MAIN_REV") if servos else 0
        values: list[int] = []
        for output, function in enumerate(functions):
            motor = function - FIRST_MOTOR_FUNCTION
            if 0 <= motor < len(motors):
                values.append(motors[motor])
            elif function in servos and reversed_bits >> output & 1:
                values.append(2 * CENTRE_US - servos[function])
            else:
                values.append(servos.get(function, UNUSED_OUTPUT_US))
        return values

    def _output_functions(self) -> list[int]:
        if self._functions_revision != self._view.parameter_changes:
            self._functions_revision = self._view.parameter_changes
            self._functions = [int(self._view.parameter(name)) for name in FUNCTION_NAMES]
        return self._functions

    def _servos_us(self) -> dict[int, int]:
        """Pulses of the gimbal's servos by output function; empty before arming, unless COM_PREARM_MODE is 2
        (always)."""
        controls = self._autopilot.gimbal.servo_controls()
        active = self._autopilot.commander.armed or self._view.choice("COM_PREARM_MODE") == PREARM_ALWAYS
        if controls is None or not active:
            return {}
        return {
            FIRST_GIMBAL_FUNCTION + k: round(CENTRE_US + 500.0 * value) for k, value in enumerate(controls)
        }
