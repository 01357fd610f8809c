"""Dry runs of offboard missions, with the same runner as for real vehicles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from missions.dry_run.fleet import Fleet
from missions.dry_run.offboard import send
from missions.dry_run.plans import FlyableMission
from missions.dry_run.result import DryRun, dry_run
from missions.dry_run.setup import Conditions
from missions.dry_run.task import run
from missions.geodesy import LocalOrigin
from missions.setpoints import Attitude, Position, Trajectory, Velocity
from tests.support.dry_runs import AIRCRAFT, FAST_PARAMETERS, HOME
from tests.support.offboard_missions import mission
from vehicle_sim.autopilot.offboard import Setpoint, SetpointKind

pytestmark = pytest.mark.flight

STEPS = """
- {step: take_off, height_m: 4}
- {step: gimbal, track: fixed, pitch_rad: -0.5}
- {step: fly, points: [{offset_ned_m: [10, 0, -4]}], speed_m_s: 5, name: North}
- {step: wait, until: person, timeout_s: 60, message: Is the field clear?}
- step: branch
  condition: {value: battery_share, above: 0.5}
  then: [{step: hold, duration_s: 1}]
  otherwise: [{step: hold, duration_s: 100}]
- {step: land}
"""
DISTANT_ORIGIN = LocalOrigin(*LocalOrigin(HOME.lat_deg, HOME.lon_deg, 470.0).to_geodetic((30.0, -20.0, 0.0)))


@pytest.fixture(scope="module")
def flight() -> DryRun:
    """A mission flown with the vehicle 30 m south and 20 m east of its local origin, and 10 m above it."""
    return dry_run(FlyableMission.from_mission(mission(STEPS), AIRCRAFT, origin=DISTANT_ORIGIN), AIRCRAFT)


def test_a_mission_is_flown_to_its_end_step_by_step(flight):
    assert (flight.finished, flight.landed) == (True, True)
    assert flight.findings == ()
    places = [step.place for step in flight.steps]
    assert places[0] == "step 1"
    assert places[-1] == "step 6"
    assert {"step 3", "step 5 then 1"} <= set(places)
    assert flight.duration_s < 40.0, "a question delayed the flight, or the wrong branch was flown"


def test_the_path_of_a_dry_run_is_relative_to_the_start_for_any_local_origin(flight):
    assert flight.track is not None
    assert flight.track.position_ned_m[0] == pytest.approx((0.0, 0.0, 0.0), abs=0.1)
    assert flight.track.position_ned_m[-1] == pytest.approx((10.0, 0.0, 0.0), abs=2.0)
    assert np.abs(flight.track.position_ned_m[:, 1]).max() < 2.0


def test_a_gimbal_step_sets_the_pitch_of_the_gimbal(flight):
    assert flight.track is not None
    assert flight.track.gimbal_rad is not None
    fly_step = next(step for step in flight.steps if step.title == "North")
    index = int(np.searchsorted(flight.track.t_s, fly_step.end_s))
    assert flight.track.gimbal_rad[index, 0] == pytest.approx(-0.5, abs=0.05)


def test_a_fly_step_takes_its_planned_time(flight):
    assert flight.track is not None
    timeline = FlyableMission.from_mission(mission(STEPS), AIRCRAFT).timeline
    fly_step = next(step for step in flight.steps if step.title == "North")
    planned = next(segment for segment in timeline.segments if segment.title == "North")
    assert fly_step.end_s - fly_step.start_s == pytest.approx(planned.duration_s, abs=0.5)


def test_a_take_off_that_ends_off_its_planned_height_does_not_end_the_mission():
    """The altitude may drift before take-off; in a dry run, only the vehicle itself ends a take-off."""
    take_off = mission("- {step: take_off, height_m: 2.5}\n- {step: hold, duration_s: 1}\n")
    flyable = FlyableMission.from_mission(take_off, AIRCRAFT)
    fleet = Fleet([AIRCRAFT], [Conditions()], seed=3)
    pilot = replace(flyable, start_ned_m=(0.0, 0.0, 1.5)).make_pilot(fleet.vehicles[0])
    while not pilot.runner.over and pilot.runner.state != "suspended" and fleet.time_s < 20.0:
        fleet.tick()
        pilot.tick(fleet.time_s)
    assert (pilot.runner.state, pilot.runner.status(pilot.reading()).reason) == ("done", None)


class SetpointRecorder:
    """Records the setpoints that an offboard receiver gets."""

    def __init__(self) -> None:
        self.trajectories: list[Setpoint] = []
        self.attitudes: list[tuple] = []

    def trajectory(self, setpoint: Setpoint) -> None:
        self.trajectories.append(setpoint)

    def attitude(self, *arguments) -> None:
        self.attitudes.append(arguments)


def test_fields_that_a_setpoint_does_not_control_are_nan():
    received, start = SetpointRecorder(), (1.0, 2.0, -3.0)
    send(received, Position((11.0, None, -8.0), 0.5), start)
    send(received, Velocity((1.0, 0.0, None)), start)
    send(received, Trajectory((1.0, 2.0, -3.0), (1.0, 0.0, 0.0), (0.0, 0.1, 0.0), 0.2, 0.3), start)
    send(received, Attitude((1.0, 0.0, 0.0, 0.0), 0.5), start)
    nan, nan3 = math.nan, (math.nan, math.nan, math.nan)
    expected = [
        (SetpointKind.POSITION, (10.0, nan, -5.0), nan3, nan3, 0.5, nan),
        (SetpointKind.VELOCITY, nan3, (1.0, 0.0, nan), nan3, nan, nan),
        (SetpointKind.POSITION, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.1, 0.0), 0.2, 0.3),
    ]
    for setpoint, fields in zip(received.trajectories, expected, strict=True):
        assert repr(setpoint[:6]) == repr(fields)  # NaN is not equal to itself
    assert received.attitudes[0][0] == 7  # type mask: the body rates are not used


def test_a_dry_run_task_reports_progress_and_can_be_cancelled():
    reports: list[tuple[str, float | None]] = []

    class Cancelled(Exception):
        pass

    def progress(text: str, share: float | None) -> None:
        reports.append((text, share))
        if len(reports) == 3:
            raise Cancelled

    request = {
        "kind": "offboard_mission", "plan": mission(STEPS).model_dump_json(), "origin": None,
        "aircraft": {"home": HOME.model_dump(), "parameters": FAST_PARAMETERS},
        "conditions": {"wind_ned_m_s": [0, 1, 0]}, "obstacles": [], "seed": 1, "flights": None,
        "spread": None,
    }  # fmt: skip
    with pytest.raises(Cancelled):
        run(request, progress)
    assert reports[0][0] == "1 s of the flight are simulated."
    shares = [share for _, share in reports]
    assert shares == sorted(shares)
