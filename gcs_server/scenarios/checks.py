"""What must hold in a flight: each check is a class, which is also its part of the scenario's schema."""

from __future__ import annotations

import importlib.util
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator
from shapely import Polygon, contains_xy, distance, points

from gcs_server.scenarios.flown import Flown, VehicleFlight
from missions.dry_run.clearance import obstacle_distance_m
from missions.values import Model, Number

Array = NDArray[np.float64]
Position = tuple[Number | None, Number | None, Number | None]
Seconds = Annotated[float, Field(gt=0.0, le=36_000.0)]


@dataclass(frozen=True, slots=True)
class Broken:
    """A check that did not hold."""

    why: str
    """The values and the limit, as a sentence."""
    vehicle: str
    """Name of the vehicle."""
    t_s: float | None = None
    """When, since arming; None: at no single time."""
    position_ned_m: tuple[float, float, float] | None = None


class Check(Model):
    """What all checks have."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    in_faults: tuple[str, ...] | None = None
    """Names of the matrix' faults in which this must hold; absent: in all flights."""
    vehicle: str | None = None
    """Name of the vehicle (its role); absent: every vehicle of the flight."""

    def judge(self, flown: Flown) -> list[Broken]:
        """What of this check did not hold, for each vehicle; empty: it held."""
        flights = [each for each in flown.vehicles if self.vehicle in (None, each.name) and len(each.t_s)]
        return [broken for each in flights if (broken := self.broken(each, flown)) is not None]

    def broken(self, flight: VehicleFlight, flown: Flown) -> Broken | None:
        """How this check does not hold for one vehicle; None: it holds."""
        raise NotImplementedError

    def title(self) -> str:
        """The check in a few words, for reports."""
        raise NotImplementedError


def _at(flight: VehicleFlight, sample: int, why: str) -> Broken:
    """Something that did not hold at one sample."""
    n, e, d = flight.position_ned_m[sample].round(2).tolist()
    return Broken(why, flight.name, float(flight.t_s[sample]), (n, e, d))


def _place(position: Position) -> str:
    return "(" + ", ".join("any" if each is None else f"{each:g}" for each in position) + ")"


def _distance_m(flight: VehicleFlight, position: Position) -> Array:
    """(N,) distance of the vehicle from a position, along the axes that it names."""
    offsets = [
        flight.position_ned_m[:, axis] - each for axis, each in enumerate(position) if each is not None
    ]
    return np.sqrt(np.sum(np.square(offsets), axis=0))


class Reaches(Check):
    """The vehicle comes near a position."""

    check: Literal["reaches"]
    position_ned_m: Position
    """Position from the first vehicle's home [m]; null: any value on this axis."""
    within_m: Annotated[float, Field(gt=0.0, le=10_000.0)] = 2.0
    """Largest distance that counts as reached [m]."""
    by_s: Seconds | None = None
    """By this time since arming [s]; absent: at any time."""

    @model_validator(mode="after")
    def _names_an_axis(self) -> Reaches:
        if all(each is None for each in self.position_ned_m):
            raise ValueError("position_ned_m names no axis; give at least one number")
        return self

    def title(self) -> str:
        by = "" if self.by_s is None else f" by {self.by_s:g} s"
        return f"reaches {_place(self.position_ned_m)} within {self.within_m:g} m{by}"

    def broken(self, flight: VehicleFlight, flown: Flown) -> Broken | None:
        distance_m = _distance_m(flight, self.position_ned_m)
        reached = np.flatnonzero(distance_m <= self.within_m)
        if len(reached) and (self.by_s is None or flight.t_s[reached[0]] <= self.by_s):
            return None
        if len(reached):
            return _at(flight, int(reached[0]), f"reached only after {flight.t_s[reached[0]]:.1f} s")
        nearest = int(distance_m.argmin())
        return _at(flight, nearest, f"comes no nearer than {distance_m[nearest]:.1f} m")


