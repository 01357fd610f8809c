"""Compiled missions: their timelines, waits, and findings."""

from __future__ import annotations

import io
import math
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from missions.errors import PlanError
from missions.examples import figure_eight
from missions.geodesy import LocalOrigin
from missions.offboard.compiler import compile_mission
from missions.offboard.positions import Start
from missions.offboard.reader import read
from missions.offboard.segments import CurveSegment, WaitSegment
from missions.setpoints import Attitude, Position, Trajectory, Velocity
from tests.support.offboard_missions import (
    HOME,
    LAND,
    TAKE_OFF,
    finding_codes,
    flight_steps,
    mission,
    position_at,
    segment_titles,
    timeline,
)

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = sorted((ROOT / "missions/examples").glob("*.yaml"))
TWO_VEHICLES = ROOT / "missions/examples/two_vehicle_show.yaml"
EXAMPLES.remove(TWO_VEHICLES)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_compile_without_a_finding(path: Path) -> None:
    compiled = compile_mission(read(path.read_bytes()))
    assert compiled.findings == ()
    assert compiled.duration_s > 30.0
    assert compiled.segments[-1].end_ned_m[2] == pytest.approx(0.0) or compiled.decision is not None


def test_the_examples_for_one_vehicle_are_complete() -> None:
    assert [path.stem for path in EXAMPLES] == ["figure_eight", "tower_inspection", "waypoints"]


def test_the_figure_eight_built_in_python_equals_the_figure_eight_in_the_file() -> None:
    assert read((ROOT / "missions/examples/figure_eight.yaml").read_bytes()) == figure_eight.MISSION


def test_the_figure_eight_is_flown_at_five_metres_per_second() -> None:
    compiled = compile_mission(read((ROOT / "missions/examples/figure_eight.yaml").read_bytes()))
    figure_segment = next(segment for segment in compiled.segments if segment.title == "Two rounds")
    assert isinstance(figure_segment, CurveSegment)
    speeds = np.linalg.norm(
        figure_segment.curve.sample(np.linspace(0, figure_segment.duration_s, 2000)).velocity_ned_m_s, axis=1
    )
    assert speeds.max() <= 5.0
    assert np.median(speeds) > 4.9


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_a_timeline_is_continuous(path: Path) -> None:
    compiled = compile_mission(read(path.read_bytes()))
    position, yaw_rad = (0.0, 0.0, 0.0), 0.0
    for segment in compiled.segments:
        if not isinstance(segment, WaitSegment):
            setpoint = segment.at(0.0)
            assert position_at(segment, 0.0) == pytest.approx(position, abs=1e-6), segment.place
            yaw_step_rad = math.remainder((getattr(setpoint, "yaw_ned_rad", None) or 0.0) - yaw_rad, math.tau)
            assert abs(yaw_step_rad) <= math.radians(1.0) + 1e-9, segment.place
            assert position_at(segment, segment.duration_s) == pytest.approx(segment.end_ned_m, abs=1e-6)
        position, yaw_rad = segment.end_ned_m, segment.end_yaw_ned_rad


def test_a_timeline_can_be_pickled() -> None:
    compiled = compile_mission(read((ROOT / "missions/examples/tower_inspection.yaml").read_bytes()))
    loaded = pickle.loads(pickle.dumps(compiled))
    for t in np.arange(0.0, compiled.own_duration_s, 1.7).tolist():
        assert loaded.at(t) == compiled.at(t)


