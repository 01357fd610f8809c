"""PX4's flight modes: names in the API, labels for people, and numbers in MAVLink.

`custom_mode` contains the main mode in bits 16–23 and the sub mode in bits 24–31 (PX4 v1.16 and v1.17,
px4_custom_mode.h). `nav_state` is PX4's navigation state, which is also the mode's bit number in the bit
masks of the arming checks.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs_server.mavlink import dialect


@dataclass(frozen=True, slots=True)
class Mode:
    """One flight mode of PX4."""

    name: str
    label: str
    main: int
    sub: int
    nav_state: int
    settable: bool = True
    by_announcement: bool = False
    """Whether the mode, which not every version has, can be set on a vehicle that announces it."""
    """Whether a ground station can request the mode."""

    @property
    def custom_mode(self) -> int:
        """The number in HEARTBEAT and CURRENT_MODE."""
        return self.main << 16 | self.sub << 24


MODES: tuple[Mode, ...] = (
    Mode("manual", "Manual", 1, 0, 0),
    Mode("altitude", "Altitude", 2, 0, 1),
    Mode("position", "Position", 3, 0, 2),
    Mode("orbit", "Orbit", 3, 1, 21, settable=False),
    Mode("position_slow", "Position slow", 3, 2, 6),
    Mode("ready", "Ready", 4, 1, 0, settable=False),
    Mode("takeoff", "Take off", 4, 2, 17),
    Mode("hold", "Hold", 4, 3, 4),
    Mode("mission", "Mission", 4, 4, 3),
    Mode("rtl", "Return", 4, 5, 5),
    Mode("land", "Land", 4, 6, 18),
    Mode("follow", "Follow me", 4, 8, 19),
    Mode("precision_land", "Precision land", 4, 9, 20),
    Mode("vtol_takeoff", "VTOL take off", 4, 10, 22, settable=False),
    *(Mode(f"external_{n}", f"External {n}", 4, 10 + n, 22 + n) for n in range(1, 9)),
    Mode("acro", "Acro", 5, 0, 10),
    Mode("offboard", "Offboard", 6, 0, 14),
    Mode("stabilized", "Stabilized", 7, 0, 15),
    Mode("termination", "Termination", 10, 0, 13, settable=False),
    # v1.17 has this mode; v1.16 accepts its number, but stays in its current mode.
    Mode("altitude_cruise", "Altitude cruise", 11, 0, 8, settable=False, by_announcement=True),
)
BY_NAME = {mode.name: mode for mode in MODES}
BY_CUSTOM_MODE = {mode.custom_mode: mode for mode in MODES}
BY_NAV_STATE = {mode.nav_state: mode for mode in MODES if mode.name != "ready"}

LANDED_STATES = {
    dialect.MAV_LANDED_STATE_UNDEFINED: "unknown",
    dialect.MAV_LANDED_STATE_ON_GROUND: "on_ground",
    dialect.MAV_LANDED_STATE_IN_AIR: "in_air",
    dialect.MAV_LANDED_STATE_TAKEOFF: "taking_off",
    dialect.MAV_LANDED_STATE_LANDING: "landing",
}


def mode_name(custom_mode: int) -> tuple[str, str]:
    """Name and label of a mode; its numbers if the mode is not known."""
    mode = BY_CUSTOM_MODE.get(custom_mode)
    if mode is not None:
        return mode.name, mode.label
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    return f"px4_{main}_{sub}", f"PX4 mode {main}/{sub}"


@dataclass(slots=True)
class ModeNames:
    """The names of one vehicle's modes; an external mode gets its name when it is registered."""

    external: dict[str, str] = field(default_factory=dict[str, str])
    """Registered names of this server's external modes, by name in the API (`external_1` …)."""
    announced: dict[str, str] = field(default_factory=dict[str, str])
    """Registered names of all external modes, as the vehicle last sent them, by name in the API."""
    selectable: set[str] = field(default_factory=set[str])
    """Modes by name in the API that the vehicle has announced as selectable (AVAILABLE_MODES)."""

    def registered(self, mode_name: tuple[str, str]) -> tuple[str, str]:
        """A mode's name in the API with its registered name, otherwise with its label."""
        name, label = mode_name
        return name, self.name_or_label(name, label)

    def label(self, mode: Mode) -> str:
        """The registered name of a mode; otherwise its label."""
        return self.name_or_label(mode.name, mode.label)

    def name_or_label(self, name: str, label: str) -> str:
        """The registered name of the mode with this name in the API; otherwise `label`."""
        return self.external.get(name) or self.announced.get(name, label)