class StaysWithin(Check):
    """The vehicle stays inside a volume."""

    check: Literal["stays_within"]
    fence: bool = False
    """The geofence of the plan or mission, and of GF_MAX_HOR_DIST and GF_MAX_VER_DIST."""
    radius_m: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    """Largest horizontal distance from the first vehicle's home [m]."""
    height_m: Annotated[float, Field(gt=0.0, le=1e5)] | None = None
    """Largest height above the first vehicle's home [m]."""
    corners_ne_m: Annotated[tuple[tuple[Number, Number], ...], Field(min_length=3)] | None = None
    """North and east of the corners of an area [m]."""

    @model_validator(mode="after")
    def _has_a_bound(self) -> StaysWithin:
        if not self.fence and self.radius_m is None and self.height_m is None and self.corners_ne_m is None:
            raise ValueError("no bound; give one of fence, radius_m, height_m, corners_ne_m")
        return self

    def title(self) -> str:
        bounds = ["the fence"] if self.fence else []
        bounds += [] if self.radius_m is None else [f"{self.radius_m:g} m of home"]
        bounds += [] if self.height_m is None else [f"{self.height_m:g} m of height"]
        bounds += [] if self.corners_ne_m is None else ["the area"]
        return f"stays within {' and '.join(bounds)}"

    def _bounds(self, flight: VehicleFlight, flown: Flown) -> Iterator[tuple[str, Array]]:
        """Name of each bound, with (N,) the distance to it; negative: outside."""
        north, east, down = flight.position_ned_m.T
        if self.fence and flown.fence is not None:
            yield "the fence", flown.fence.distance_m(flight.position_ned_m)
        if self.radius_m is not None:
            yield f"{self.radius_m:g} m of home", self.radius_m - np.hypot(north, east)
        if self.height_m is not None:
            yield f"{self.height_m:g} m of height", self.height_m + down
        if self.corners_ne_m is not None:
            area = Polygon(self.corners_ne_m)
            edge_m = distance(points(north, east), area.exterior)
            yield "the area", np.where(contains_xy(area, north, east), edge_m, -edge_m)

    def broken(self, flight: VehicleFlight, flown: Flown) -> Broken | None:
        if self.fence and (flown.fence is None or not flown.fence.exists):
            return Broken("there is no fence, neither in the plan nor in the parameters", flight.name)
        for name, distance_m in self._bounds(flight, flown):
            outside = np.flatnonzero(distance_m < 0.0)
            if len(outside):
                worst = -float(distance_m.min())
                return _at(flight, int(outside[0]), f"leaves {name} here, later by up to {worst:.1f} m")
        return None


class NeverCloserThan(Check):
    """The vehicle keeps a distance."""

    check: Literal["never_closer_than"]
    distance_m: Annotated[float, Field(gt=0.0, le=10_000.0)]
    """Smallest allowed distance [m]."""
    to: Literal["obstacles", "vehicles"] = "obstacles"
    """What it keeps away from: the obstacles of world, plan and mission, or the other vehicles in the air."""
    position_ned_m: Position | None = None
    """A position to keep away from instead [m]; null: any value on this axis."""

    def title(self) -> str:
        what = self.to if self.position_ned_m is None else _place(self.position_ned_m)
        return f"never closer than {self.distance_m:g} m to {what}"

    def broken(self, flight: VehicleFlight, flown: Flown) -> Broken | None:
        what = self.to
        if self.position_ned_m is not None:
            to_it_m, what = _distance_m(flight, self.position_ned_m), _place(self.position_ned_m)
        elif self.to == "obstacles":
            if not flown.obstacles:
                return Broken("there are no obstacles, neither in the world nor in the plan", flight.name)
            to_it_m, nearest = obstacle_distance_m(flown.obstacles, flight.position_ned_m)
            what = flown.obstacles[int(nearest[int(to_it_m.argmin())])].name
        else:
            others = [each for each in flown.vehicles if each is not flight and len(each.t_s)]
            if not others:
                return Broken("there is no other vehicle", flight.name)
            to_it_m = np.min([_separation_m(flight, each) for each in others], axis=0)
        near = int(to_it_m.argmin())
        if to_it_m[near] >= self.distance_m:
            return None
        return _at(flight, near, f"{to_it_m[near]:.1f} m from {what}")


