"""Arming checks: the modes that can run, the modes that allow arming, and PX4's report of the findings."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from vehicle_sim.autopilot.announcer import EVENTS, Announcer
from vehicle_sim.autopilot.geofence import Breach
from vehicle_sim.autopilot.modes import NavState
from vehicle_sim.external_modes.arming_checks import ExternalEvent, ExternalHealth
from vehicle_sim.external_modes.registry import is_external
from vehicle_sim.external_modes.requirements import BUILT_IN_REQUIREMENTS, Requirements

EVERY_MODE = 0xFFFFFFFF

COMPONENT_ABSOLUTE_PRESSURE = 1
COMPONENT_GPS = 3
COMPONENT_OPTICAL_FLOW = 4
COMPONENT_DISTANCE_SENSOR = 6
COMPONENT_REMOTE = 7
COMPONENT_BATTERY = 11
COMPONENT_REMOTE_LINK = 12
COMPONENT_LOCAL_POSITION = 17
COMPONENT_SYSTEM = 20
COMPONENT_GLOBAL_POSITION = 24
COMPONENT_PARACHUTE = 26
COMPONENT_MAGNETOMETER = 27
COMPONENT_ACCELEROMETER = 28
COMPONENT_GYRO = 29
COMPONENT_OPEN_DRONE_ID = 30
"""Health components of PX4's events; numbers are bits of the masks of components."""
WARNING = 4
"""Log level: lower levels are errors, higher levels are neither errors nor warnings."""
GPS_PROBLEMS = {
    "fix": ("check_estimator_gps_fix_too_low", "Preflight: GPS fix too low"),
    "satellites": ("check_estimator_gps_num_sats_too_low", "Preflight: not enough GPS Satellites"),
}
FENCE_EVENTS = {
    Breach.DISTANCE: (
        "check_gf_violation_max_hor_dist", "Geofence violation: exceeding maximum distance to Home"
    ),
    Breach.ALTITUDE: (
        "check_gf_violation_max_alt", "Geofence violation: exceeding maximum altitude above Home"
    ),
    Breach.ZONE: ("check_gf_violation_custom_gf", "Geofence violation: approaching or outside geofence"),
}  # fmt: skip
HEALTH_EVENTS = frozenset(
    {
        "check_baro_no_data",
        "check_distance_sensor_missing",
        "check_missing_cpuload",
        "check_optical_sensor_missing",
        "check_parachute_missing",
    }
)
"""Events that PX4 counts as failures of a component in the health summary, not as failed arming checks."""
COMPASS_COUNT = 1
"""Number of compasses of the airframe."""

PRESENT_COMPONENTS = 0x38021C0A
"""Bit mask of the health components of a simulated PX4, recorded from its health summary."""
GPS_PRESENT = 1 << COMPONENT_GPS
"""Bit of PRESENT_COMPONENTS that is set only while GNSS is fused."""
MAG_PRESENT = 1 << COMPONENT_MAGNETOMETER
"""Bit of PRESENT_COMPONENTS that is set only while the magnetometer sends data."""
LOGGING_PRESENT = 0x400
"""Bit of PRESENT_COMPONENTS that is set only while a log is written."""
REMOTE_PRESENT = 1 << COMPONENT_REMOTE


