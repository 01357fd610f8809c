"""Judgements of flights, without a simulation."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from gcs_server.scenarios.checks import AnyCheck
from gcs_server.scenarios.flown import Flown, VehicleFlight
from missions.dry_run.clearance import FenceDistance
from missions.dry_run.setup import Obstacle
from missions.geodesy import LocalOrigin

COUNT = 101


def flight(east_m: float = 0.0, name: str = "vehicle") -> VehicleFlight:
    """Ten seconds: up 10 m, 40 m north and back, landed; in Offboard from 2 to 8 s."""
    t_s = np.round(np.arange(COUNT) * 0.1, 2)
    up = np.interp(t_s, (0, 1, 9, 10), (0, 10, 10, 0))
    north = np.interp(t_s, (0, 1, 5, 9, 10), (0, 0, 40, 0, 0))
    age = np.where((t_s >= 2) & (t_s <= 8), 0.02, math.nan)
    return VehicleFlight(
        name,
        t_s,
        np.column_stack((north, np.full(COUNT, east_m), -up)),
        np.full(COUNT, 10.0),
        np.linspace(1.0, 0.5, COUNT),
        age,
        ((0.0, "takeoff"), (2.0, "offboard"), (8.0, "rtl")),
        (),
        True,
        10.0,
        (),
    )


def flown(*vehicles: VehicleFlight, **fields: object) -> Flown:
    """A flight that finished."""
    return replace(Flown(vehicles or (flight(),), True, ""), **fields)


def why(check: dict[str, object], of: Flown) -> list[str]:
    """Why a check does not hold."""
    parsed = TypeAdapter(AnyCheck).validate_python(check, strict=False)
    return [broken.why for broken in parsed.judge(of)]


WALL = Obstacle("wall", 44.0, 0.0, 2.0, 10.0, 20.0)
FENCE = FenceDistance((), LocalOrigin(47.0, 8.0, 500.0), 30.0, 0.0)
FAILED = replace(flight(), failsafes=((5.0, "descend: no valid position estimate"),))
GAP = replace(flight(), setpoint_age_s=np.where(flight().t_s == 6.0, 1.02, flight().setpoint_age_s))
IN_AIR = replace(flight(), landed_s=None, position_ned_m=flight().position_ned_m - [0.0, 0.0, 3.0])


@pytest.mark.parametrize(
    ("check", "good", "bad", "reason"),
    [
        (
            {"check": "reaches", "position_ned_m": [40, 0, -10]},
            flown(),
            flown(flight(5.0)),
            "comes no nearer than 5.0 m",
        ),
        ({"check": "reaches", "position_ned_m": [40, None, None], "by_s": 5.1}, flown(flight(9.0)), None, ""),
        (
            {"check": "reaches", "position_ned_m": [40, 0, -10], "by_s": 4},
            None,
            flown(),
            "reached only after 4.8 s",
        ),
        (
            {"check": "stays_within", "radius_m": 41},
            flown(),
            flown(flight(20.0)),
            "leaves 41 m of home here, later by up to 3.7 m",
        ),
        (
            {"check": "stays_within", "height_m": 11},
            flown(),
            flown(IN_AIR),
            "leaves 11 m of height here, later by up to 2.0 m",
        ),
        (
            {"check": "stays_within", "corners_ne_m": [[-1, -5], [50, -5], [50, 5], [-1, 5]]},
            flown(),
            flown(flight(6.0)),
            "leaves the area here, later by up to 1.0 m",
        ),
        (
            {"check": "stays_within", "fence": True},
            None,
            flown(fence=FENCE),
            "leaves the fence here, later by up to 10.0 m",
        ),
        (
            {"check": "stays_within", "fence": True},
            None,
            flown(),
            "there is no fence, neither in the plan nor in the parameters",
        ),
        (
            {"check": "never_closer_than", "distance_m": 2.9},
            flown(obstacles=(WALL,)),
            flown(),
            "there are no obstacles, neither in the world nor in the plan",
        ),
        ({"check": "never_closer_than", "distance_m": 4}, None, flown(obstacles=(WALL,)), "3.0 m from wall"),
        (
            {"check": "never_closer_than", "distance_m": 5, "to": "vehicles"},
            flown(flight(), flight(5.0, "b")),
            flown(flight(), flight(4.0, "b")),
            "4.0 m from vehicles",
        ),
        (
            {"check": "never_closer_than", "distance_m": 5, "to": "vehicles"},
            None,
            flown(),
            "there is no other vehicle",
        ),
        (
            {"check": "never_closer_than", "distance_m": 5, "position_ned_m": [40, 6, None]},
            flown(),
            flown(flight(2.0)),
            "4.0 m from (40, 6, any)",
        ),
        (
            {"check": "lands_within", "radius_m": 1, "by_s": 10},
            flown(),
            flown(flight(7.0)),
            "lands 7.0 m away",
        ),
        ({"check": "lands_within", "radius_m": 1}, None, flown(IN_AIR), "is armed at the end, 3.0 m high"),
        ({"check": "lands_within", "radius_m": 1, "by_s": 9}, None, flown(), "lands only after 10.0 s"),
        ({"check": "mode_by", "mode": "rtl", "by_s": 8}, flown(), None, ""),
        ({"check": "mode_by", "mode": "rtl", "by_s": 7}, None, flown(), "only after 8.0 s"),
        (
            {"check": "mode_by", "mode": "land"},
            None,
            flown(),
            "never; its modes were takeoff at 0.0 s, offboard at 2.0 s, rtl at 8.0 s",
        ),
        ({"check": "setpoint_gap", "max_s": 0.5}, flown(), flown(GAP), "no setpoint for 1.02 s"),
        (
            {"check": "no_failsafe"},
            flown(),
            flown(FAILED),
            "a failsafe switches to descend: no valid position estimate",
        ),
        ({"check": "energy", "left_percent": 50}, flown(), None, ""),
        ({"check": "energy", "left_percent": 51}, None, flown(), "50 % left"),
        ({"check": "finishes"}, flown(), flown(finished=False, end_reason="left"), "left"),
        ({"check": "finishes", "by_s": 9}, None, flown(), "only after 10.0 s"),
    ],
)
def test_a_check_holds_or_says_why(check: dict[str, object], good: Flown, bad: Flown, reason: str) -> None:
    if good is not None:
        assert why(check, good) == []
    if bad is not None:
        assert reason in why(check, bad)


def test_a_check_of_one_vehicle_leaves_the_others_alone() -> None:
    both = flown(flight(), flight(9.0, "b"))
    check = {"check": "lands_within", "radius_m": 1}
    assert why(check, both) == ["lands 9.0 m away"]
    assert why({**check, "vehicle": "vehicle"}, both) == []


def test_a_gap_without_offboard_is_no_success() -> None:
    never = replace(flight(), setpoint_age_s=np.full(COUNT, math.nan))
    assert why({"check": "setpoint_gap", "max_s": 0.5}, flown(never)) == ["the vehicle was never in Offboard"]


@pytest.mark.parametrize(
    ("body", "reasons"),
    [
        ("return flown.duration_s == 10.0", []),
        ("assert flown.duration_s > 11, 'too short'", ["too short"]),
        ("return 'wrong way'", ["wrong way"]),
        ("return False", ["the function returned False"]),
        ("return 1 / 0", ["the function failed: ZeroDivisionError: division by zero"]),
    ],
)
def test_a_function_judges(body: str, reasons: list[str], tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(f"def judge(flown):\n    {body}\n")
    assert why({"check": "python", "function": f"{file}:judge"}, flown()) == reasons


def test_where_and_when_are_those_of_the_first_break() -> None:
    check: Callable[..., AnyCheck] = TypeAdapter(AnyCheck).validate_python
    (broken,) = check({"check": "stays_within", "radius_m": 20}, strict=False).judge(flown())
    assert broken.t_s == 3.1
    assert broken.position_ned_m == (21.0, 0.0, -10.0)