def test_steps_are_in_order_with_positions_and_waits() -> None:
    compiled = timeline(
        TAKE_OFF
        + "- {step: fly, points: [{offset_ned_m: [20, 0, -10]}], name: Out}\n"
        + "- {step: wait, until: person, timeout_s: 60, message: Go?}\n"
        + "- {step: wait, until: {value: wind_speed_m_s, below: 8, for_s: 5}, timeout_s: 60,"
        + " on_timeout: land}\n"
        + LAND
    )
    assert [(s.place, s.title) for s in compiled.segments] == [
        ("step 1", "Take off"), ("step 2", "Out"), ("step 3", "Wait"), ("step 4", "Wait"), ("step 5", "Land"),
    ]  # fmt: skip
    waits = [segment for segment in compiled.segments if isinstance(segment, WaitSegment)]
    assert [wait.kind for wait in waits] == ["take_off", "person", "condition", "land"]
    assert (waits[2].value, waits[2].below, waits[2].for_s, waits[2].on_timeout) == (
        "wind_speed_m_s",
        8.0,
        5.0,
        "land",
    )
    assert waits[1].message == "Go?"
    assert compiled.segments[1].end_ned_m == pytest.approx((20, 0, -10))
    assert compiled.length_m == pytest.approx(10 + 20 + 10)
    assert compiled.findings == ()


def test_positions_are_local_relative_or_global() -> None:
    start = Start((5.0, 0.0, -1.0), 0.0, LocalOrigin(47.0, 8.0, 480.0), 480.0, in_air=True)
    north_deg = 47.0 + math.degrees(30.0 / 6_371_000.0)
    compiled = timeline(
        "- {step: fly, points: [{position_ned_m: [10, 0, -10]}]}\n"
        "- {step: fly, points: [{offset_ned_m: [10, 0, -10]}]}\n"
        f"- {{step: fly, points: [{{lat_deg: {north_deg}, lon_deg: 8, alt_home_m: 12}}]}}\n"
        f"- {{step: fly, points: [{{lat_deg: {north_deg}, lon_deg: 8, alt_amsl_m: 500}}]}}\n" + LAND,
        start,
    )
    ends = [segment.end_ned_m for segment in compiled.segments[:4]]
    assert np.array(ends) == pytest.approx(
        np.array([(10, 0, -10), (15, 0, -11), (30, 0, -12), (30, 0, -20)]), abs=1e-3
    )
    assert set(compiled.needs) == {"position", "velocity", "global_position", "home"}


def test_a_global_position_needs_an_origin_or_a_planned_home() -> None:
    steps = TAKE_OFF + "- {step: fly, points: [{lat_deg: 47, lon_deg: 8, alt_home_m: 12}]}\n" + LAND
    assert finding_codes(timeline(steps)) == {"estimate_missing"}
    assert compile_mission(mission(steps, home=HOME)).findings == ()


def test_a_point_with_a_wait_ends_the_path_and_adds_a_hold() -> None:
    compiled = timeline(
        flight_steps(
            "step: fly, points: [{offset_ned_m: [9, 0, -10], hold_s: 4}, {offset_ned_m: [9, 9, -10]}]"
        )
    )
    assert segment_titles(compiled) == ["Take off", "Fly", "Hold", "Fly", "Land"]
    assert compiled.segments[2].duration_s == 4.0
    assert position_at(compiled.segments[2], 2.0) == pytest.approx((9, 0, -10))


def test_an_orbit_begins_at_the_nearest_point_after_an_approach_and_a_turn() -> None:
    compiled = timeline(
        flight_steps(
            "step: orbit, radius_m: 5, center: {offset_ned_m: [20, 0, -10]},"
            " look_at: {offset_ned_m: [20, 0, 0]}"
        )
    )
    assert segment_titles(compiled) == ["Take off", "Approach", "Orbit", "Land"]
    assert compiled.segments[1].end_ned_m == pytest.approx((15, 0, -10))
    assert compiled.segments[2].length_m == pytest.approx(math.tau * 5.0, rel=1e-4)


def test_a_velocity_step_accelerates_and_brakes_within_its_duration() -> None:
    compiled = timeline(TAKE_OFF + "- {step: velocity, velocity_ned_m_s: [3, 0, 0], duration_s: 10}\n" + LAND)
    segment = compiled.segments[1]
    assert segment.at(5.0) == Velocity((pytest.approx(3.0), 0.0, 0.0), 0.0)  # type: ignore[arg-type]
    assert segment.at(10.0) == Velocity((0.0, 0.0, 0.0), 0.0)
    # At 3 m/s, with 3 m/s² and 4 m/s³, accelerating and braking take v/a + a/j each.
    assert segment.end_ned_m[0] == pytest.approx(3.0 * (10.0 - 3.0 / 3.0 - 3.0 / 4.0))
    assert finding_codes(compiled) == {"position_not_held"}


