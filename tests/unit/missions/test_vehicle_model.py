"""The model of an aircraft is found in a flight with honest errors, whatever the ground and the wind do."""

import dataclasses

import numpy as np
import pytest

from missions.what_if.flight import LoggedFlight, NotFlyable
from missions.what_if.model import clear_of_ground, identify
from missions.what_if.vehicle_model import vehicle_model
from missions.what_if.wind import wind_along

STEP_S, GRAVITY = 0.02, 9.80665
TRUE_THRUST, TRUE_DRAG, MASS_KG = 26.0, 0.4, 1.7


def flight(wind=lambda t: (2.0, -1.0), *, moves=True, noise=0.15, seconds=70.0):
    """A flight whose forces are those of a known aircraft: 10 s on the ground (motors spool up), then in the
    air with changing speeds, then 5 s on the ground before that is recognised."""
    random = np.random.default_rng(3)
    t = np.arange(0.0, seconds, STEP_S)
    n = len(t)
    air = (t > 10) & (t < seconds - 10)
    velocity = np.zeros((n, 3))
    if moves:
        velocity[air, 0] = 4 * np.sin(0.5 * t[air])
        velocity[air, 1] = 3 * np.cos(0.3 * t[air])
    velocity[:, 2] = np.where(air & (t < 13), -2.0, 0.0) + np.where(air & (t > seconds - 16), 1.0, 0.0)
    position = np.cumsum(velocity, axis=0) * STEP_S
    blown = np.array([(*wind(each), 0.0) for each in t])
    wanted = np.gradient(velocity, STEP_S, axis=0) - [0, 0, GRAVITY] + TRUE_DRAG * (velocity - blown)
    wanted[~air] = [0, 0, -GRAVITY]
    down = -wanted / np.linalg.norm(wanted, axis=1, keepdims=True)  # body z in NED
    half = 0.5 * np.arccos(np.clip(down[:, 2], -1, 1))
    axis = np.column_stack((-down[:, 1], down[:, 0], np.zeros(n)))
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9)
    q = np.column_stack((np.cos(half), axis * np.sin(half)[:, None]))
    thrust = np.linalg.norm(wanted, axis=1)
    signal = np.where(air, thrust / TRUE_THRUST, np.clip((t - 5) / 10, 0, 0.3))
    relative = velocity - blown
    x, y, z = (q[:, k] for k in (1, 2, 3))
    w = q[:, 0]
    rows = [
        np.column_stack((1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))),
        np.column_stack((2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))),
        np.column_stack((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))),
    ]
    force = -TRUE_DRAG * np.column_stack([np.sum(row * relative, axis=1) for row in rows])
    force[:, 2] -= signal * TRUE_THRUST
    force[~air] = [0, 0, -GRAVITY]
    force += noise * random.standard_normal((n, 3))
    nan3, nan = np.full((n, 3), np.nan), np.full(n, np.nan)
    return LoggedFlight(
        t_s=t, position_ned_m=position, velocity_ned_m_s=velocity, q_ned_frd=q,
        rates_frd_rad_s=np.zeros((n, 3)),
        angular_acceleration_frd_rad_s2=random.standard_normal((n, 3)), force_frd_m_s2=force,
        motors=np.repeat(signal[:, None], 4, axis=1), level=np.full(n, 5),
        landed=(t < 10) | (t > seconds - 5),
        target_position_ned_m=nan3, target_velocity_ned_m_s=nan3, target_acceleration_ned_m_s2=nan3,
        target_yaw_ned_rad=nan, target_yaw_rate_ned_rad_s=nan, commanded_acceleration_ned_m_s2=nan3,
        target_q_ned_frd=q, target_rates_frd_rad_s=nan3, thrust=nan, rate_integral=nan3, hover_thrust=nan,
        parameters={},
    )  # fmt: skip


