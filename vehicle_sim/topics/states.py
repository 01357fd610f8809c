"""State topics of a vehicle, such as its mode, arming, landing, battery, home and mission.

As in PX4, the log receives a topic periodically, at each change, or both. The console's `listener` and ROS 2
use the same topics.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from vehicle_sim.autopilot.announcer import Event, StatusText
from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.commander import Commander
from vehicle_sim.autopilot.modes import MODES, NavState
from vehicle_sim.autopilot.offboard import SetpointKind
from vehicle_sim.autopilot.takeoff import TakeoffState
from vehicle_sim.autopilot.tasks.manual import ALTITUDE_MODES
from vehicle_sim.external_modes.slots import Controllers
from vehicle_sim.home import Home
from vehicle_sim.topics.arrays import ARRAY_TOPIC_COUNT
from vehicle_sim.topics.layout import TopicLayout
from vehicle_sim.topics.triplet import setpoint_type, triplet
from vehicle_sim.vehicle_view import VehicleView

Values = Mapping[str, Any]
NAN = math.nan
VALID_MODES, SETTABLE_MODES = 0x7FFEE47F, 0x007EC47F
"""Bit masks of the modes that exist and of the modes that can be set, as in `vehicle_status`."""
ARMING_DISARMED, ARMING_ARMED = 1, 2
ROTARY_WING, QUADROTOR = 1, 2
NEVER_MS = 1 << 62
FIRST_MODE_US = 116_000
"""Time at which the commander of a simulated PX4 sets its first mode."""
EVENT_ARGUMENT_BYTES = 25
SOURCE_MAVLINK_0 = 2
"""`data_source` of stick positions that were received by MAVLink."""
OFFBOARD_PERIOD_S = 0.1
"""Period of `offboard_control_mode` while setpoints are received."""
TARGET_PERIOD_US = 200_000
"""Period of `position_setpoint_triplet` while disarmed."""
STICKS_PERIOD_S = 0.2
"""Period of `manual_control_setpoint` while stick positions are received."""
TRAJECTORY_KINDS = (SetpointKind.POSITION, SetpointKind.VELOCITY, SetpointKind.ACCELERATION)
_TAKEOFF_STATE_VALUES = {
    TakeoffState.DISARMED: 1, TakeoffState.SPOOLUP: 2, TakeoffState.READY: 3, TakeoffState.RAMPUP: 4,
    TakeoffState.FLIGHT: 5,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class StateTopic:
    """One topic of one vehicle."""

    layout: TopicLayout
    every_ms: int
    """Period; 0: the topic is written only when it changes."""
    read: Callable[[], Values]
    """Returns the values; empty: the topic was never published."""
    key: Callable[[], object] | None = None
    """Returns a value; the topic is written immediately when the value changes."""

    def pack(self, time_us: int, values: Values | None = None) -> bytes:
        """Packs a data message from `values` (default: the current values); missing fields are zero."""
        by_field = dict(self.read() if values is None else values, timestamp=time_us)
        flat: list[Any] = []
        for field in self.layout.fields:
            value = by_field.get(field.name, 0)
            if field.length:
                items = list(value) if isinstance(value, list | tuple | bytes) else [value] * field.length
                flat += items
            else:
                flat.append(value)
        return self.layout.pack(flat)


FUSION_FLAGS = (
    "dead_reckoning", "bad_acc_vertical", "gnss_pos", "gnss_vel", "gps_hgt", "baro_hgt", "baro_fault",
    "fake_hgt", "valid_fake_pos", "gravity_vector", "mag", "mag_3d", "mag_hdg", "mag_dec",
    "mag_aligned_in_flight", "mag_heading_consistent", "mag_field_disturbed", "vehicle_at_rest", "in_air",
)  # fmt: skip
"""Flags of `Fusion`; the first two have other names in the topic."""


class States:
    """State topics of one vehicle, with the times of arming, take-off and mode change that they contain."""

    def __init__(self, autopilot: Autopilot, system_id: int) -> None:
        self._autopilot = autopilot
        self._view = autopilot.view
        self._commander = autopilot.commander
        self._system_id = system_id
        self._more_modes = 1 << NavState.ALTITUDE_CRUISE if self._view.px4.altitude_cruise else 0
        self._armed_at_us = self._takeoff_at_us = 0
        self._mode_set_at_us = FIRST_MODE_US
        self._arming_reason = self._disarming_reason = 0
        self._mode = self._commander.active
        self.topics = tuple(self._create_topics())
        self._event_layout = TopicLayout("event", ARRAY_TOPIC_COUNT + len(self.topics), self._view.px4.name)
        self._due_ms = [0] * len(self.topics)
        self._next_ms = 0
        self._key_functions = list(dict.fromkeys(topic.key for topic in self.topics if topic.key is not None))
        self._last_keys: list[object] = [None] * len(self._key_functions)
        autopilot.announcer.add_listener(self._record_times)

    @property
    def layouts(self) -> tuple[TopicLayout, ...]:
        """Layouts of all state topics and of events."""
        return (*(topic.layout for topic in self.topics), self._event_layout)

    def restart(self) -> None:
        """Makes all topics due, for a new log."""
        self._due_ms = [0] * len(self.topics)
        self._next_ms = 0

    def due(self, now_us: int) -> bytes:
        """Messages of the topics that have changed or whose period has ended."""
        now_ms = now_us // 1000
        keys = [function() for function in self._key_functions]
        if keys == self._last_keys and now_ms < self._next_ms:
            return b""
        functions_and_keys = zip(self._key_functions, self._last_keys, keys, strict=True)
        changed = {function for function, old, new in functions_and_keys if old != new}
        self._last_keys = keys
        messages: list[bytes] = []
        for n, topic in enumerate(self.topics):
            if topic.key in changed or now_ms >= self._due_ms[n]:
                every_ms = topic.every_ms
                self._due_ms[n] = (now_ms // every_ms + 1) * every_ms if every_ms else NEVER_MS
                if values := topic.read():
                    messages.append(topic.pack(now_us, values))
        self._next_ms = min(self._due_ms)
        return b"".join(messages)

    def event(self, event: Event) -> bytes:
        """Packs an event as a data message."""
        arguments = event.arguments[:EVENT_ARGUMENT_BYTES]
        return self._event_layout.pack(
            [event.time_boot_ms * 1000, event.id, event.sequence, *arguments, event.log_levels]
        )

    def _record_times(self, announcement: StatusText | Event) -> None:
        if isinstance(announcement, StatusText):
            return
        now_us = self._view.time_boot_us()
        if announcement.name == "commander_armed_by":
            self._armed_at_us, self._arming_reason = now_us, announcement.arguments[0]
        elif announcement.name == "commander_disarmed_by":
            self._armed_at_us = self._takeoff_at_us = 0
            self._disarming_reason = announcement.arguments[0]
        elif announcement.name == "commander_takeoff_detected":
            self._takeoff_at_us = now_us

    # --- the topics ------------------------------------------------------------------------------------

    def _create_topics(self) -> list[StateTopic]:
        autopilot, commander, home = self._autopilot, self._commander, self._autopilot.home
        detector, mission, sticks = autopilot.land_detector, autopilot.navigator.mission, autopilot.sticks
        state, view = self._commander_state, self._view
        table: tuple[tuple[str, int, Callable[[], Values], Callable[[], object] | None], ...] = (
            ("vehicle_status", 500, self._vehicle_status, state),
            ("vehicle_control_mode", 500, self._control_mode, state),
            ("actuator_armed", 500, self._actuator_armed, state),
            ("failure_detector_status", 500, self._failure_detector_status, state),
            ("vehicle_land_detected", 1000, self._land_detected,
             lambda: (detector.landed, detector.maybe_landed, detector.ground_contact)),
            ("takeoff_status", 0, self._takeoff_status, lambda: autopilot.takeoff.state),
            ("battery_status", 200, self._battery_status, None),
            ("home_position", 1000, self._home_position, lambda: home.set_at_us),
            ("estimator_status_flags", 1000, self._estimator_flags, self._estimator_key),
            ("failsafe_flags", 500, lambda: _failsafe_flags(view, commander, home),
             lambda: (_fault_flags(view, commander, home), commander.report.requirements)),
            ("mission_result", 1000, self._mission_result,
             lambda: (mission.current, mission.reached, mission.finished)),
            ("manual_control_setpoint", 0, self._manual_control,
             lambda: sticks.received_at_s // STICKS_PERIOD_S if sticks.valid else None),
            ("position_setpoint_triplet", 0, lambda: triplet(autopilot, view.time_boot_us()),
             self._target_key),
            ("offboard_control_mode", 0, self._offboard_control_mode,
             lambda: commander.offboard.received_at_s // OFFBOARD_PERIOD_S),
        )  # fmt: skip
        return [
            StateTopic(TopicLayout(name, ARRAY_TOPIC_COUNT + n, view.px4.name), every_ms, read, key)
            for n, (name, every_ms, read, key) in enumerate(table)
        ]

    def _commander_state(self) -> object:
        c = self._commander
        return (
            c.armed, c.active, c.intended, c.in_failsafe,
            c.offboard.kind if c.active is NavState.OFFBOARD else None, c.report.armable(c.active),
            c.external.config_count, c.failsafe_watch.deferral,
        )  # fmt: skip

    def _vehicle_status(self) -> Values:
        c = self._commander
        if c.active is not self._mode:
            self._mode, self._mode_set_at_us = c.active, self._view.time_boot_us()
        return {
            "armed_time": self._armed_at_us, "takeoff_time": self._takeoff_at_us,
            "nav_state_timestamp": self._mode_set_at_us,
            "valid_nav_states_mask": VALID_MODES | self._more_modes,
            "can_set_nav_states_mask": c.external.settable(SETTABLE_MODES | self._more_modes),
            "arming_state": ARMING_ARMED if c.armed else ARMING_DISARMED,
            "latest_arming_reason": self._arming_reason, "latest_disarming_reason": self._disarming_reason,
            "nav_state_user_intention": int(c.intended_or_replacement), "nav_state": int(c.active),
            "executor_in_charge": c.external.executor_in_charge,
            "failsafe_defer_state": c.failsafe_watch.deferral,
            "vehicle_type": ROTARY_WING, "failsafe": c.in_failsafe,
            "gcs_connection_lost": not c.checks.gcs_connected(), "system_type": QUADROTOR,
            "system_id": self._system_id, "component_id": 1, "safety_button_available": True,
            "safety_off": True, "power_input_valid": True, "calibration_enabled": c.calibrating,
            "pre_flight_checks_pass": c.report.armable(c.active),
        }  # fmt: skip

    def _control_mode(self) -> Values:
        c = self._commander
        if c.external.mode(c.active) is not None:
            return self._external_control_mode(c.external.controllers(c.active))
        mode = MODES[c.active]
        offboard, terminated = c.active is NavState.OFFBOARD, c.active is NavState.TERMINATION
        attitude = not terminated and c.active is not NavState.ACRO
        if offboard:
            attitude = c.offboard.kind in (*TRAJECTORY_KINDS, SetpointKind.ATTITUDE)
        altitude = attitude and c.active not in (NavState.MANUAL, NavState.STABILIZED)
        altitude = altitude and not (offboard and c.offboard.kind is SetpointKind.ATTITUDE)
        position = altitude and c.active not in (*ALTITUDE_MODES, NavState.DESCEND)
        rates = not terminated and (not offboard or attitude or c.offboard.kind is SetpointKind.RATES)
        allocation = not terminated and (
            not offboard or rates or c.offboard.kind is SetpointKind.THRUST_TORQUE
        )
        return {
            "flag_armed": c.armed, "flag_multicopter_position_control_enabled": altitude,
            "flag_control_manual_enabled": mode.needs_sticks, "flag_control_auto_enabled": mode.auto,
            "flag_control_offboard_enabled": offboard, "flag_control_position_enabled": position,
            "flag_control_velocity_enabled": position, "flag_control_altitude_enabled": altitude,
            "flag_control_climb_rate_enabled": altitude, "flag_control_attitude_enabled": attitude,
            "flag_control_rates_enabled": rates, "flag_control_allocation_enabled": allocation,
            "flag_control_termination_enabled": terminated,
        }  # fmt: skip

    def _external_control_mode(self, controllers: Controllers) -> Values:
        flags = {
            f"flag_control_{name}_enabled": value for name, value in dataclasses.asdict(controllers).items()
        }
        return flags | {
            "flag_armed": self._commander.armed,
            "flag_multicopter_position_control_enabled": controllers.trajectory,
            "source_id": int(self._commander.active),
        }  # fmt: skip

    def _actuator_armed(self) -> Values:
        c = self._commander
        return {
            "armed": c.armed,
            "ready_to_arm": c.armed or c.report.armable(c.intended),
            "force_failsafe": c.terminated,
        }

    def _failure_detector_status(self) -> Values:
        monitors = self._commander.monitors
        return {"fd_roll": monitors.roll_failure, "fd_pitch": monitors.pitch_failure}

    def _land_detected(self) -> Values:
        detector, estimate = self._autopilot.land_detector, self._view.estimate
        speed = math.hypot(*estimate.velocity_ned_m_s[:2])
        parameter = self._view.parameter
        return {
            "ground_contact": detector.ground_contact,
            "in_ground_effect": detector.landed,
            "in_descend": detector.landed,
            "has_low_throttle": detector.landed,
            "close_to_ground_or_skipped_check": detector.landed,
            "maybe_landed": detector.maybe_landed,
            "landed": detector.landed,
            "vertical_movement": abs(estimate.velocity_ned_m_s[2]) > parameter("LNDMC_Z_VEL_MAX"),
            "horizontal_movement": speed > parameter("LNDMC_XY_VEL_MAX"),
            "at_rest": detector.landed and not self._commander.armed,
        }

    def _takeoff_status(self) -> Values:
        state = self._autopilot.takeoff.state
        name = "MPC_TILTMAX_AIR" if state is TakeoffState.FLIGHT else "MPC_TILTMAX_LND"
        tilt_limit = math.radians(self._view.parameter(name))
        return {"tilt_limit": tilt_limit, "takeoff_state": _TAKEOFF_STATE_VALUES[state]}

    def _battery_status(self) -> Values:
        battery, i = self._view.simulation.battery, self._view.row
        volts = float(battery.voltage_v[i])
        return {
            "voltage_v": volts, "current_a": float(battery.current_a[i]), "current_average_a": -1.0,
            "discharged_mah": float(battery.consumed_mah[i]), "remaining": float(battery.remaining[i]),
            "scale": 1.0, "time_remaining_s": NAN, "temperature": NAN, "connected": True,
            "ocv_estimate": volts, "ocv_estimate_filtered": volts,
            "cell_count": int(battery.cell_count[i]), "id": 1,
            "warning": self._commander.checks.battery_warning,
        }  # fmt: skip

    def _home_position(self) -> Values:
        home = self._autopilot.home
        x, y, z = home.position_ned_m
        tilt = {"roll": home.roll_rad, "pitch": home.pitch_rad} if self._view.px4.home_has_tilt else {}
        return tilt | {
            "lat": home.lat_deg, "lon": home.lon_deg, "alt": home.alt_amsl_m, "x": x, "y": y, "z": z,
            "yaw": home.yaw_ned_rad, "valid_alt": home.valid, "valid_hpos": home.valid,
            "valid_lpos": home.valid, "manual_home": home.manual,
        }  # fmt: skip

    def _estimator_key(self) -> object:
        fusion, i = self._view.simulation.fusion, self._view.row
        return self._view.estimate.valid_attitude, *(getattr(fusion, name)[i] for name in FUSION_FLAGS)

    def _estimator_flags(self) -> Values:
        fusion, i, aligned = self._view.simulation.fusion, self._view.row, self._view.estimate.valid_attitude
        return {
            "timestamp_sample": self._view.time_boot_us(), "cs_tilt_align": aligned, "cs_yaw_align": aligned,
            "cs_inertial_dead_reckoning": bool(fusion.dead_reckoning[i]),
            "fs_bad_acc_vertical": bool(fusion.bad_acc_vertical[i]),
        } | {f"cs_{name}": bool(getattr(fusion, name)[i]) for name in FUSION_FLAGS[2:]}  # fmt: skip

    def _mission_result(self) -> Values:
        mission = self._autopilot.navigator.mission
        return {
            "seq_reached": -1 if mission.reached is None else mission.reached,
            "seq_current": max(0, mission.current),
            "valid": self._commander.checks.has_mission,
            "finished": mission.finished,
        }

    def _target_key(self) -> object:
        """Changes with the target, and while disarmed with each period."""
        commander, navigator = self._commander, self._autopilot.navigator
        if not commander.armed:
            return self._view.time_boot_us() // TARGET_PERIOD_US
        return navigator.waypoint(commander.active), setpoint_type(self._autopilot)

    def _offboard_control_mode(self) -> Values:
        kind = self._commander.offboard.kind
        flags = {
            SetpointKind.POSITION: "position", SetpointKind.VELOCITY: "velocity",
            SetpointKind.ACCELERATION: "acceleration", SetpointKind.ATTITUDE: "attitude",
            SetpointKind.RATES: "body_rate", SetpointKind.THRUST_TORQUE: "thrust_and_torque",
        }  # fmt: skip
        if not math.isfinite(self._commander.offboard.received_at_s):
            return {}
        return {flags.get(kind, "direct_actuator"): True}

    def _manual_control(self) -> Values:
        sticks = self._autopilot.sticks
        return {
            "timestamp_sample": max(0, int(sticks.received_at_s * 1e6)) if sticks.valid else 0,
            "roll": sticks.raw.right, "pitch": sticks.raw.forward, "yaw": sticks.raw.yaw,
            "throttle": sticks.raw.throttle, "valid": sticks.valid,
            "data_source": SOURCE_MAVLINK_0 if sticks.valid else 0,
            "sticks_moving": sticks.moved,
        }  # fmt: skip


def _fault_flags(view: VehicleView, commander: Commander, home: Home) -> dict[str, Any]:
    """Flags of current faults; the topic is published immediately when a flag changes."""
    estimate, checks, monitors = view.estimate, commander.checks, commander.monitors
    position_usable = checks.position_usable
    relaxed = {"global_position_invalid_relaxed": not position_usable}
    return (relaxed if view.px4.relaxed_global_position else {}) | {
        "attitude_invalid": not estimate.valid_attitude,
        "angular_velocity_invalid": not estimate.valid_attitude,
        "local_altitude_invalid": not estimate.valid_altitude,
        "local_position_invalid": not position_usable,
        "local_position_invalid_relaxed": not position_usable,
        "local_velocity_invalid": not estimate.valid_velocity,
        "global_position_invalid": not position_usable,
        "auto_mission_missing": not checks.has_mission,
        "offboard_control_signal_lost": not commander.offboard.has_signal(),
        "home_position_invalid": not home.valid,
        "manual_control_signal_lost": not checks.has_manual_control(),
        "gcs_connection_lost": not checks.gcs_connected(),
        "battery_warning": checks.battery_warning,
        "geofence_breached": bool(checks.fence),
        "wind_limit_exceeded": monitors.wind_too_high,
        "flight_time_limit_exceeded": monitors.flight_time_over,
        "fd_critical_failure": monitors.roll_failure or monitors.pitch_failure,
    }


def _failsafe_flags(view: VehicleView, commander: Commander, home: Home) -> dict[str, Any]:
    """A mask of modes for each mode requirement, and the flags of current faults."""
    requirement_masks = {
        f"mode_req_{name}": mask for name, mask in commander.report.requirements._asdict().items()
    }
    if not view.px4.relaxed_global_position:
        del requirement_masks["mode_req_global_position_relaxed"]
    return requirement_masks | _fault_flags(view, commander, home)