class CheckInputs(NamedTuple):
    """Inputs of the checks: first the values that can change in flight, then the parameters.

    `Checks` reads and compares the values at each check, and reads the parameters when one of them changes.
    """

    mode: NavState
    armed: bool
    valid_attitude: bool
    valid_local_position: bool
    valid_global_position: bool
    has_mission: bool
    offboard_signal: bool
    manual_control: bool
    gcs_missing: bool
    """A ground station is required (NAV_DLL_ACT) and none is connected."""
    battery_warning: int
    """0 normal, 1 low, 2 critical, 3 emergency."""
    terminated: bool
    fence_breaches: frozenset[Breach] = frozenset()
    roll_failure: bool = False
    pitch_failure: bool = False
    wind_too_high: bool = False
    wind_m_s: float = 0.0
    flight_time_over: bool = False
    logging: bool = True
    baro_timeout: bool = False
    mag_timeout: bool = False
    gnss_used: bool = True
    """Whether the estimator fuses GNSS."""
    gps_problem: str = ""
    """Why GPS cannot be used before take-off: a key of GPS_PROBLEMS."""
    distance_sensors: int = 1
    external: ExternalHealth = ExternalHealth()
    """Health reports of the components of external modes."""
    mission_required: bool = False
    uncalibrated: tuple[str, ...] = ()
    """Uncalibrated sensors: \"accel\", \"gyro\" and \"mag\"."""
    compasses_required: int = 1
    """SYS_HAS_MAG."""
    open_drone_id: int = 0
    """COM_ARM_ODID: 1 warns without Open Drone ID, 2 requires it; the simulated vehicle has none."""
    parachute_required: bool = False
    """COM_PARACHUTE; the simulated vehicle has no parachute."""
    distance_sensors_required: int = 0
    """SYS_HAS_NUM_DIST."""
    optical_flow_required: bool = False
    """SYS_HAS_NUM_OF; the simulated vehicle has no optical flow sensor."""
    load_limited: bool = False
    """COM_CPU_MAX or COM_RAM_MAX sets a limit; as PX4 in simulation, the vehicle measures no load."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A finding of the checks."""

    event: str
    modes: int
    """Bit mask of the modes that the finding concerns; in all masks of modes `NavState` is the bit number."""
    component: int
    blocks_arming: int = 0
    """Bit mask of the modes in which the finding prevents arming."""
    blocks_running: int = 0
    """Bit mask of the modes that cannot run because of the finding."""
    text: str = ""
    severity: int = 2
    float_argument: float | None = None
    """None: the event has no float argument."""
    byte_arguments: tuple[int, ...] = ()
    """Arguments of the event, 0..255 each."""
    warns: bool = False
    """Whether the finding is a warning, not an error."""
    external: ExternalEvent | None = None
    """The event of an external component; `modes` replaces the first four bytes of its arguments."""


@dataclass(frozen=True, slots=True)
class CheckResults:
    """The result of all checks."""

    findings: tuple[Finding, ...]
    can_arm: int
    """Bit mask of the modes that allow arming."""
    can_run: int
    """Bit mask of the modes that can run."""
    present: int = PRESENT_COMPONENTS
    """Bit mask of the present health components."""
    requirements: Requirements = BUILT_IN_REQUIREMENTS

    def armable(self, mode: NavState) -> bool:
        """Whether the vehicle can be armed in this mode."""
        return bool(self.can_arm >> mode & 1)

    def runnable(self, mode: NavState) -> bool:
        """Whether the vehicle can switch to this mode in flight."""
        return bool(self.can_run >> mode & 1)


def run_checks(inputs: CheckInputs) -> CheckResults:
    """Runs all checks; the findings are in PX4's order."""
    requirements = inputs.external.requirements
    findings = (
        *_sensor_findings(inputs), *_failure_findings(inputs), *_external_findings(inputs),
        *_mode_findings(inputs), *_system_findings(inputs), *_limit_findings(inputs),
        *_battery_findings(inputs),
    )  # fmt: skip
    can_arm = can_run = EVERY_MODE & ~requirements.other
    can_arm &= ~inputs.external.not_armable
    for finding in findings:
        can_arm &= ~finding.blocks_arming
        can_run &= ~finding.blocks_running
    if not inputs.valid_attitude:
        can_arm = 0
        # External modes that need an attitude cannot run either.
        can_run &= ~((requirements.attitude | requirements.angular_velocity) & BUILT_IN_REQUIREMENTS.other)
    present = PRESENT_COMPONENTS | (REMOTE_PRESENT if inputs.manual_control else 0)
    if not inputs.gnss_used:
        present &= ~GPS_PRESENT
    if inputs.mag_timeout:
        present &= ~MAG_PRESENT
    if not inputs.logging:
        present &= ~LOGGING_PRESENT
    return CheckResults(findings, can_arm, can_run, present, requirements)


def _arming_blocker(event: str, component: int, text: str = "", *byte_arguments: int) -> Finding:
    """A finding that prevents arming in every mode, but lets all modes run."""
    return Finding(event, EVERY_MODE, component, EVERY_MODE, 0, text, byte_arguments=byte_arguments)


