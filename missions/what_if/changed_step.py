"""An offboard mission with one changed step. Imports no simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from missions.geodesy import LocalOrigin
from missions.offboard import steps as s
from missions.offboard.document import OffboardMission
from missions.offboard.positions import MissionPosition
from missions.what_if.flight import NotFlyable

Steps = tuple[s.MissionStep, ...]
Moved = tuple[float, float, float]
P = TypeVar("P", bound=MissionPosition)


@dataclass(frozen=True, slots=True)
class StepChange:
    """What is different at one step of an offboard mission."""

    place: str
    """The step as elsewhere: "step 3", "step 4.2". A step of a list changes in all calls of the list, and a
    repeated one in all rounds."""
    point: int | None = None
    """The point of a step that flies through points, from 1; None: all."""
    moved_ned_m: Moved | None = None
    """What is added to its position."""
    speed_m_s: float | None = None
    """Its speed."""
    duration_s: float | None = None
    """How long it holds, waits, or flies a velocity or an attitude; at a point, how long it stops there."""

    @property
    def number(self) -> str:
        """The place without "step"."""
        return number_of(self.place)


def number_of(place: str) -> str:
    """The number of a step in messages: "4.2" of "step 4.2"."""
    return place.removeprefix("step ")


def changed_mission(mission: OffboardMission, change: StepChange) -> OffboardMission:
    """The mission with the change.

    Raises:
        NotFlyable: there is no such step, or it does not have what is changed.
    """
    missions = dict(mission.missions)
    steps = _Search(change, missions).changed(mission.steps, "step ")
    if steps is None:
        raise NotFlyable(f"The mission has no step {change.number}.", "step")
    return mission.model_copy(update={"steps": steps, "missions": missions})


class _Search:
    """Looks for the step by its label, as the compiler makes it.

    Args:
        change: what is different.
        missions: the named lists; a changed one is replaced.
    """

    def __init__(self, change: StepChange, missions: dict[str, Steps]) -> None:
        self._change, self._missions = change, missions

    def changed(self, steps: Steps, prefix: str) -> Steps | None:
        """The steps with the changed one; None: it is not among them. Raises NotFlyable."""
        for index, step in enumerate(steps):
            place = f"{prefix}{index + 1}"
            if place == self._change.place:
                new = _changed_step(step, self._change)
            elif not self._change.place.startswith(place) or (new := self._inside(step, place)) is None:
                continue
            return (*steps[:index], new, *steps[index + 1 :])
        return None

    def _inside(self, step: s.MissionStep, place: str) -> s.MissionStep | None:
        if isinstance(step, s.Repeat):
            new = self.changed(step.steps, f"{place}.")
            return None if new is None else step.model_copy(update={"steps": new})
        if isinstance(step, s.Branch):
            for name in ("then", "otherwise"):
                new = self.changed(getattr(step, name), f"{place} {name} ")
                if new is not None:
                    return step.model_copy(update={name: new})
        if isinstance(step, s.Call):
            new = self.changed(self._missions[step.mission], f"{place}, {step.mission} ")
            if new is not None:
                self._missions[step.mission] = new
                return step
        return None


def _changed_step(step: s.MissionStep, change: StepChange) -> s.MissionStep:
    """Raises NotFlyable: the step does not have what is changed."""
    what = step.step.replace("_", " ")
    if change.point is not None and not isinstance(step, s.Fly):
        raise NotFlyable(f"Step {change.number} ({what}) flies through no points.", "step")
    if change.moved_ned_m is not None:
        step = _moved_step(step, change, change.moved_ned_m, what)
    if change.speed_m_s is not None:
        if not isinstance(step, s.PathStep):
            raise NotFlyable(f"Step {change.number} ({what}) has no speed.", "step")
        step = step.model_copy(update={"speed_m_s": change.speed_m_s})
    if change.duration_s is not None:
        step = _lasting(step, change, change.duration_s, what)
    return step


def _moved_step(step: s.MissionStep, change: StepChange, moved_ned_m: Moved, what: str) -> s.MissionStep:
    if isinstance(step, s.Fly):
        return _with_points(step, change, lambda point: _moved(point, moved_ned_m))
    if isinstance(step, s.Orbit | s.FigureEight):
        return step.model_copy(update={"center": _moved(step.center, moved_ned_m)})
    raise NotFlyable(f"Step {change.number} ({what}) has no position.", "step")


def _lasting(step: s.MissionStep, change: StepChange, duration_s: float, what: str) -> s.MissionStep:
    if isinstance(step, s.Hold | s.VelocityStep | s.AttitudeStep):
        return step.model_copy(update={"duration_s": duration_s})
    if isinstance(step, s.Wait):  # as long, whatever it would have waited for
        return s.Hold(name=step.name or "Wait", duration_s=duration_s)
    if isinstance(step, s.Fly) and change.point is not None:
        return _with_points(step, change, lambda point: point.model_copy(update={"hold_s": duration_s}))
    raise NotFlyable(f"Step {change.number} ({what}) has no duration of its own.", "step")


def _with_points(step: s.Fly, change: StepChange, new: Callable[[s.FlyPoint], s.FlyPoint]) -> s.Fly:
    if change.point is not None and change.point > len(step.points):
        text = f"Step {change.number} has no point {change.point}; it has {len(step.points)}."
        raise NotFlyable(text, "step")
    points = tuple(
        new(point) if change.point in (None, number) else point for number, point in enumerate(step.points, 1)
    )
    return step.model_copy(update={"points": points})


def _moved(position: P, moved_ned_m: Moved) -> P:
    north_m, east_m, down_m = moved_ned_m
    for name in ("position_ned_m", "offset_ned_m"):
        if (old := getattr(position, name)) is not None:
            new = tuple(each + moved for each, moved in zip(old, moved_ned_m, strict=True))
            return position.model_copy(update={name: new})
    origin = LocalOrigin(position.lat_deg or 0.0, position.lon_deg or 0.0, 0.0)
    lat_deg, lon_deg, _ = origin.to_geodetic((north_m, east_m, 0.0))
    update: dict[str, Any] = {"lat_deg": lat_deg, "lon_deg": lon_deg}
    for name in ("alt_amsl_m", "alt_home_m"):
        if (altitude_m := getattr(position, name)) is not None:
            update[name] = altitude_m - down_m
    return position.model_copy(update=update)
