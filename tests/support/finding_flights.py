"""Simulated flights with faults, whose logs are to show them: many vehicles of one fleet fly at once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import frame_v2
from vehicle_sim.script import script_from_fields
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.yaml_fields import parse_yaml

ARM, TAKEOFF, LAND, REPOSITION, SET_MODE = 400, 22, 21, 192, 176
GUIDED = 1
NAN = math.nan
HEIGHT_M = 12.0
OFFBOARD_SPAN_S = (40.0, 75.0)


@dataclass(frozen=True)
class Case:
    """One fault: its effect in a fault script, and the kinds of findings of which one has to be found."""

    name: str
    event: str
    """Fields of a fault script's event; empty: a healthy flight."""
    expected: frozenset[str]
    offboard: bool = False
    """Whether it flies in Offboard for a while; with a gap in the stream if a finding is expected."""


def case(name: str, event: str, *expected: str, offboard: bool = False) -> Case:
    """A case; the fault begins 8 s after take-off unless the event says when."""
    if event and not event.startswith(("when", "at_s")):
        event = f"when: airborne, after_s: 8, {event}"
    return Case(name, event, frozenset(expected), offboard)


CASES = (
    case("healthy", ""),
    case("healthy in Offboard", "", offboard=True),
    case("healthy in wind", "when: airborne, wind_ned_m_s: [0, 5, 0], gusts_m_s: 1"),
    case("vibration", "vibration_m_s2: 4", "vibration"),
    case("GPS lost", "gps: lost", "gps_quality"),
    case("few satellites", "parameter: {name: SIM_GPS_USED, value: 4}", "gps_quality"),
    case("GPS stuck", "gps: stuck", "innovation", "reset", "gps_quality"),
    case("GPS jumps", "gps_offset_ned_m: [60, 0, 0]", "innovation", "reset"),
    case("GPS jammed", "gps_jamming: 130", "gps_interference"),
    case("GPS receiver stops", "driver: {name: sensor_gps_sim, runs: false}", "gps_quality"),
    case("weak motor", "when: armed, motor: {number: 2, thrust: 0.55}", "imbalance"),
    case("motor stops", "motor: {number: 2}", "attitude_tracking", "saturation", "oscillation"),
    case("too heavy", "when: armed, parameter: {name: SIH_MASS, value: 1.75}", "saturation"),
    case("oscillating gains", "parameter: {name: MC_ROLL_P, value: 16}", "oscillation"),
    case("worn battery", "when: armed, battery_resistance_ohm: 0.12", "battery_resistance"),
    case("battery sags", "when: armed, battery_resistance_ohm: 0.2", "battery_sag"),
    case("battery empty", "battery_percent: 5", "battery_charge"),
    case("processor loaded", "cpu_load: 0.98", "load"),
    case("link cut", "link: {name: gcs, up: false}", "link"),
    case("fence", "parameter: {name: GF_MAX_VER_DIST, value: 8}", "fence"),
    case("setpoints pause", "", "setpoint_gap", offboard=True),
)


def fly(one: Case, folder: Path, count: int, seed: int) -> list[Path]:
    """Flies `count` vehicles with a fault, each with its own noise: take-off, three legs, landing.

    Returns:
        The log of each vehicle.
    """
    event = f"events:\n  - {{{one.event}}}\n" if one.event else "events: []\n"
    files = [VehicleFiles(folder / str(row)) for row in range(count)]
    fleet = SimulatedFleet(
        count, seed=seed, files=files, log=True, links=(("gcs", "gcs"),),
        script=script_from_fields(parse_yaml(f"name: x\n{event}", "case.yaml")) if one.event else None,
        parameters={"SDLOG_PROFILE": 1, "SDLOG_MODE": 0, "NAV_RCL_ACT": 0, "COM_RC_IN_MODE": 4},
    )  # fmt: skip
    pilot = _Pilot(fleet, pauses=bool(one.expected) and one.offboard)
    pilot.fly(one.offboard)
    for logger in fleet.loggers:
        logger.stop()
    return [folder / str(row) / str(logger.path) for row, logger in enumerate(fleet.loggers)]


