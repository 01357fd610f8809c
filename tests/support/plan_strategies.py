"""Hypothesis strategies for whole plans: every kind of item and fence, with values that MAVLink's 32-bit
floats and integers represent exactly."""

from __future__ import annotations

import struct
from typing import Any

from hypothesis import strategies as st

from missions.items import CommandItem, Item, PlacedItem
from missions.plan import TYPED_ITEMS, Plan
from missions.values import Altitude, FenceCircle, FencePolygon, HomePosition, Obstacle, Point, RallyPoint


def float32(value: float) -> float:
    """The nearest number that a 32-bit float can represent."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def float32_numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers of this range that a 32-bit float represents exactly."""
    return (
        st.floats(low, high, allow_nan=False)
        .map(float32)
        .filter(lambda v: low <= v <= high)
        .map(lambda v: v + 0.0)  # -0.0 becomes 0.0
    )


PARAMS = float32_numbers(-1e6, 1e6) | st.integers(-100, 100).map(float)
LAT_DEG = st.integers(-900_000_000, 900_000_000).filter(bool).map(lambda e7: e7 / 1e7)
"""Not 0, because a position at 0/0 of a file means "here"."""
LON_DEG = st.integers(-1_800_000_000, 1_800_000_000).map(lambda e7: e7 / 1e7)
ALTITUDES = st.builds(
    Altitude, value_m=float32_numbers(-400.0, 9000.0), reference=st.sampled_from(["home", "amsl", "terrain"])
)
RESOLVED_ALTITUDES = ALTITUDES | st.builds(
    Altitude,
    value_m=float32_numbers(-400.0, 9000.0),
    reference=st.just("terrain"),
    resolved_amsl_m=float32_numbers(-400.0, 9000.0),
)
POINTS = st.builds(Point, lat_deg=LAT_DEG, lon_deg=LON_DEG)
HOMES = st.builds(HomePosition, lat_deg=LAT_DEG, lon_deg=LON_DEG, alt_amsl_m=float32_numbers(-400.0, 9000.0))
ANY_HOME = HOMES | st.none()
RALLY_POINTS = st.builds(RallyPoint, lat_deg=LAT_DEG, lon_deg=LON_DEG, altitude=ALTITUDES)
CIRCLES = st.builds(
    FenceCircle, inclusion=st.booleans(), center=POINTS, radius_m=float32_numbers(0.5, 10_000.0)
)
POLYGONS = st.builds(
    FencePolygon, inclusion=st.booleans(), polygon=st.lists(POINTS, min_size=3, max_size=8).map(tuple)
)
OBSTACLES = st.builds(
    Obstacle,
    name=st.sampled_from(["", "Barn"]),
    polygon=st.lists(POINTS, min_size=3, max_size=5).map(tuple),
    top=st.builds(
        Altitude, value_m=float32_numbers(-50.0, 300.0), reference=st.sampled_from(["home", "amsl"])
    ),
)


@st.composite
def typed_items(draw: st.DrawFn, altitudes: st.SearchStrategy[Altitude] = ALTITUDES) -> Item:
    """An item of any type that PX4 executes, with each optional field set or unset."""
    item_class = draw(st.sampled_from(TYPED_ITEMS))
    fields: dict[str, Any] = {"autocontinue": draw(st.booleans())}
    whole_numbers = st.integers(-(10**6), 10**6).map(float)
    for number, slot in enumerate(item_class.SLOTS, start=1):
        if not isinstance(slot, str):
            continue
        if item_class.model_fields[slot].annotation is int:
            fields[slot] = draw(st.integers(0, 50))
        else:  # MISSION_ITEM_INT transmits parameters 5 and 6 as integers
            fields[slot] = draw(whole_numbers if number in (5, 6) else st.none() | PARAMS)
    if issubclass(item_class, PlacedItem):
        fields |= {"lat_deg": draw(LAT_DEG), "lon_deg": draw(LON_DEG), "altitude": draw(altitudes)}
    return item_class(**fields)


COMMANDS = st.builds(
    CommandItem,
    command=st.sampled_from([18, 82, 84, 85, 92, 94, 112, 900, 65_535]),
    frame=st.just(2),
    params=st.tuples(
        *[st.none() | PARAMS] * 4, *[st.integers(-(10**6), 10**6).map(float)] * 2, st.none() | PARAMS
    ),
    autocontinue=st.booleans(),
)


def plans(
    altitudes: st.SearchStrategy[Altitude] = ALTITUDES,
    homes: st.SearchStrategy[HomePosition | None] = ANY_HOME,
) -> st.SearchStrategy[Plan]:
    """Any plans; the fence lists polygons before circles, as plan files do."""
    return st.builds(
        lambda items, polygons, circles, **other_fields: Plan(
            items=tuple(items), fence=(*polygons, *circles), **other_fields
        ),
        items=st.lists(typed_items(altitudes) | COMMANDS, max_size=8),
        polygons=st.lists(POLYGONS, max_size=3),
        circles=st.lists(CIRCLES, max_size=3),
        rally_points=st.lists(RALLY_POINTS, max_size=3).map(tuple),
        obstacles=st.lists(OBSTACLES, max_size=2).map(tuple),
        planned_home=homes,
        cruise_speed_m_s=st.none() | float32_numbers(0.5, 50.0),
        hover_speed_m_s=st.none() | float32_numbers(0.5, 50.0),
    )