def _mode_blocker(event: str, modes: int, component: int = COMPONENT_SYSTEM) -> Finding:
    """A finding that prevents these modes."""
    return Finding(event, modes, component, modes, modes)


def _local_position_modes(requirements: Requirements) -> int:
    return requirements.local_position | requirements.local_position_relaxed


def _sensor_findings(inputs: CheckInputs) -> Iterator[Finding]:
    def uncalibrated(sensor: str, component: int, label: str) -> Iterator[Finding]:
        if sensor in inputs.uncalibrated:
            text = f"Preflight Fail: {label} 0 uncalibrated"
            yield _arming_blocker(f"check_{sensor}_not_calibrated", component, text, 0)

    yield from uncalibrated("accel", COMPONENT_ACCELEROMETER, "Accel")
    if inputs.load_limited:
        text = "Preflight Fail: No CPU and RAM load information"
        yield _arming_blocker("check_missing_cpuload", COMPONENT_SYSTEM, text)
    for number in range(inputs.distance_sensors, inputs.distance_sensors_required):
        text = f"Preflight Fail: distance sensor {number} missing"
        yield _arming_blocker("check_distance_sensor_missing", COMPONENT_DISTANCE_SENSOR, text, number)
    yield from uncalibrated("gyro", COMPONENT_GYRO, "Gyro")
    required = inputs.compasses_required
    if required:
        yield from uncalibrated("mag", COMPONENT_MAGNETOMETER, "Compass")
    if required > COMPASS_COUNT:
        yield _arming_blocker(
            "check_mag_sys_has_mag_missing", COMPONENT_MAGNETOMETER,
            f"Preflight Fail: Found {COMPASS_COUNT} compass (required: {required})", COMPASS_COUNT, required,
        )  # fmt: skip
    if inputs.optical_flow_required:
        text = "Preflight Fail: optical flow sensor missing"
        yield _arming_blocker("check_optical_sensor_missing", COMPONENT_OPTICAL_FLOW, text)
    if inputs.baro_timeout:
        text = "Preflight Fail: No valid data from Baro 0"
        yield _arming_blocker("check_baro_no_data", COMPONENT_ABSOLUTE_PRESSURE, text, 0)
    if inputs.gps_problem:
        event, text = GPS_PROBLEMS[inputs.gps_problem]
        modes = _local_position_modes(inputs.external.requirements)
        yield Finding(event, modes, COMPONENT_GPS, 0, 0, text, WARNING, warns=True)


def _failure_findings(inputs: CheckInputs) -> Iterator[Finding]:
    """Findings of the failure detector."""
    for axis, failed in (("roll", inputs.roll_failure), ("pitch", inputs.pitch_failure)):
        if failed:
            text = f"Preflight Fail: Attitude failure ({axis})"
            yield _arming_blocker(f"check_failure_detector_{axis}", COMPONENT_SYSTEM, text)


def _external_findings(inputs: CheckInputs) -> Iterator[Finding]:
    """Findings about external components."""
    for modes, event in inputs.external.events:
        yield Finding("", modes, COMPONENT_SYSTEM, external=event, warns=True)
    if inputs.external.unresponsive:
        yield _mode_blocker("check_external_modes_unresponsive", inputs.external.unresponsive)


def _mode_findings(inputs: CheckInputs) -> Iterator[Finding]:
    """Requirements of the modes that are not met."""
    requirements, mode = inputs.external.requirements, inputs.mode
    no_takeoff = requirements.prevent_arming
    if no_takeoff >> mode & 1 and not inputs.armed and not inputs.terminated:
        yield Finding("check_modes_cannot_takeoff", no_takeoff, COMPONENT_SYSTEM, no_takeoff)
    if is_external(mode) and not inputs.external.registered >> mode & 1:
        yield _mode_blocker("check_external_modes_unavailable", 1 << mode)
    if not inputs.valid_local_position:
        modes = _local_position_modes(requirements)
        yield _mode_blocker("check_modes_local_pos", modes, COMPONENT_LOCAL_POSITION)
    if not inputs.valid_global_position:
        modes = requirements.global_position | requirements.global_position_relaxed
        modes |= requirements.home_position
        yield _mode_blocker("check_modes_global_pos", modes, COMPONENT_GLOBAL_POSITION)
    if not inputs.has_mission:
        modes = EVERY_MODE if inputs.mission_required else requirements.mission
        yield Finding("check_modes_mission", modes, COMPONENT_SYSTEM, modes, requirements.mission)
    if not inputs.offboard_signal:
        yield _mode_blocker("check_modes_offboard_signal", 1 << NavState.OFFBOARD)
    if not inputs.manual_control:
        modes = requirements.manual_control
        yield Finding("check_modes_manual_control", EVERY_MODE, COMPONENT_REMOTE, modes, modes)


