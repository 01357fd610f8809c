"""Arming checks: the modes that can run, the modes that allow arming, and PX4's report of the findings."""

from __future__ import annotations

import struct
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
    findings: list[Finding] = []
    requirements = inputs.external.requirements

    def add(event: str, modes: int, component: int, arming: int | None = None, running: int | None = None,
            text: str = "") -> None:  # fmt: skip
        """Adds a finding; `arming` and `running` are the blocked modes, None: all of `modes`."""
        findings.append(
            Finding(event, modes, component, modes if arming is None else arming,
                    modes if running is None else running, text)
        )  # fmt: skip

    def add_uncalibrated(sensor: str, component: int, label: str) -> None:
        if sensor in inputs.uncalibrated:
            findings.append(
                Finding(f"check_{sensor}_not_calibrated", EVERY_MODE, component, EVERY_MODE, 0,
                        f"Preflight Fail: {label} 0 uncalibrated", byte_arguments=(0,))
            )  # fmt: skip

    add_uncalibrated("accel", COMPONENT_ACCELEROMETER, "Accel")
    if inputs.load_limited:
        add("check_missing_cpuload", EVERY_MODE, COMPONENT_SYSTEM, running=0,
            text="Preflight Fail: No CPU and RAM load information")  # fmt: skip
    for number in range(inputs.distance_sensors, inputs.distance_sensors_required):
        text = f"Preflight Fail: distance sensor {number} missing"
        findings.append(
            Finding("check_distance_sensor_missing", EVERY_MODE, COMPONENT_DISTANCE_SENSOR, EVERY_MODE, 0,
                    text, byte_arguments=(number,))
        )  # fmt: skip
    add_uncalibrated("gyro", COMPONENT_GYRO, "Gyro")
    if inputs.compasses_required:
        add_uncalibrated("mag", COMPONENT_MAGNETOMETER, "Compass")
    if inputs.compasses_required > COMPASS_COUNT:
        required = inputs.compasses_required
        text = f"Preflight Fail: Found {COMPASS_COUNT} compass (required: {required})"
        findings.append(
            Finding("check_mag_sys_has_mag_missing", EVERY_MODE, COMPONENT_MAGNETOMETER, EVERY_MODE, 0, text,
                    byte_arguments=(COMPASS_COUNT, required))
        )  # fmt: skip
    if inputs.optical_flow_required:
        add("check_optical_sensor_missing", EVERY_MODE, COMPONENT_OPTICAL_FLOW, running=0,
            text="Preflight Fail: optical flow sensor missing")  # fmt: skip
    if inputs.baro_timeout:
        text = "Preflight Fail: No valid data from Baro 0"
        findings.append(
            Finding("check_baro_no_data", EVERY_MODE, COMPONENT_ABSOLUTE_PRESSURE, EVERY_MODE, 0, text,
                    byte_arguments=(0,))
        )  # fmt: skip
    if inputs.gps_problem:
        event, text = GPS_PROBLEMS[inputs.gps_problem]
        findings.append(
            Finding(event, _local_position_modes(requirements), COMPONENT_GPS, 0, 0, text, WARNING,
                    warns=True)
        )  # fmt: skip
    findings += _failure_findings(inputs)
    findings += _external_findings(inputs)
    if requirements.prevent_arming >> inputs.mode & 1 and not inputs.armed and not inputs.terminated:
        add("check_modes_cannot_takeoff", requirements.prevent_arming, COMPONENT_SYSTEM, running=0)
    if is_external(inputs.mode) and not inputs.external.registered >> inputs.mode & 1:
        add("check_external_modes_unavailable", 1 << inputs.mode, COMPONENT_SYSTEM)
    if not inputs.valid_local_position:
        add("check_modes_local_pos", _local_position_modes(requirements), COMPONENT_LOCAL_POSITION)
    if not inputs.valid_global_position:
        add("check_modes_global_pos", requirements.global_position | requirements.home_position,
            COMPONENT_GLOBAL_POSITION)  # fmt: skip
    if not inputs.has_mission:
        add("check_modes_mission", EVERY_MODE if inputs.mission_required else requirements.mission,
            COMPONENT_SYSTEM, running=requirements.mission)  # fmt: skip
    if not inputs.offboard_signal:
        add("check_modes_offboard_signal", 1 << NavState.OFFBOARD, COMPONENT_SYSTEM)
    if not inputs.manual_control:
        add("check_modes_manual_control", EVERY_MODE, COMPONENT_REMOTE, requirements.manual_control,
            requirements.manual_control)  # fmt: skip
    if inputs.terminated:
        add("check_system_flight_term_active", EVERY_MODE, COMPONENT_SYSTEM, running=0,
            text="Preflight Fail: Flight termination active")  # fmt: skip
    if inputs.gcs_missing:
        add("check_rc_dl_no_dllink", EVERY_MODE, COMPONENT_REMOTE_LINK, running=0)
    if inputs.open_drone_id:
        prevents_arming = inputs.open_drone_id >= 2
        modes, severity = (EVERY_MODE, 2) if prevents_arming else (0, 4)
        text = "Preflight Fail: Open Drone ID system missing"
        findings.append(
            Finding("check_open_drone_id_missing", modes, COMPONENT_OPEN_DRONE_ID, modes, 0, text, severity,
                    warns=not prevents_arming)
        )  # fmt: skip
    if inputs.parachute_required:
        add("check_parachute_missing", EVERY_MODE, COMPONENT_PARACHUTE, running=0,
            text="Preflight Fail: parachute system missing")  # fmt: skip
    findings += _limit_findings(inputs)
    if inputs.battery_warning == 1:
        add("check_battery_low", EVERY_MODE, COMPONENT_BATTERY, 0, 0)
    elif inputs.battery_warning == 2:
        add("check_battery_critical", EVERY_MODE, COMPONENT_BATTERY, running=0)
    elif inputs.battery_warning >= 3:
        add("check_battery_emergency", EVERY_MODE, COMPONENT_BATTERY, running=0)
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
    return CheckResults(tuple(findings), can_arm, can_run, present, requirements)