ON_GROUND_M = 0.5
"""A vehicle lower than this above its start counts as on the ground, where vehicles may be close together."""


def _separation_m(flight: VehicleFlight, other: VehicleFlight) -> Array:
    """(N,) distance from another vehicle; infinite while either is on the ground or not yet armed."""
    there = np.stack(
        [np.interp(flight.t_s, other.t_s, other.position_ned_m[:, axis]) for axis in range(3)], axis=1
    )
    here = flight.position_ned_m
    in_air = (here[:, 2] < -ON_GROUND_M) & (there[:, 2] < -ON_GROUND_M)
    return np.where(in_air, np.linalg.norm(here - there, axis=1), math.inf)


class LandsWithin(Check):
    """The vehicle is on the ground and disarmed at the end, near a position."""

    check: Literal["lands_within"]
    radius_m: Annotated[float, Field(gt=0.0, le=1e6)]
    """Largest horizontal distance [m]."""
    position_ned_m: Position = (0.0, 0.0, None)
    """The position from the first vehicle's home [m]; default: home."""
    by_s: Seconds | None = None
    """By this time since arming [s]; absent: at any time."""

    def title(self) -> str:
        by = "" if self.by_s is None else f" by {self.by_s:g} s"
        return f"lands within {self.radius_m:g} m of {_place(self.position_ned_m)}{by}"

    def broken(self, flight: VehicleFlight, flown: Flown) -> Broken | None:
        last = len(flight.t_s) - 1
        if flight.landed_s is None:
            height_m = max(0.0, -float(flight.position_ned_m[last, 2]))
            return _at(flight, last, f"is armed at the end, {height_m:.1f} m high")
        north, east, _ = self.position_ned_m
        distance_m = float(_distance_m(flight, (north or 0.0, east or 0.0, None))[last])
        if distance_m > self.radius_m:
            return _at(flight, last, f"lands {distance_m:.1f} m away")
        if self.by_s is not None and flight.landed_s > self.by_s:
            return _at(flight, last, f"lands only after {flight.landed_s:.1f} s")
        return None


class ModeBy(Check):
    """The vehicle is in a flight mode by a time."""

    check: Literal["mode_by"]
    mode: Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$")]
    """Name of the mode: offboard, mission, hold, rtl, land, descend …"""
    by_s: Seconds | None = None
    """By this time since arming [s]; absent: at any time."""

    def title(self) -> str:
        return f"mode {self.mode}" + ("" if self.by_s is None else f" by {self.by_s:g} s")

    def broken(self, flight: VehicleFlight, flown: Flown) -> Broken | None:
        times = [t_s for t_s, mode in flight.modes if mode == self.mode]
        if times and (self.by_s is None or times[0] <= self.by_s):
            return None
        if times:
            return Broken(f"only after {times[0]:.1f} s", flight.name, times[0])
        modes = ", ".join(f"{mode} at {t_s:.1f} s" for t_s, mode in flight.modes[:8])
        return Broken(f"never; its modes were {modes}", flight.name)


class SetpointGap(Check):
    """Setpoints arrive at the vehicle without long gaps while it is in Offboard."""

    check: Literal["setpoint_gap"]
    max_s: Annotated[float, Field(gt=0.0, le=60.0)]
    """Longest gap [s]; PX4 leaves Offboard after COM_OF_LOSS_T."""

    def title(self) -> str:
        return f"no setpoint gap above {self.max_s:g} s"

    def broken(self, flight: VehicleFlight, flown: Flown) -> Broken | None:
        ages_s = flight.setpoint_age_s
        if np.isnan(ages_s).all():
            return Broken("the vehicle was never in Offboard", flight.name)
        longest = int(np.nanargmax(ages_s))
        if ages_s[longest] <= self.max_s:
            return None
        return _at(flight, longest, f"no setpoint for {ages_s[longest]:.2f} s")


