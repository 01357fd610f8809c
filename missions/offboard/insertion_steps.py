"""Adapts the steps of an inserted mission, so that their flight path, speed and avoidance are the same as
when the inserted mission is flown alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from missions.errors import PlanError
from missions.frames import Vector3
from missions.geodesy import LocalOrigin
from missions.offboard import tables
from missions.offboard.document import OffboardMission
from missions.offboard.names import free_name
from missions.offboard.positions import MissionPosition
from missions.offboard.steps import Avoidance, Branch, MissionStep, PathStep, Repeat, Table, VelocityStep
from missions.trajectory.points import MAX_COORDINATE_M
from missions.values import Model

Positions = Literal["from_start", "same_places"]
SAME_PLACE_M = 0.5
"""Planned starts that are nearer to each other than this count as equal [m]."""


@dataclass(frozen=True, slots=True)
class StartConversion:
    """Converts positions relative to the planned start of the inserted mission into positions relative to the
    planned start of the vehicle that will fly its steps."""

    home: LocalOrigin
    inserted_home: LocalOrigin
    starts_ned_m: tuple[Vector3, ...]
    """Planned starts of the vehicles that fly the inserted steps, relative to `home`."""

    def convert_local(self, position_ned_m: Vector3) -> Vector3:
        """A position relative to `inserted_home`, as a position relative to `home` (NED)."""
        return self.home.to_ned(*self.inserted_home.to_geodetic(position_ned_m))

    def convert_offset(self, offset_ned_m: Vector3) -> Vector3:
        """An offset from `inserted_home`, as an offset from the start of the only vehicle (NED)."""
        n, e, d = self.convert_local(offset_ned_m)
        from_n, from_e, from_d = self.starts_ned_m[0]
        return (n - from_n, e - from_e, d - from_d)

    def convert_alt_home(self, alt_home_m: float) -> float:
        """An altitude above `inserted_home`, as an altitude above the start of the only vehicle."""
        return alt_home_m + self.inserted_home.alt_amsl_m - self.home.alt_amsl_m + self.starts_ned_m[0][2]

    @property
    def distance_m(self) -> float:
        """The largest distance between the planned start of the inserted mission and `starts_ned_m`."""
        north, east, down = self.convert_local((0.0, 0.0, 0.0))
        return max(math.dist((north, east, down), start) for start in self.starts_ned_m)


def start_conversion(
    mission: OffboardMission, inserted: OffboardMission, role: str | None
) -> StartConversion | None:
    """The conversion between the two planned starts; None: the starts are equal, or one start is unknown.

    Args:
        mission: the mission to change.
        inserted: the mission to insert.
        role: the role that flies the inserted steps; None: all roles, or the only vehicle.
    """
    if mission.home is None or inserted.home is None:
        return None
    roles = mission.roles.values() if role is None else (mission.roles[role],)
    starts = {each.start_ned_m or (0.0, 0.0, 0.0) for each in roles} or {(0.0, 0.0, 0.0)}
    home, inserted_home = (LocalOrigin(**each.model_dump()) for each in (mission.home, inserted.home))
    conversion = StartConversion(home, inserted_home, tuple(sorted(starts)))
    return conversion if conversion.distance_m > SAME_PLACE_M else None


class Adapter:
    """Adapts steps, and collects the tables that they need.

    Args:
        mission: the mission to change.
        inserted: the mission to insert.
        conversion: the result of `start_conversion`.
        positions: how positions relative to start or home are inserted; None: refused if
            the planned starts differ.
    """

    def __init__(
        self,
        mission: OffboardMission,
        inserted: OffboardMission,
        conversion: StartConversion | None,
        positions: Positions | None,
    ) -> None:
        self._mission = mission
        self._inserted = inserted
        self._conversion = conversion
        self._positions = positions
        self._has_relative_positions = False
        self.tables = dict(mission.tables)
        """The tables of the mission and of the adapted steps."""

    def steps(self, steps: Iterable[MissionStep]) -> tuple[MissionStep, ...]:
        """The adapted steps.

        Raises:
            PlanError: A step would be flown differently in the new mission.
        """
        return tuple(self._step(step) for step in steps)

    def notes(self) -> list[str]:
        """Changes of the positions, as sentences."""
        if not self._has_relative_positions or self._inserted.home is None:
            return []
        new_reference = "Positions relative to start or home now refer to the start and home of this mission"
        if self._mission.home is None:
            return [f"{new_reference}, which has no planned home."]
        if self._conversion is None:
            return []
        distance_text = f"The planned starts are {self._conversion.distance_m:.0f} m apart."
        if self._positions == "from_start":
            return [f"{distance_text} {new_reference}."]
        return [
            f"{distance_text} Positions relative to start or home are converted and stay at the same places."
        ]

    def _step(self, step: MissionStep) -> MissionStep:
        if isinstance(step, Repeat):
            return step.model_copy(update={"steps": self.steps(step.steps)})
        if isinstance(step, Branch):
            lists = {"then": self.steps(step.then), "otherwise": self.steps(step.otherwise)}
            return step.model_copy(update=lists)
        adapted: MissionStep = _with_positions_changed(step, self._position)
        if isinstance(adapted, PathStep):
            return adapted.model_copy(update=self._path_settings(adapted))
        if isinstance(adapted, Table | VelocityStep):
            self._check_avoidance(adapted)
        if isinstance(adapted, Table):
            return adapted.model_copy(update={"file": self._table(adapted)})
        return adapted

    def _path_settings(self, step: PathStep) -> dict[str, Any]:
        """The speed and avoidance that the inserted mission sets for the step."""
        settings: dict[str, Any] = {}
        limit_m_s, mission_m_s = self._inserted.limits.speed_m_s, self._mission.limits.speed_m_s
        if limit_m_s is not None and (mission_m_s is None or limit_m_s < mission_m_s):
            settings["speed_m_s"] = min(step.speed_m_s or limit_m_s, limit_m_s)
        if step.avoidance is None and self._avoids_differently():
            settings["avoidance"] = self._inserted.avoidance
        return settings

    def _avoids_differently(self) -> bool:
        return _avoidance_way(self._inserted.avoidance) != _avoidance_way(self._mission.avoidance)

    def _check_avoidance(self, step: Table | VelocityStep) -> None:
        if self._avoids_differently():
            reason = (
                f"its `avoidance` is {_avoidance_text(self._inserted.avoidance)}, that of this mission is "
                f"{_avoidance_text(self._mission.avoidance)}, and a {step.step} step has no own `avoidance`"
            )
            raise self._error(step, reason, "Set `avoidance` of both missions to the same value.")

    def _position(self, position: MissionPosition) -> MissionPosition:
        conversion = self._conversion
        is_ned = position.position_ned_m is not None or position.offset_ned_m is not None
        if not is_ned and position.alt_home_m is None:
            return position
        self._has_relative_positions = True
        if conversion is None or not self._converts(conversion):
            return position
        converted: dict[str, Any] = {}
        if position.position_ned_m is not None:
            converted["position_ned_m"] = conversion.convert_local(position.position_ned_m)
        if position.offset_ned_m is not None:
            converted["offset_ned_m"] = conversion.convert_offset(position.offset_ned_m)
        if position.alt_home_m is not None:
            converted["alt_home_m"] = conversion.convert_alt_home(position.alt_home_m)
        for value in converted.values():
            _check_coordinates(value if isinstance(value, tuple) else (value,))
        return position.model_copy(update=converted)

    def _converts(self, conversion: StartConversion) -> bool:
        """Whether positions relative to start or home are converted, so that they stay at the same places."""
        if self._positions is None:
            raise PlanError(
                "field positions",
                f"{self._inserted.name!r} has positions relative to its start or home, and the planned "
                f"starts of the two missions are {conversion.distance_m:.0f} m apart",
                "Choose from_start (they refer to the start of this mission) or same_places (they are "
                "converted and stay at the planned places).",
                field="positions",
            )
        if self._positions == "same_places" and len(conversion.starts_ned_m) > 1:
            raise PlanError(
                "field positions",
                "the roles that may fly this list have different planned starts, so the inserted positions "
                "cannot stay at the same places for all of them",
                "Insert the mission into the steps of one role, or choose from_start.",
                field="positions",
            )
        return self._positions == "same_places"

    def _table(self, step: Table) -> str:
        """Adds the step's table to the mission unless the mission has it; returns the name of the table."""
        text = self._inserted.tables.get(step.file)
        if text is None:
            fix = "Add the table to the mission: steps of an inserted mission cannot read other files."
            raise self._error(step, f"the mission has no table {step.file!r}", fix)
        self._has_relative_positions = True
        if self._conversion is not None and self._converts(self._conversion):
            text = _converted_table(
                text, self._conversion.convert_offset if step.relative else self._conversion.convert_local
            )
        name = free_name(step.file, lambda name: self.tables.get(name, text) != text)
        self.tables[name] = text
        return name

    def _error(self, step: MissionStep, reason: str, fix: str) -> PlanError:
        return PlanError(f"mission {self._inserted.name!r}, step {step.name or step.step!r}", reason, fix)