def test_an_attitude_step_sends_its_attitude_for_its_duration_and_then_a_position() -> None:
    compiled = timeline(TAKE_OFF + "- {step: attitude, pitch_rad: -0.1, thrust: 0.5, duration_s: 2}\n" + LAND)
    setpoint = compiled.segments[1].at(1.0)
    assert isinstance(setpoint, Attitude)
    assert setpoint.thrust == 0.5
    assert isinstance(compiled.segments[1].at(2.0), Position)
    assert finding_codes(compiled) == {"position_not_held"}


CSV = b"t_s,north_m,east_m,down_m\n0,0,0,-10\n10,20,0,-10\n20,20,20,-10\n"


def test_tables_from_csv_and_numpy_are_flown_at_their_own_times() -> None:
    npy_file = io.BytesIO()
    np.save(npy_file, np.array([[5, 0, 0, -10, 0], [15, 20, 0, -10, 1], [25, 20, 20, -10, 1]], dtype=float))
    files = {"a.csv": CSV, "b.npy": npy_file.getvalue()}
    compiled = timeline(
        TAKE_OFF + "- {step: table, file: a.csv}\n- {step: table, file: b.npy}\n" + LAND, files=files
    )
    tables = [segment for segment in compiled.segments if segment.title == "Table"]
    assert [segment.duration_s for segment in tables] == [20.0, 20.0]
    assert position_at(tables[0], 10.0) == pytest.approx((20, 0, -10))
    assert compiled.findings == ()


OVERSIZED_ARRAY = (
    b"\x93NUMPY\x01\x00\x60\x00{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 5)}"
    + b" " * 40
)
"""An array whose header states a size of four terabytes."""


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "columns are missing"),
        (b"t_s,north_m,east_m,down_m\n0,0,0,0\n", "1 rows"),
        (b"t_s,north_m,east_m,down_m\n0,0,0,0\n0,1,0,0\n", "times must increase"),
        (b"t_s,north_m,east_m,down_m\n0,0,0,0\n1,nan,0,0\n", "row 2"),
        (b"t_s,north_m,east_m,down_m\n0,0,0,0\n1,x,0,0\n", "row 2"),
        (b"t_s,north_m,east_m,down_m\n0,0,0,0\n1,0,0\n", "row 2"),
        (b"\x93NUMPY\x01\x00", "not a NumPy array"),
        (OVERSIZED_ARRAY, "ends before"),
        (b"\xff", "UTF-8"),
    ],
)  # fmt: skip
def test_an_invalid_table_causes_a_finding_that_names_the_row(data: bytes, text: str) -> None:
    compiled = timeline(TAKE_OFF + "- {step: table, file: a}\n" + LAND, files={"a": data})
    assert [finding.code for finding in compiled.findings] == ["step_invalid"]
    assert text in compiled.findings[0].message


def test_a_table_faster_than_the_vehicles_limits_causes_a_finding() -> None:
    fast = b"t_s,north_m,east_m,down_m\n0,0,0,-10\n1,40,0,-10\n2,80,0,-30\n"
    compiled = timeline(TAKE_OFF + "- {step: table, file: a}\n" + LAND, files={"a": fast})
    assert {"speed_exceeded", "acceleration_exceeded"} <= finding_codes(compiled)


