"""Messages with mode, arming state, health, clock and battery."""

from __future__ import annotations

import math

from vehicle_sim.autopilot.health import (
    COMPONENT_ABSOLUTE_PRESSURE,
    COMPONENT_BATTERY,
    COMPONENT_GPS,
    COMPONENT_LOCAL_POSITION,
    COMPONENT_REMOTE,
    GPS_PRESENT,
    LOGGING_PRESENT,
    MAG_PRESENT,
    REMOTE_PRESENT,
    CheckResults,
)
from vehicle_sim.autopilot.modes import MODES
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.messages.message_group import MessageGroup, base_mode, system_status

ALWAYS_PRESENT = 0x200400B
"""MAV_SYS_STATUS_SENSOR: gyroscope, accelerometer, barometer, horizontal position control, battery."""
GPS_BIT, POSITION_BIT, REMOTE_BIT, BATTERY_BIT, LOGGING_BIT = 0x20, 0x4000, 0x10000, 0x2000000, 0x1000000
ALL_HEALTHY = 0x321C83F
"""In PX4 a sensor without a failed check counts as healthy, even if the sensor is not present."""
MAG_BIT, BARO_BIT, PREARM_BIT = 0x04, 0x08, 0x10000000
"""Bits of MAV_SYS_STATUS_SENSOR, as the bits above."""
BIT_OF_FAILED_COMPONENT = {
    COMPONENT_REMOTE: REMOTE_BIT, COMPONENT_BATTERY: BATTERY_BIT, COMPONENT_LOCAL_POSITION: POSITION_BIT,
    COMPONENT_GPS: GPS_BIT, COMPONENT_ABSOLUTE_PRESSURE: BARO_BIT,
}  # fmt: skip
BIT_OF_PRESENT_COMPONENT = {
    GPS_PRESENT: GPS_BIT, MAG_PRESENT: MAG_BIT, LOGGING_PRESENT: LOGGING_BIT, REMOTE_PRESENT: REMOTE_BIT,
}  # fmt: skip


class StateMessages(MessageGroup):
    """Builders of the messages with mode, arming state, health, clock and battery."""

    def heartbeat(self) -> bytes:
        commander = self._autopilot.commander
        return pack(
            "HEARTBEAT",
            type=2,
            autopilot=12,
            base_mode=base_mode(commander),
            custom_mode=commander.custom_mode(),
            system_status=system_status(commander),
            mavlink_version=3,
        )[1]

    def sys_status(self) -> bytes:
        commander, battery, i = self._autopilot.commander, self._view.simulation.battery, self._view.row
        can_arm = commander.report.armable(
            commander.active if commander.armed else commander.intended_or_replacement
        )
        present, enabled, healthy = self._sensors(commander.report)
        return pack(
            "SYS_STATUS",
            onboard_control_sensors_present=present,
            onboard_control_sensors_enabled=enabled,
            onboard_control_sensors_health=healthy | (PREARM_BIT if can_arm else 0),
            load=100,
            voltage_battery=round(float(battery.voltage_v[i]) * 1000),
            current_battery=round(float(battery.current_a[i]) * 100),
            battery_remaining=math.ceil(float(battery.remaining[i]) * 100),
            onboard_control_sensors_health_extended=1,
        )[1]

    def _sensors(self, report: CheckResults) -> tuple[int, int, int]:
        """Present, enabled and healthy sensors according to the arming checks.

        A sensor with a failed check counts as enabled, even if the sensor is not present. Without an attitude
        estimate no sensor is present or enabled, and all are healthy.
        """
        if not self._view.estimate.valid_attitude:
            return 0, 0, ALL_HEALTHY
        failed = 0
        for finding in report.findings:
            failed |= BIT_OF_FAILED_COMPONENT.get(finding.component, 0)
        present = ALWAYS_PRESENT
        for component, bit in BIT_OF_PRESENT_COMPONENT.items():
            present |= bit if report.present & component else 0
        return present, present | failed, ALL_HEALTHY & ~failed

    def extended_sys_state(self) -> bytes:
        return pack("EXTENDED_SYS_STATE", landed_state=self._autopilot.commander.landed_state())[1]

    def current_mode(self) -> bytes:
        commander = self._autopilot.commander
        return pack(
            "CURRENT_MODE",
            standard_mode=MODES[commander.active].standard_mode,
            custom_mode=commander.custom_mode(),
            intended_custom_mode=commander.intended_custom_mode(),
        )[1]

    def system_time(self) -> bytes:
        view = self._view
        return pack("SYSTEM_TIME", time_unix_usec=view.time_unix_us(), time_boot_ms=view.time_boot_ms())[1]

    def battery_status(self) -> bytes:
        battery, i = self._view.simulation.battery, self._view.row
        voltage_mv = round(float(battery.voltage_v[i]) * 1000)
        warning = self._autopilot.commander.checks.battery_warning
        return pack(
            "BATTERY_STATUS",
            battery_function=1,
            type=1,
            temperature=32767,
            voltages=[voltage_mv] + [65535] * 9,
            current_battery=round(float(battery.current_a[i]) * 100),
            current_consumed=round(float(battery.consumed_mah[i])),
            energy_consumed=-1,
            battery_remaining=math.ceil(float(battery.remaining[i]) * 100),
            charge_state=1 + warning,
        )[1]