def _system_findings(inputs: CheckInputs) -> Iterator[Finding]:
    if inputs.terminated:
        text = "Preflight Fail: Flight termination active"
        yield _arming_blocker("check_system_flight_term_active", COMPONENT_SYSTEM, text)
    if inputs.gcs_missing:
        yield _arming_blocker("check_rc_dl_no_dllink", COMPONENT_REMOTE_LINK)
    if inputs.open_drone_id:
        prevents_arming = inputs.open_drone_id >= 2
        modes, severity = (EVERY_MODE, 2) if prevents_arming else (0, 4)
        text = "Preflight Fail: Open Drone ID system missing"
        yield Finding("check_open_drone_id_missing", modes, COMPONENT_OPEN_DRONE_ID, modes, 0, text, severity,
                      warns=not prevents_arming)  # fmt: skip
    if inputs.parachute_required:
        text = "Preflight Fail: parachute system missing"
        yield _arming_blocker("check_parachute_missing", COMPONENT_PARACHUTE, text)


def _limit_findings(inputs: CheckInputs) -> Iterator[Finding]:
    """Findings about exceeded limits: fence, flight time, wind."""
    for breach in Breach:
        if breach in inputs.fence_breaches:
            event, text = FENCE_EVENTS[breach]
            yield _arming_blocker(event, COMPONENT_SYSTEM, text)
    if inputs.flight_time_over:
        yield _arming_blocker("check_flight_time_limit", COMPONENT_SYSTEM, "Maximum flight time reached")
    if inputs.wind_too_high:
        yield Finding("check_wind_too_high", EVERY_MODE, COMPONENT_SYSTEM, EVERY_MODE, 0,
                      float_argument=inputs.wind_m_s)  # fmt: skip


def _battery_findings(inputs: CheckInputs) -> Iterator[Finding]:
    warning = inputs.battery_warning
    if warning == 1:
        yield Finding("check_battery_low", EVERY_MODE, COMPONENT_BATTERY)
    elif warning:
        event = "check_battery_critical" if warning == 2 else "check_battery_emergency"
        yield _arming_blocker(event, COMPONENT_BATTERY)


def send_report(report: CheckResults, announcer: Announcer) -> None:
    """Sends the report as PX4 does: summary, one event per finding, health summary."""
    errors = warnings = unhealthy = 0
    for finding in report.findings:
        if finding.external is not None:
            continue
        level = WARNING if finding.warns else EVENTS[finding.event][1] & 0x0F
        if finding.event in HEALTH_EVENTS:
            unhealthy |= 1 << finding.component
        elif level < WARNING:
            errors |= 1 << finding.component
        elif level == WARNING:
            warnings |= 1 << finding.component
        if finding.text:
            announcer.text(finding.severity, finding.text)
    announcer.event(
        "commander_arming_check_summary", "BIIII", 0, errors, warnings, report.can_arm, report.can_run
    )
    for finding in report.findings:
        modes = finding.modes & EVERY_MODE
        if finding.external is not None:
            event_id, log_levels, arguments = finding.external
            announcer.external_event(event_id, log_levels, struct.pack("<I", modes) + arguments[4:])
        elif finding.float_argument is None:
            argument_format = "IB" + "B" * len(finding.byte_arguments)
            announcer.event(finding.event, argument_format, modes, finding.component, *finding.byte_arguments)
        else:
            announcer.event(finding.event, "IBf", modes, finding.component, finding.float_argument)
    announcer.event("commander_health_summary", "BIII", 0, report.present, unhealthy, 0)