def test_the_gimbal_follows_its_track() -> None:
    compiled = timeline(
        TAKE_OFF
        + "- {step: gimbal, track: look_at, place: {offset_ned_m: [10, 0, 0]}}\n"
        + "- {step: hold, duration_s: 4}\n"
        + "- {step: gimbal, track: sweep, pitch_rad: -0.5, sweep_yaw_rad: 1, period_s: 4}\n"
        + "- {step: hold, duration_s: 4}\n"
        + "- {step: gimbal, track: along_path, pitch_rad: -0.3}\n"
        + "- {step: fly, points: [{offset_ned_m: [0, 30, -10]}]}\n"
        + "- {step: gimbal, track: fixed, pitch_rad: -1.2, yaw_rad: 0.4}\n"
        + "- {step: hold, duration_s: 1}\n"
        + "- {step: gimbal, track: release}\n"
        + LAND
    )
    holds = [segment for segment in compiled.segments if segment.title == "Hold"]
    assert holds[0].gimbal_at(1.0) == pytest.approx((-math.pi / 4, 0.0))
    assert holds[1].gimbal_at(1.0) == pytest.approx((-0.5, 1.0))
    fly = next(segment for segment in compiled.segments if segment.title == "Fly")
    assert fly.gimbal_at(4.0) == pytest.approx((-0.3, math.pi / 2))
    assert holds[2].gimbal_at(0.0) == pytest.approx((-1.2, 0.4))
    assert compiled.segments[-1].gimbal_at(0.0) is None
    assert [event.kind for event in compiled.events] == ["gimbal"] * 5


def test_the_events_of_pictures_have_the_expected_times_and_positions() -> None:
    compiled = timeline(
        TAKE_OFF + "- {step: photo, count: 3, interval_s: 2}\n"
        "- {step: fly, points: [{offset_ned_m: [20, 0, -10]}], photo_every_m: 5}\n" + LAND
    )
    assert [event.t_s for event in compiled.segments[1].events] == [0.0, 2.0, 4.0]
    shots = compiled.segments[2].events
    assert [round(position_at(compiled.segments[2], event.t_s)[0], 1) for event in shots] == [
        0.0,
        5.0,
        10.0,
        15.0,
    ]
    assert compiled.photos == 7


def test_each_segment_has_the_avoidance_of_its_step_or_mission() -> None:
    steps = flight_steps(
        "step: fly, points: [{offset_ned_m: [20, 0, -10]}], avoidance: false",
        "step: fly, points: [{offset_ned_m: [40, 0, -10]}]",
    )
    segments = compile_mission(mission(steps, avoidance=True)).segments
    assert [segment.avoidance for segment in segments] == ["over", None, "over", "over"]
    assert not any(segment.avoidance for segment in compile_mission(mission(steps)).segments)
    assert mission(steps).steps[1].avoidance is False


def test_a_step_can_choose_another_way_of_avoidance_than_its_mission() -> None:
    steps = flight_steps(
        "step: fly, points: [{offset_ned_m: [20, 0, -10]}], avoidance: over",
        "step: fly, points: [{offset_ned_m: [40, 0, -10]}]",
        "step: hold, duration_s: 1",
    )
    compiled = compile_mission(mission(steps, avoidance="around"))
    avoidance = [segment.avoidance for segment in compiled.segments]
    assert avoidance == ["around", "over", "around", "around", "around"]
    assert compiled.avoidance == "around"
    assert compile_mission(mission(steps)).avoidance == "over"
    with pytest.raises(PlanError, match="give over, around, true or false"):
        mission(steps.replace("avoidance: over", "avoidance: under"))


def test_repeats_and_calls_are_expanded() -> None:
    text = (
        "name: Test\nsteps:\n"
        + TAKE_OFF
        + "- {step: repeat, times: 2, steps: [{step: call, mission: a}]}\n"
        + LAND
        + "missions:\n  a: [{step: hold, duration_s: 1}, {step: photo}]\n"
    )
    compiled = compile_mission(read(text))
    assert segment_titles(compiled) == ["Take off", "Hold", "Photo", "Hold", "Photo", "Land"]
    assert [segment.place for segment in compiled.segments][1:3] == ["step 2.1, a 1", "step 2.1, a 2"]


def test_a_branch_gives_two_timelines_that_each_contain_the_following_steps() -> None:
    compiled = timeline(
        flight_steps(
            "step: branch, condition: {value: battery_share, above: 0.5}, then: [{step: hold, duration_s: 9}]"
        )
    )
    assert segment_titles(compiled) == ["Take off"]
    assert compiled.decision is not None
    assert (compiled.decision.value, compiled.decision.above) == ("battery_share", 0.5)
    assert compiled.then is not None
    assert compiled.otherwise is not None
    assert (segment_titles(compiled.then), segment_titles(compiled.otherwise)) == (["Hold", "Land"], ["Land"])
    assert compiled.duration_s == pytest.approx(compiled.own_duration_s + compiled.then.duration_s)