@pytest.mark.parametrize(
    "wind", [lambda t: (2.0, -1.0), lambda t: (0.0, 5.0 if t > 40 else -3.0)], ids=["steady", "turning"]
)
def test_thrust_drag_and_wind_are_those_of_the_aircraft(wind):
    found = identify(flight(wind), 0.02)
    assert found.thrust_m_s2.value == pytest.approx(TRUE_THRUST, rel=0.02)
    assert found.drag_per_s.value == pytest.approx(TRUE_DRAG, rel=0.1)
    for value, true in ((found.thrust_m_s2, TRUE_THRUST), (found.drag_per_s, TRUE_DRAG)):
        assert abs(value.value - true) < 4 * value.error, "the stated error is honest"
    mean = np.mean([wind(t) for t in np.arange(11, 59)], axis=0)
    assert (found.wind_north_m_s.value, found.wind_east_m_s.value) == pytest.approx(tuple(mean), abs=0.6)


def test_the_mass_is_not_in_the_log_and_scales_what_is():
    unknown, known = vehicle_model(flight(), None), vehicle_model(flight(), MASS_KG)
    assert (unknown.thrust_n, unknown.drag_n_per_m_s) == (None, None)
    assert unknown.notes[0].startswith("A log tells ratios to the mass")
    assert known.thrust_n == pytest.approx(TRUE_THRUST * MASS_KG, rel=0.02)
    assert known.drag_n_per_m_s == pytest.approx(TRUE_DRAG * MASS_KG, rel=0.1)
    assert known.parameters["SIH_MASS"] == MASS_KG
    for name in ("SIH_T_MAX", "SIH_KDV", "SIH_IXX", "SIH_IZZ", "SIH_Q_MAX"):
        assert known.parameters[name] == pytest.approx(MASS_KG * unknown.parameters[name])
    assert known.parameters["MPC_THR_HOVER"] == pytest.approx(GRAVITY / TRUE_THRUST, rel=0.02)
    assert not any(name.startswith("SIH_L_") for name in known.parameters)


def test_a_hover_does_not_say_the_drag_and_says_so():
    model = vehicle_model(flight(moves=False, wind=lambda t: (0.0, 0.0)), None)
    assert not model.turns_known
    assert any("motors at a higher rate" in note for note in model.notes)
    assert model.thrust_m_s2.value == pytest.approx(TRUE_THRUST, rel=0.02)


def test_a_flight_that_says_too_little_is_refused():
    with pytest.raises(NotFlyable, match="Less than 5 s"):
        vehicle_model(flight(seconds=23.0), None)
    logged = flight()
    still = dataclasses.replace(logged, motors=np.zeros_like(logged.motors))
    with pytest.raises(NotFlyable, match="how strong the motors are"):
        vehicle_model(still, None)


def course(logged, drag_per_s=TRUE_DRAG):
    """The wind to the north and east, without the seconds at begin and end of the flight."""
    return wind_along(logged, drag_per_s, clear_of_ground(logged))[(logged.t_s > 14) & (logged.t_s < 56), :2]


def test_a_steady_wind_is_one_value_all_along():
    found = course(flight(noise=0.5))
    assert np.ptp(found, axis=0) == pytest.approx([0, 0], abs=1e-9)
    assert found[0] == pytest.approx([2.0, -1.0], abs=0.15)


def test_a_wind_that_turns_is_followed():
    found = course(flight(lambda t: (8.0 * np.sin(t / 8.0), 5.0 if t > 40 else -3.0)))
    true = np.array(
        [(8.0 * np.sin(t / 8.0), 5.0 if t > 40 else -3.0) for t in np.arange(14 + STEP_S, 56, STEP_S)]
    )
    wrong = np.abs(found - true[: len(found)])
    assert wrong[:, 0].max() < 1.0
    assert np.median(wrong[:, 1]) < 0.2
    assert wrong[:, 1].max() < 5.0, "a step is blurred by a second"


def test_without_accelerometer_the_velocity_says_the_wind():
    logged = flight()
    blind = dataclasses.replace(logged, force_frd_m_s2=np.full_like(logged.force_frd_m_s2, np.nan))
    assert course(blind).mean(axis=0) == pytest.approx([2.0, -1.0], abs=0.2)


def test_a_body_without_drag_feels_no_wind():
    assert not course(flight(), 0.0).any()


def test_a_flight_that_says_nothing_of_the_wind_is_flown_in_calm_air():
    calm = flight(moves=False, wind=lambda t: (0.0, 0.0), noise=20.0, seconds=32.0)
    assert np.abs(wind_along(calm, 0.05, clear_of_ground(calm))).max() < 2.5
