"""The simulator stores plan items as PX4 does: recorded examples, and the planner's own model of PX4."""

import dataclasses
import math
import random
import struct

import pytest

from missions.formats.mavlink_items import WireItem
from missions.formats.px4_storage import stored_items
from vehicle_sim.autopilot.mission import feasibility
from vehicle_sim.autopilot.mission.items import Item
from vehicle_sim.mavlink.services.stored_items import FENCE, MISSION, RALLY, store

NAN, INF = math.nan, math.inf
WAYPOINT, LOITER_TIME, LAND, TAKEOFF, JUMP, ACTUATOR = 16, 19, 21, 22, 177, 187
INCLUSION, INCLUSION_CIRCLE, RALLY_POINT = 5001, 5003, 5100
RELATIVE, NO_POSITION = 6, 2


def float32(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


def item(command: int, *parameters: float, frame: int = RELATIVE, autocontinue: int = 1, x: int = 473980118):
    p1, p2, p3, p4 = map(float32, (*parameters, 0.0, 0.0, 0.0, 0.0)[:4])
    return {"frame": frame, "command": command, "current": 0, "autocontinue": autocontinue, "x": x,
            "y": 85457269, "z": 10.0, "param1": p1, "param2": p2, "param3": p3, "param4": p4}  # fmt: skip


def returned(kind: int, fields: dict[str, float]) -> dict[str, float]:
    result, stored = store(kind, fields, as_int=True)
    assert stored is not None, result
    return stored.message_fields(as_int=True)


@pytest.mark.parametrize(
    ("kind", "fields", "changed"),
    [
        (MISSION, item(WAYPOINT, 1.0, 2.0, 5.0, -90.0), {"param3": 0.0, "param4": 270.0}),
        (MISSION, item(WAYPOINT, 0.0, 2.0, 0.0, 65536.0), {"param4": float32(15.9955368)}),
        (MISSION, item(WAYPOINT, 0.0, 2.0, 0.0, INF), {"param4": NAN}),
        (MISSION, item(WAYPOINT, autocontinue=255), {"autocontinue": 1}),
        (MISSION, item(LOITER_TIME, 3.0, 0.4, 5.0, 370.0), {"param2": 1.0, "param4": 1.0}),
        (MISSION, item(LAND, 300.0, -2.5, 1.0), {"param1": 0.0, "param2": 65534.0, "param3": 0.0}),
        (MISSION, item(JUMP, 1e9, -1.0, frame=NO_POSITION, x=2**31 - 1),
         {"param1": -13824.0, "param2": 65535.0, "x": -(2**31), "y": 85457272}),
        (MISSION, item(80, 3.0, 1.0), {"command": 201, "param1": 0.0, "param2": 0.0}),
        (FENCE, item(INCLUSION, 65540.0, 1.0), {"param1": 4.0, "param2": 0.0, "frame": 5, "autocontinue": 0}),
        (FENCE, item(INCLUSION_CIRCLE, -50.0, frame=3), {"frame": 5, "autocontinue": 0}),
        (RALLY, item(RALLY_POINT, 1.0, 2.0, 3.0, 4.0, frame=0),
         {"frame": 5, "param1": 0.0, "param2": 0.0, "param3": 0.0, "param4": 0.0}),
    ],
)  # fmt: skip
def test_px4_returns_what_it_keeps(kind, fields, changed):
    found = {
        name: value
        for name, value in returned(kind, fields).items()
        if value != fields[name] and not (math.isnan(value) and math.isnan(fields[name]))
    }
    assert repr(found) == repr({name: changed[name] for name in found})
    assert len(found) == len(changed)


@pytest.mark.parametrize(
    ("kind", "fields", "result"),
    [
        (MISSION, item(WAYPOINT, frame=11), 2),
        (MISSION, item(WAYPOINT, frame=NO_POSITION), 3),
        (MISSION, item(201, 1.0), 6),
        (MISSION, item(201, 3.0, frame=NO_POSITION), 6),
        (MISSION, item(INCLUSION, 4.0), 1),
        (FENCE, item(INCLUSION, 2.4), 1),
        (FENCE, item(INCLUSION, NAN), 1),
    ],
)
def test_px4_refuses_an_item(kind, fields, result):
    assert store(kind, fields, as_int=True) == (result, None)


def test_the_planner_expects_what_the_simulated_vehicle_returns():
    rng = random.Random(1)
    commands = {"mission": (16, 17, 19, 21, 22, 31, 84, 195, 4501), "fence": (5001, 5003), "rally": (5100,)}
    for _ in range(600):
        part = rng.choice(("mission", "fence", "rally"))
        frame = rng.choice((0, 3, 5, 6))
        values = [float32(rng.choice((NAN, 0.0, 4.0, rng.uniform(-500.0, 70_000.0)))) for _ in range(4)]
        command = rng.choice(commands[part])
        if part == "mission" and rng.random() < 0.3:
            frame, command = NO_POSITION, rng.choice((93, JUMP, 178, 206, 2000))
        if command == INCLUSION:
            values[0] = float(rng.randrange(3, 99))
        wire = WireItem(0, frame, command, *values, rng.randrange(10**9), rng.randrange(10**9), 12.5)
        kind = {"mission": MISSION, "fence": FENCE, "rally": RALLY}[part]
        stored = returned(kind, dataclasses.asdict(wire))
        (expected,) = stored_items(part, [wire])
        assert repr({name: float(getattr(expected, name)) for name in stored}) == repr(
            {name: float(value) for name, value in stored.items()}
        )


def check(*commands: int, alt_m: float = 10.0, required: int = 0) -> list[str]:
    frames = [NO_POSITION if each in (JUMP, 178, ACTUATOR, 114) else RELATIVE for each in commands]
    items = [
        Item(frame, command, True, (0.0, 0.0, 0.0, NAN), 47.0, 8.0, alt_m)
        for frame, command in zip(frames, commands, strict=True)
    ]
    cylinder = feasibility.Cylinder(47.0, 8.0, 0.0, 0.0, 0.0)
    inputs = feasibility.FeasibilityInputs(True, 480.0, (), cylinder, True, required, True)
    return [each.event.removeprefix("navigator_mis_") for each in feasibility.check(items, inputs)]


def test_px4_finds_one_fault_of_each_kind_and_none_after_an_unusable_item():
    assert check(TAKEOFF, WAYPOINT, LAND) == check(JUMP, 178, TAKEOFF) == check(WAYPOINT) == []
    assert check(LAND, TAKEOFF) == ["starts_w_landing"]
    assert check(ACTUATOR, TAKEOFF, TAKEOFF) == ["takeoff_not_first"]
    assert check(WAYPOINT, 85, 84, 22) == ["vtol_items", "takeoff_not_first"]
    assert check(TAKEOFF, TAKEOFF, alt_m=0.0) == ["takeoff_too_low"]
    assert check(84, 114, WAYPOINT, TAKEOFF) == ["vtol_items", "unsup_cmd"]
    assert check(TAKEOFF, WAYPOINT, required=4) == ["add_land_or_rm_to"]
    assert check(TAKEOFF, LAND, alt_m=0.0, required=1) == ["takeoff_too_low", "takeoff_missing"]