def _local_position_modes(requirements: Requirements) -> int:
    return requirements.local_position | requirements.local_position_relaxed


def _external_findings(inputs: CheckInputs) -> list[Finding]:
    """Findings about external components."""
    external = inputs.external
    findings = [
        Finding("", modes, COMPONENT_SYSTEM, external=event, warns=True) for modes, event in external.events
    ]
    if external.unresponsive:
        findings.append(
            Finding("check_external_modes_unresponsive", external.unresponsive, COMPONENT_SYSTEM,
                    external.unresponsive, external.unresponsive)
        )  # fmt: skip
    return findings


FENCE_EVENTS = {
    Breach.DISTANCE: (
        "check_gf_violation_max_hor_dist", "Geofence violation: exceeding maximum distance to Home"
    ),
    Breach.ALTITUDE: (
        "check_gf_violation_max_alt", "Geofence violation: exceeding maximum altitude above Home"
    ),
    Breach.ZONE: ("check_gf_violation_custom_gf", "Geofence violation: approaching or outside geofence"),
}  # fmt: skip


def _arming_blocker(event: str, component: int, text: str) -> Finding:
    """A finding that prevents arming in every mode, but lets all modes run."""
    return Finding(event, EVERY_MODE, component, EVERY_MODE, 0, text)


def _failure_findings(inputs: CheckInputs) -> list[Finding]:
    """Findings of the failure detector."""
    failures: list[tuple[str, int, str]] = []
    if inputs.roll_failure:
        text = "Preflight Fail: Attitude failure (roll)"
        failures.append(("check_failure_detector_roll", COMPONENT_SYSTEM, text))
    if inputs.pitch_failure:
        text = "Preflight Fail: Attitude failure (pitch)"
        failures.append(("check_failure_detector_pitch", COMPONENT_SYSTEM, text))
    return [_arming_blocker(*each) for each in failures]


def _limit_findings(inputs: CheckInputs) -> list[Finding]:
    """Findings about exceeded limits: fence, flight time, wind."""
    findings = [_arming_blocker(FENCE_EVENTS[breach][0], COMPONENT_SYSTEM, FENCE_EVENTS[breach][1])
              for breach in Breach if breach in inputs.fence_breaches]  # fmt: skip
    if inputs.flight_time_over:
        findings.append(
            _arming_blocker("check_flight_time_limit", COMPONENT_SYSTEM, "Maximum flight time reached")
        )
    if inputs.wind_too_high:
        findings.append(
            Finding("check_wind_too_high", EVERY_MODE, COMPONENT_SYSTEM, EVERY_MODE, 0,
                    float_argument=inputs.wind_m_s)
        )  # fmt: skip
    return findings


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