class NoFailsafe(Check):
    """No failsafe of the vehicle takes over."""

    check: Literal["no_failsafe"]

    def title(self) -> str:
        return "no failsafe"

    def broken(self, flight: VehicleFlight, flown: Flown) -> Broken | None:
        if not flight.failsafes:
            return None
        t_s, text = flight.failsafes[0]
        sample = min(int(np.searchsorted(flight.t_s, t_s)), len(flight.t_s) - 1)
        return _at(flight, sample, f"a failsafe switches to {text}")


class Energy(Check):
    """Enough charge is left at the end."""

    check: Literal["energy"]
    left_percent: Annotated[float, Field(ge=0.0, le=100.0)]
    """Smallest charge at the end [%]."""

    def title(self) -> str:
        return f"at least {self.left_percent:g} % of the battery is left"

    def broken(self, flight: VehicleFlight, flown: Flown) -> Broken | None:
        # PX4's simulated battery is full again after disarming.
        least = int(flight.battery_share.argmin())
        left_percent = 100.0 * float(flight.battery_share[least])
        if left_percent >= self.left_percent:
            return None
        return _at(flight, least, f"{left_percent:.0f} % left")


class Finishes(Check):
    """The program comes to its own end: the whole plan or mission is flown."""

    check: Literal["finishes"]
    by_s: Seconds | None = None
    """By this time since arming [s]; absent: at any time."""

    def title(self) -> str:
        return "finishes" + ("" if self.by_s is None else f" by {self.by_s:g} s")

    def judge(self, flown: Flown) -> list[Broken]:
        first = flown.vehicles[0].name
        if not flown.finished:
            why = "it does not" if flown.end_reason in flown.faults else flown.end_reason
            return [Broken(why, first, flown.duration_s)]
        if self.by_s is not None and flown.duration_s > self.by_s:
            return [Broken(f"only after {flown.duration_s:.1f} s", first, flown.duration_s)]
        return []


class PythonCheck(Check):
    """A function of yours judges the flight."""

    check: Literal["python"]
    function: Annotated[str, Field(pattern=r"^[^:]+\.py:[A-Za-z_]\w*$")]
    """`file.py:function`, beside the scenario. The function gets the flight (`Flown`); a text that it
    returns, False, or an AssertionError is why it does not hold."""

    def title(self) -> str:
        return self.function

    def judge(self, flown: Flown) -> list[Broken]:
        file, _, name = self.function.partition(":")
        first = flown.vehicles[0].name
        try:
            answer = function_of(Path(file), name)(flown)
        except AssertionError as error:
            return [Broken(str(error) or "an assertion failed", first)]
        except Exception as error:
            return [Broken(f"the function failed: {type(error).__name__}: {error}", first)]
        if answer is None or answer is True:
            return []
        return [Broken(answer if isinstance(answer, str) else f"the function returned {answer!r}", first)]


def function_of(file: Path, name: str) -> Callable[..., Any]:
    """A function of a Python file of the user.

    Raises:
        ValueError: there is no such file or function, or the file cannot be imported.
    """
    spec = importlib.util.spec_from_file_location(f"gcs_scenario_{file.stem}", file)
    if not file.is_file() or spec is None or spec.loader is None:
        raise ValueError(f"there is no file {file}")
    module = importlib.util.module_from_spec(spec)
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))  # for what it imports from beside it
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ValueError(f"{file} cannot be imported: {type(error).__name__}: {error}") from error
    function = getattr(module, name, None)
    if not callable(function):
        raise ValueError(f"{file} has no function {name}")
    return function


AnyCheck = Annotated[
    Reaches
    | StaysWithin
    | NeverCloserThan
    | LandsWithin
    | ModeBy
    | SetpointGap
    | NoFailsafe
    | Energy
    | Finishes
    | PythonCheck,
    Field(discriminator="check"),
]
"""Any check, by the name in `check`."""