def test_the_rest_of_a_mission_is_compiled_from_the_vehicles_position() -> None:
    steps = flight_steps(
        "step: gimbal, track: look_at, place: {offset_ned_m: [0, 0, 0]}",
        "step: fly, points: [{offset_ned_m: [20, 0, -10]}]",
        "step: fly, points: [{offset_ned_m: [20, 20, -10]}]",
    )
    start = Start((14.0, 3.0, -12.0), 0.5, in_air=True, mission_start_ned_m=(0.0, 0.0, 0.0))
    compiled = compile_mission(mission(steps), start=start, first_step=3)
    fly = next(segment for segment in compiled.segments if segment.title == "Fly")
    assert fly.place == "step 4"
    assert position_at(fly, 0.0) == pytest.approx((14, 3, -12))
    assert fly.end_ned_m == pytest.approx((20, 20, -10))
    assert fly.gimbal is not None
    assert compiled.segments[-1].end_ned_m == pytest.approx((20, 20, 0))
    assert compiled.findings == ()


EDGE_VALUES = (0.0, -1.0, 0.3, 1e-3, 7.0, 90.0, 9e3, -9e3)
STEP_TEMPLATES = (
    "step: fly, points: [{p}, {q}], curve: smooth, heading: along_path",
    "step: fly, points: [{p}, {q}], look_at: {p}",
    "step: orbit, center: {p}, radius_m: {size}, yaw_ned_rad: {n}",
    "step: spiral, center: {p}, radius_m: 2, end_radius_m: {size}, climb_m: {n}, look_at: {q}",
    "step: figure_eight, center: {p}, length_m: {size}, width_m: 3",
    "step: velocity, velocity_ned_m_s: [{n}, 0, {m}], duration_s: 9",
    "step: gimbal, track: look_at, place: {p}",
)


@settings(deadline=None, max_examples=30)
@given(
    st.lists(
        st.tuples(st.sampled_from(STEP_TEMPLATES), st.tuples(*[st.sampled_from(EDGE_VALUES)] * 6)), max_size=3
    )
)
def test_any_steps_give_finite_setpoints(templates: list[tuple[str, tuple[float, ...]]]) -> None:
    steps: list[str] = []
    for template, (a, b, c, d, n, m) in templates:
        p, q = (f"{{offset_ned_m: [{x}, {y}, {z}]}}" for x, y, z in ((a, b, c), (c, d, a)))
        size, capped = abs(n) + 0.2, max(-900.0, min(900.0, n))
        steps.append(template.format(p=p, q=q, size=size, n=capped, m=m))
    compiled = timeline(flight_steps(*steps))
    for t in np.linspace(0.0, compiled.duration_s, 50).tolist():
        setpoint = compiled.at(t)
        assert isinstance(setpoint, Trajectory | Position | Velocity)
        values = (*getattr(setpoint, "position_ned_m", ()), *getattr(setpoint, "velocity_ned_m_s", ()))
        assert all(math.isfinite(value) for value in values)


def test_missions_with_too_many_steps_are_refused() -> None:
    inner = "step: repeat, times: 1000, steps: [{step: hold, duration_s: 1}]"
    with pytest.raises(PlanError, match="Split the mission"):
        timeline(flight_steps(f"step: repeat, times: 1000, steps: [{{{inner}}}]"))
    branches = "- {step: branch, condition: {value: satellites, above: 5}, then: [{step: photo}]}\n" * 20
    with pytest.raises(PlanError, match="branches"):
        timeline(TAKE_OFF + branches)


def test_the_documentation_names_each_example_file() -> None:
    text = (ROOT / "docs" / "missions.md").read_text(encoding="utf-8")
    for path in EXAMPLES:
        assert f"missions/examples/{path.name}" in text