class _Pilot:
    """Commands all vehicles of a fleet alike."""

    def __init__(self, fleet: SimulatedFleet, *, pauses: bool) -> None:
        self.fleet, self.pauses = fleet, pauses
        self.sequence = 0

    def fly(self, offboard: bool) -> None:
        """The whole flight on simulated time."""
        steps = [
            (12.0, lambda row: self.command(row, ARM, 1)),
            (13.0, lambda row: self.command(row, TAKEOFF, -1, 0, 0, NAN, NAN, NAN, self.altitude(row))),
            (30.0, lambda row: self.reposition(row, 12.0, 0.0)),
            (40.0, lambda row: self.reposition(row, 12.0, 12.0)),
            (50.0, lambda row: self.reposition(row, 0.0, 0.0)),
            (76.0, lambda row: self.command(row, LAND, 0, 0, 0, NAN, NAN, NAN, NAN)),
        ]  # fmt: skip
        if offboard:
            steps[3:5] = [(OFFBOARD_SPAN_S[0] + 1.0, lambda row: self.command(row, SET_MODE, 1, 6))]
        heartbeat_s = 0.0
        while self.fleet.time_s < 100.0:
            now_s = self.fleet.time_s
            while steps and now_s >= steps[0][0]:
                act = steps.pop(0)[1]
                for row in range(len(self.fleet.autopilots)):
                    act(row)
            if now_s >= heartbeat_s:
                heartbeat_s += 1.0
                self.to_all("HEARTBEAT", type=6, autopilot=8, mavlink_version=3)
            if offboard and OFFBOARD_SPAN_S[0] <= now_s < OFFBOARD_SPAN_S[1] and not self.is_pausing(now_s):
                self.to_all(
                    "SET_POSITION_TARGET_LOCAL_NED", target_component=1, coordinate_frame=1, type_mask=0xDF8,
                    x=12.0 - 0.3 * (now_s - 40.0), y=0.0, z=-HEIGHT_M,
                )  # fmt: skip
            self.fleet.step(0.1)
            for row in range(len(self.fleet.autopilots)):
                self.fleet.drain(row, "gcs")

    def is_pausing(self, now_s: float) -> bool:
        """Whether the stream of setpoints is interrupted."""
        return self.pauses and 55.0 <= now_s < 56.6

    def altitude(self, row: int) -> float:
        """Altitude of the take-off's end [m AMSL]."""
        return self.fleet.autopilots[row].home.alt_amsl_m + HEIGHT_M

    def reposition(self, row: int, north_m: float, east_m: float) -> None:
        """Sends a vehicle to a place relative to its home."""
        home = self.fleet.autopilots[row].home
        lat = home.lat_deg + math.degrees(north_m / 6_371_000.0)
        lon = home.lon_deg + math.degrees(east_m / 6_371_000.0) / math.cos(math.radians(home.lat_deg))
        self.send(
            row, "COMMAND_INT", target_system=row + 1, target_component=1, frame=0, command=REPOSITION,
            param1=-1.0, param2=GUIDED, param4=math.nan, x=round(lat * 1e7), y=round(lon * 1e7),
            z=self.altitude(row),
        )  # fmt: skip

    def command(self, row: int, command_id: int, *parameters: float) -> None:
        """Sends a command to a vehicle."""
        values = {f"param{n + 1}": value for n, value in enumerate(parameters)}
        self.send(
            row, "COMMAND_LONG", target_system=row + 1, target_component=1, command=command_id, **values
        )

    def to_all(self, name: str, **fields: Any) -> None:
        """Sends a message to all vehicles."""
        for row in range(len(self.fleet.autopilots)):
            target = {} if name == "HEARTBEAT" else {"target_system": row + 1}
            self.send(row, name, **target, **fields)

    def send(self, row: int, name: str, **fields: Any) -> None:
        """Sends a message as a ground station."""
        layout, payload = pack(name, **fields)
        self.sequence = (self.sequence + 1) & 0xFF
        self.fleet.feed(row, "gcs", frame_v2(layout, payload, self.sequence, 255, 190))