def _converted_table(text: str, convert: Callable[[Vector3], Vector3]) -> str:
    rows: list[list[float]] = []
    for row in tables.read_rows(text.encode()):
        position = convert((row[1], row[2], row[3]))
        _check_coordinates(position)
        rows.append([row[0], *position, *row[4:]])
    return tables.csv_text(rows)


def _check_coordinates(values: Sequence[float]) -> None:
    if any(abs(value) > MAX_COORDINATE_M for value in values):
        raise PlanError(
            "field positions",
            f"a position is more than {MAX_COORDINATE_M / 1000:.0f} km from the start of this mission",
            "Choose from_start, or correct the planned home of one mission.",
            field="positions",
        )


def _with_positions_changed(value: Any, change: Callable[[MissionPosition], MissionPosition]) -> Any:
    """A copy of a step in which `change` was applied to all positions."""
    if isinstance(value, MissionPosition):
        return change(value)
    if isinstance(value, Model):
        return value.model_copy(update={name: _with_positions_changed(each, change) for name, each in value})
    if isinstance(value, tuple):
        return tuple(_with_positions_changed(each, change) for each in value)
    return value


def _avoidance_way(avoidance: Avoidance) -> str | None:
    return ("over" if avoidance else None) if isinstance(avoidance, bool) else avoidance


def _avoidance_text(avoidance: Avoidance) -> str:
    return _avoidance_way(avoidance) or "off"
