"""Limits of setpoints: every sent setpoint is finite, within the limits, and can stop before the fence."""

import math

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from gcs_server.streamer.limits.limiter import apply_limits, is_finite
from gcs_server.streamer.limits.region import BRAKE_DELAY_S, BRAKE_M_S2, VehicleMotion, braking_speed
from gcs_server.streamer.values.limit_values import Bounds
from missions.fence import Circle, Polygon, Region
from missions.frames import ned_from_heading, q_from_euler, tilt_from_q
from missions.geodesy import LocalOrigin
from missions.setpoints import (
    Acceleration,
    Attitude,
    Position,
    PositionGlobal,
    Rates,
    Trajectory,
    Velocity,
    VelocityBody,
)

numbers = st.floats(-500, 500)
vectors = st.tuples(numbers, numbers, numbers)
angles = st.floats(-math.pi, math.pi)
yaws = st.one_of(
    st.fixed_dictionaries({}),
    st.fixed_dictionaries({"yaw_ned_rad": angles}),
    st.fixed_dictionaries({"yaw_rate_ned_rad_s": st.floats(-20, 20)}),
)
ORIGIN = LocalOrigin(47.4, 8.5, 480.0)
L_SHAPE = ((-60.0, -60.0), (60.0, -60.0), (60.0, 0.0), (0.0, 0.0), (0.0, 60.0), (-60.0, 60.0))
FENCED_REGION = Region(-40.0, 0.0, (Circle((0.0, 0.0), 70.0, "70 m"),), (Polygon(L_SHAPE, "the fence"),))
limit_values = st.floats(0.5, 15)


@st.composite
def bounds(draw, region=FENCED_REGION):
    return Bounds(
        speed_m_s=draw(limit_values),
        climb_m_s=draw(limit_values),
        descent_m_s=draw(limit_values),
        tilt_rad=draw(st.floats(0.05, 1.2)),
        acceleration_m_s2=draw(limit_values),
        acceleration_up_m_s2=draw(limit_values),
        acceleration_down_m_s2=draw(limit_values),
        rates_rad_s=(draw(limit_values), draw(limit_values), draw(limit_values)),
        slew_velocity_m_s2=draw(st.sampled_from((math.inf, 2.0))),
        slew_attitude_rad_s=draw(st.sampled_from((math.inf, 0.5))),
        approach_m_s=draw(st.sampled_from((math.inf, 3.0))),
        approach_climb_m_s=draw(st.sampled_from((math.inf, 1.0))),
        approach_descent_m_s=draw(st.sampled_from((math.inf, 1.0))),
        region=region,
        origin=ORIGIN,
    )


inside_positions = st.tuples(st.floats(-59, 59), st.floats(-59, 59), st.floats(-39, -1)).filter(
    lambda p: FENCED_REGION.breach((p[0], p[1])) is None
)
well_inside_positions = inside_positions.filter(
    lambda p: all(
        FENCED_REGION.breach((p[0] + n, p[1] + e)) is None for n, e in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
)
vehicle_motions = st.builds(VehicleMotion, inside_positions, st.tuples(*[st.floats(-12, 12)] * 3), angles)
unit_quaternions = st.builds(q_from_euler, angles, st.floats(-1.5, 1.5), angles)
setpoints = st.one_of(
    st.builds(lambda p, y: Position(p, **y), vectors, yaws),
    st.builds(lambda v, y: Velocity(v, **y), vectors, yaws),
    st.builds(lambda v, y: VelocityBody(v, **y), vectors, yaws),
    st.builds(lambda a, y: Acceleration(a, **y), vectors, yaws),
    st.builds(lambda p, v, a, y: Trajectory(p, v, a, **y), vectors, vectors, vectors, yaws),
    st.builds(lambda p, v: Trajectory((*p[:2], None), (None, None, v[2])), vectors, vectors),
    st.builds(
        lambda n, e, alt, y: PositionGlobal(47.4 + n / 1e5, 8.5 + e / 1e5, alt_amsl_m=480 + alt, **y),
        numbers,
        numbers,
        numbers,
        yaws,
    ),
    st.builds(
        lambda q, t, r: Attitude(q, t, r), unit_quaternions, st.floats(0, 1), st.none() | st.floats(-20, 20)
    ),
    st.builds(Rates, vectors, st.floats(0, 1)),
)


def is_at_most(value, maximum):
    return value <= maximum * (1 + 1e-9) + 1e-6


ROUNDING_STEPS = ((0.0, 0.0), (1e-6, 0.0), (-1e-6, 0.0), (0.0, 1e-6), (0.0, -1e-6))


def inside_fence(position_ned, limits):
    """Whether a position is inside the region, or on its edge within rounding errors."""
    n, e = position_ned
    return any(limits.region.breach((n + dn, e + de)) is None for dn, de in ROUNDING_STEPS)


def assert_speeds_within(velocity, limits):
    n, e, d = velocity
    if n is not None:
        assert is_at_most(math.hypot(n, e), limits.speed_m_s)
    if d is not None:
        assert is_at_most(d, limits.descent_m_s)
        assert is_at_most(-d, limits.climb_m_s)


def assert_stops_inside(velocity, motion, limits):
    """Checks that a vehicle with this velocity, braked after the delay, stops inside the region."""
    n, e, d = (axis or 0.0 for axis in velocity)
    position, speed = motion.position_ned_m, math.hypot(n, e)
    if speed > 1e-6:
        stop_m = speed * BRAKE_DELAY_S + speed**2 / (2 * BRAKE_M_S2)
        assert (
            stop_m
            <= limits.region.distance_to_edge_m((position[0], position[1]), (n / speed, e / speed)) + 1e-6
        )
    stop_m = abs(d) * 0.6 + d**2 / 2  # a delay of 0.6 s, and 1 m/s²
    remaining_m = (
        (limits.region.down_max_m - position[2]) if d > 0 else (position[2] - limits.region.down_min_m)
    )
    assert stop_m <= remaining_m + 1e-6


@settings(max_examples=400)
@given(setpoints, bounds(), vehicle_motions, st.none() | setpoints, st.floats(0.005, 1.0))
def test_any_setpoint_is_sent_within_the_limits(requested, limits, motion, previous, dt_s):
    result = apply_limits(requested, limits, motion, previous, dt_s)
    sent = result.setpoint
    assert sent is not None
    assert is_finite(sent)
    yaw_rate = getattr(sent, "yaw_rate_ned_rad_s", None)
    assert yaw_rate is None or is_at_most(abs(yaw_rate), limits.rates_rad_s[2])
    if isinstance(sent, Position | Trajectory):
        n, e, d = sent.position_ned_m
        if n is not None:
            assert inside_fence((n, e), limits)
        if d is not None:
            assert limits.region.down_min_m - 1e-9 <= d <= limits.region.down_max_m + 1e-9
    if isinstance(sent, Velocity | Trajectory):
        assert_speeds_within(sent.velocity_ned_m_s, limits)
        assert_stops_inside(sent.velocity_ned_m_s, motion, limits)
    if isinstance(sent, VelocityBody):
        velocity_ned_m_s = ned_from_heading(sent.velocity_frd_m_s, motion.yaw_ned_rad)
        assert_speeds_within(velocity_ned_m_s, limits)
        assert_stops_inside(velocity_ned_m_s, motion, limits)
    if isinstance(sent, Acceleration):
        n, e, d = sent.acceleration_ned_m_s2
        assert is_at_most(
            math.hypot(n, e), min(limits.acceleration_m_s2, 9.80665 * math.tan(limits.tilt_rad))
        )
        assert is_at_most(-d, limits.acceleration_up_m_s2)
        assert is_at_most(d, limits.acceleration_down_m_s2)
    if isinstance(sent, Attitude):
        assert math.hypot(*sent.q_ned_frd) == pytest.approx(1, abs=1e-6)
        assert is_at_most(tilt_from_q(sent.q_ned_frd), limits.tilt_rad + 1e-6)
        assert 0 <= sent.thrust <= 1
    if isinstance(sent, Rates):
        for value, maximum in zip(sent.rates_frd_rad_s, limits.rates_rad_s, strict=True):
            assert is_at_most(abs(value), maximum)
    if isinstance(sent, PositionGlobal):
        position_ned = ORIGIN.to_ned(sent.lat_deg, sent.lon_deg, sent.alt_amsl_m)
        assert inside_fence(position_ned[:2], limits)
        assert limits.region.clamp_down_m(position_ned[2]) == position_ned[2]
    unchanged = sent == requested
    assert unchanged or result.notes or result.stop_reason, "a change was not reported"


@given(setpoints, bounds(), st.sampled_from((math.nan, math.inf, -math.inf)))
def test_values_that_are_not_finite_are_never_sent(requested, limits, not_finite):
    invalid_setpoint = None
    if isinstance(requested, Velocity):
        invalid_setpoint = Velocity((not_finite, 0.0, 0.0))
    elif isinstance(requested, Rates):
        invalid_setpoint = Rates((0.0, not_finite, 0.0), 0.5)
    elif isinstance(requested, Attitude):
        invalid_setpoint = Attitude((1.0, 0.0, 0.0, 0.0), not_finite)
    else:
        invalid_setpoint = Position((0.0, 0.0, not_finite))
    result = apply_limits(invalid_setpoint, limits, None)
    assert result.setpoint is None
    assert "not a finite number" in result.stop_reason


@given(vectors, bounds())
def test_without_a_position_only_zero_velocities_are_sent_if_there_is_a_fence(velocity, limits):
    for requested in (Velocity(velocity), VelocityBody(velocity)):
        sent = apply_limits(requested, limits, None).setpoint
        values = getattr(sent, "velocity_ned_m_s", None) or getattr(sent, "velocity_frd_m_s", None)
        assert values == (0.0, 0.0, 0.0)


def flight(requested, limits, motion, seconds, tau_s=0.5, dt_s=0.05):
    """The motion of a vehicle that follows velocity setpoints as PX4 does: with a lag and at most 5 m/s²."""
    position, velocity = list(motion.position_ned_m), list(motion.velocity_ned_m_s)
    previous = None
    for _ in range(int(seconds / dt_s)):
        motion_now = VehicleMotion(tuple(position), tuple(velocity), motion.yaw_ned_rad)
        previous = apply_limits(requested, limits, motion_now, previous, dt_s).setpoint
        setpoint_velocity = previous.velocity_ned_m_s
        for axis in range(3):
            acceleration = max(-5.0, min(5.0, (setpoint_velocity[axis] - velocity[axis]) / tau_s))
            velocity[axis] += acceleration * dt_s
            position[axis] += velocity[axis] * dt_s
        yield motion_now


@settings(max_examples=40, deadline=None, phases=[Phase.generate])  # shrinking would take minutes
@given(
    well_inside_positions, st.floats(-math.pi, math.pi), st.floats(3, 12), st.sampled_from((-3.0, 0.0, 3.0))
)
def test_with_a_velocity_towards_any_fence_the_vehicle_stays_inside(start, course, speed, velocity_down_m_s):
    limits = Bounds(speed_m_s=12.0, climb_m_s=4.0, descent_m_s=4.0, region=FENCED_REGION)
    requested = Velocity((speed * math.cos(course), speed * math.sin(course), velocity_down_m_s))
    for motion_now in flight(requested, limits, VehicleMotion(start, (0.0, 0.0, 0.0)), seconds=50):
        n, e, d = motion_now.position_ned_m
        assert FENCED_REGION.breach((n, e)) is None
        assert -40.0 <= d <= 0.0


def test_a_setpoint_along_the_fence_is_stopped_while_the_vehicle_moves_towards_it():
    """The vehicle flies at 8 m/s towards the fence, 10 m before it."""
    limits = Bounds(region=Region(circles=(Circle((0.0, 0.0), 50.0, "50 m"),)))
    motion = VehicleMotion((40.0, 0.0, -10.0), (8.0, 0.0, 0.0))
    sent = apply_limits(Velocity((0.0, 5.0, 0.0)), limits, motion).setpoint
    assert sent.velocity_ned_m_s[:2] == (0.0, 0.0)


def test_outside_the_fence_only_velocities_back_inside_are_sent():
    limits = Bounds(region=Region(circles=(Circle((0.0, 0.0), 50.0, "50 m"),)))
    motion = VehicleMotion((60.0, 0.0, -10.0), (0.0, 0.0, 0.0))
    assert apply_limits(Velocity((-3.0, 0.0, 0.0)), limits, motion).setpoint.velocity_ned_m_s == (
        -3.0,
        0.0,
        0.0,
    )
    result = apply_limits(Velocity((3.0, 0.0, 0.0)), limits, motion)
    assert result.setpoint.velocity_ned_m_s == (-1.0, 0.0, 0.0)
    assert "only velocities that lead back inside" in result.notes[0]


def test_near_the_edge_of_the_fence_the_vehicle_is_moved_back():
    """PX4's integrator moves the vehicle for seconds after the setpoint has become zero."""
    limits = Bounds(region=Region(-20.0, math.inf, (Circle((0.0, 0.0), 50.0, "50 m"),)))
    motion = VehicleMotion((0.0, 49.6, -19.8), (0.0, 0.4, 0.0))
    sent = apply_limits(Velocity((0.0, 0.0, 0.0)), limits, motion).setpoint.velocity_ned_m_s
    assert sent == pytest.approx((0.0, -0.6, 0.3))


def test_outside_the_fence_a_target_beyond_it_is_moved_inside():
    limits = Bounds(region=Region(circles=(Circle((0.0, 0.0), 50.0, "50 m"),)))
    motion = VehicleMotion((60.0, 0.0, -10.0), (0.0, 0.0, 0.0))
    (n, e, _) = apply_limits(Position((90.0, 0.0, -10.0)), limits, motion).setpoint.position_ned_m
    assert math.hypot(n, e) < 50


@pytest.mark.parametrize(
    "requested",
    [Attitude((1.0, 0.0, 0.0, 0.0), 0.5), Rates((0.0, 0.0, 0.0), 0.5), Acceleration((0.0, 0.0, 0.0))],
)
def test_streams_without_position_control_are_stopped_before_the_fence(requested):
    limits = Bounds(region=FENCED_REGION)
    assert (
        apply_limits(requested, limits, VehicleMotion((-30.0, -30.0, -20.0), (1.0, 0.0, 0.0))).stop_reason
        is None
    )
    assert (
        "leave"
        in apply_limits(requested, limits, VehicleMotion((-30.0, -8.0, -20.0), (0.0, 30.0, 0.0))).stop_reason
    )
    assert (
        "leave"
        in apply_limits(requested, limits, VehicleMotion((50.0, 10.0, -20.0), (0.0, 0.0, 0.0))).stop_reason
    )
    assert (
        "altitude"
        in apply_limits(requested, limits, VehicleMotion((-30.0, -30.0, -37.0), (0.0, 0.0, -6.0))).stop_reason
    )
    assert "No valid position" in apply_limits(requested, limits, None).stop_reason
    assert apply_limits(requested, Bounds(), None).stop_reason is None


def test_a_far_target_is_approached_at_the_operators_speed():
    """PX4 would use its own speed, so the sent position is a short distance ahead of the vehicle."""
    limits = Bounds(approach_m_s=3.0, position_gain=0.95)
    motion = VehicleMotion((0.0, 0.0, -10.0), (3.0, 0.0, 0.0))
    result = apply_limits(Position((100.0, 0.0, -10.0)), limits, motion)
    assert result.setpoint.position_ned_m[0] == pytest.approx(3.0 / 0.95)
    assert result.notes == ("speed limited to 3 m/s",)
    near_target = Position((102.0, 0.0, -10.0))
    assert (
        apply_limits(near_target, limits, VehicleMotion((100.0, 0.0, -10.0), (0.0, 0.0, 0.0))).setpoint
        == near_target
    )


@given(st.floats(0, 200))
def test_at_the_braking_speed_the_vehicle_stops_within_the_distance(distance_m):
    speed = braking_speed(distance_m, BRAKE_M_S2, BRAKE_DELAY_S)
    assert speed * BRAKE_DELAY_S + speed**2 / (2 * BRAKE_M_S2) == pytest.approx(distance_m, abs=1e-6)
