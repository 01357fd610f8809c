"""The simulated PX4 flies on from a moment of a logged mission: unchanged it stays with the log, and a change
does what it does to a simulated flight with that change."""

import gzip
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_server.logbook import overview, tasks
from gcs_server.logbook.columns import Columns
from gcs_server.logbook.columns import write as write_columns
from gcs_server.logbook.flown import autopilot_at, flown
from gcs_server.logbook.log import Log, Topic
from gcs_server.logbook.ulog import read_ulog
from missions.plan import write
from missions.what_if.autopilot import AutopilotChange, AutopilotFlights
from missions.what_if.flight import NotFlyable
from missions.what_if.rerun import Change
from tests.support.flown_mission import ALTITUDE_M, HOME, flown_mission, square

pytestmark = pytest.mark.flight

TO_SECOND_CORNER = 2
RECORDED = Path(__file__).resolve().parents[5] / "shared/px4/logs/flight-short.ulg.gz"
NEAR_M = 0.5
"""Without noise of the sensors; with it, the logged estimates are themselves wrong by some decimetres."""


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A flight towards the second corner, and home."""
    return flown_mission(
        tmp_path_factory.mktemp("mission"), square(), until_item=TO_SECOND_CORNER, fly_on_s=50.0
    )


def rerun(flight, *, after_s=0.0, duration_s=40.0, plan=True, **change):
    folder, moment_s = flight
    request = {
        "flown_by": "autopilot", "parameters": {}, "wind_ned_m_s": None, "motor_health": None,
        "moved_ned_m": None, "battery_percent": None, "lost": [], "item": None,
    }  # fmt: skip
    from_s, text = (
        moment_s + after_s,
        {"kind": "waypoint_plan", "text": write(square()).decode()} if plan else None,
    )
    return json.loads(tasks.rerun(str(folder), from_s, from_s + duration_s, request | change, text))


def item(number, **change):
    return {"number": number, "moved_ned_m": None, "speed_m_s": None, "then": None, **change}


def position(track):
    return np.array(track["position_ned_m"])


def modes(track):
    return [each["text"] for each in track["modes"]]


def nearest_m(track, north_m, east_m):
    return np.hypot(*(position(track)[:, :2] - (north_m, east_m)).T).min()


def test_an_unchanged_mission_stays_with_the_log_over_its_corners_and_in_return(flight):
    result = rerun(flight)
    assert result["max_error_m"] < NEAR_M
    assert modes(result["unchanged"]) == ["Mission", "Return"]
    assert result["changed"]["position_ned_m"] == result["unchanged"]["position_ned_m"]
    assert nearest_m(result["unchanged"], 0.0, 40.0) < 3.0, "the third corner"
    assert result["notes"] == []


@pytest.mark.parametrize("after_s", [-14.0, 10.0, 11.0, 30.0, 45.0])
def test_it_flies_on_from_other_moments_too(flight, after_s):
    assert rerun(flight, after_s=after_s, duration_s=20.0)["max_error_m"] < NEAR_M


@pytest.mark.story
def test_a_low_battery_does_what_its_action_says_as_in_a_flight_with_it(flight, tmp_path):
    def drain(station):
        station.sim.simulation.set_battery_remaining(0, 0.06)

    drained = flown_mission(
        tmp_path, square(), until_item=TO_SECOND_CORNER, then=drain, fly_on_s=40.0,
        parameters={"COM_LOW_BAT_ACT": 3},
    )  # fmt: skip
    true = rerun(drained)["logged"]
    warned = rerun(flight, battery_percent=6.0, parameters={"COM_LOW_BAT_ACT": 0})["changed"]
    result = rerun(flight, battery_percent=6.0, parameters={"COM_LOW_BAT_ACT": 3})
    returned = result["changed"]
    assert result["notes"] == [], "the parameter was used"
    assert modes(warned) == ["Mission", "Return"], "the plan's own Return"
    assert any("attery" in each["text"] for each in warned["warnings"])
    assert modes(returned)[-1] == "Return"
    count = min(len(position(true)), len(position(returned)))
    assert np.abs(position(true)[:count] - position(returned)[:count]).max() < 2 * NEAR_M
    assert nearest_m(returned, 0.0, 40.0) > 15.0, "it never came to the third corner"


def test_another_return_altitude_is_flown(flight):
    result = rerun(flight, after_s=15.0, parameters={"RTL_RETURN_ALT": 35.0})
    top = {name: -position(result[name])[:, 2].min() for name in ("unchanged", "changed")}
    assert top == {"unchanged": pytest.approx(20.0, abs=1.0), "changed": pytest.approx(35.0, abs=1.0)}


@pytest.mark.parametrize(
    ("lost", "parameters", "last"),
    [
        (["data_link"], {"NAV_DLL_ACT": 2}, "Return"),
        (["data_link"], {"NAV_DLL_ACT": 0}, "Mission"),
        (["manual_control"], {"NAV_RCL_ACT": 3, "COM_RC_IN_MODE": 1}, "Land"),
        (["gps"], {}, "Descend"),
    ],
)
def test_what_is_lost_is_answered_by_its_failsafe(flight, lost, parameters, last):
    result = rerun(flight, duration_s=25.0, lost=lost, parameters=parameters, item=item(3, then="hold"))
    assert modes(result["changed"])[-1] == last
    assert modes(result["unchanged"]) == ["Mission", "Return"]


def test_a_lower_geofence_is_answered_by_its_action(flight):
    result = rerun(flight, parameters={"GF_MAX_VER_DIST": 15.0, "GF_ACTION": 5})
    assert modes(result["changed"]) == ["Mission", "Return", "Land"]
    assert modes(result["unchanged"]) == ["Mission", "Return"]


def test_a_moved_item_moves_the_track_there_and_the_rest_stays(flight):
    result = rerun(flight, item=item(3, moved_ned_m=[15.0, 10.0, -8.0]))
    assert nearest_m(result["changed"], 55.0, 50.0) < 3.0
    assert nearest_m(result["unchanged"], 55.0, 50.0) > 15.0
    assert -position(result["changed"])[:, 2].min() == pytest.approx(ALTITUDE_M + 8.0, abs=1.0)
    assert nearest_m(result["changed"], 0.0, 40.0) < 3.0


def test_another_speed_and_another_action_after_an_item_are_flown(flight):
    slow = rerun(flight, duration_s=10.0, item=item(3, speed_m_s=2.0))["changed"]
    speed = np.linalg.norm(np.array(slow["velocity_ned_m_s"])[-10:], axis=1)
    assert speed == pytest.approx(2.0, abs=0.3)
    landed = rerun(flight, item=item(3, then="land"))["changed"]
    assert position(landed)[-1] == pytest.approx([40.0, 40.0, 0.0], abs=1.5)
    returned = rerun(flight, item=item(3, then="return"))["changed"]
    assert nearest_m(returned, 0.0, 40.0) > 15.0
    assert modes(returned) == ["Mission", "Return"]


def test_a_parameter_that_is_not_used_says_so(flight):
    result = rerun(flight, duration_s=5.0, parameters={"RTL_DESCEND_ALT": 11.0})
    assert result["notes"] == [
        "The simulated PX4 did not use RTL_DESCEND_ALT in this part: it changes nothing."
    ]


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ({"plan": False}, "plan", "does not know the plan"),
        ({"item": item(9)}, "item", "no item 9; it has 5"),
        ({"item": item(1, then="hold")}, "item", "Item 1 was flown before; the vehicle flew to item 3"),
        ({"item": item(5, moved_ned_m=[1.0, 0.0, 0.0])}, "item", "Item 5 has no position"),
        ({"after_s": 45.0, "item": item(5, then="hold")}, "item", "flew in Return"),
        ({"parameters": {"NO_SUCH": 1.0}}, "parameters", "NO_SUCH is not a parameter"),
        ({"parameters": {"SIH_MASS": 0.0}}, "parameters", "SIH_MASS is 0.0"),
        ({"moved_ned_m": [1.0, 0.0, 0.0]}, "moved_ned_m", "move a plan item or a mission step"),
        ({"after_s": -27.0}, "from_s", "not in the air"),
        ({"after_s": -24.0}, "from_s", "not above the height of its home"),
        ({"after_s": -500.0}, "from_s", "no home position"),
        ({"parameters": {"GF_MAX_HOR_DIST": 30.0, "GF_ACTION": 2}}, "plan", "item lies outside the geofence"),
    ],
)
def test_what_cannot_be_flown_on_is_refused_with_the_reason(flight, change, field, words):
    with pytest.raises(NotFlyable, match=words) as refused:
        rerun(flight, **change)
    assert refused.value.field == field


def test_a_mode_with_foreign_setpoints_is_refused(flight):
    folder, moment_s = flight
    log = Columns(folder)
    logged = autopilot_at(log, "PX4 v1.16.2", moment_s, moment_s + 5.0)
    assert (logged.nav_state, logged.mission_item, logged.release) == (3, TO_SECOND_CORNER, (1, 16))
    part = flown(log, {}, moment_s, moment_s + 5.0)
    offboard = replace(logged, nav_state=14)
    with pytest.raises(NotFlyable, match="flew in Offboard then") as refused:
        AutopilotFlights(
            part, offboard, None, {}, np.zeros((len(part.t_s), 3)), Change({}), AutopilotChange()
        )
    assert refused.value.field == "plan"


def test_return_climbs_above_the_logged_target(flight):
    """It began its Return with some speed, and climbs above the place where it stops."""
    folder, moment_s = flight
    target_ned_m = autopilot_at(Columns(folder), None, moment_s + 23.5, moment_s + 43.5).target_ned_m
    assert target_ned_m == pytest.approx((1.94, 40.14, -20.0), abs=0.1)
    assert rerun(flight, after_s=23.5, duration_s=20.0)["max_error_m"] < 1.0


def test_hold_flies_to_the_logged_target_and_a_later_one_is_said(tmp_path):
    lat_deg, lon_deg, alt_amsl_m = HOME.to_geodetic((30.0, -20.0, -15.0))
    at_s, step = np.arange(0.0, 9.0, 0.2), np.arange(45) >= 20
    values = {
        "position_setpoint_triplet": {
            "current.valid": np.ones(45), "current.type": np.full(45, 2.0),
            "current.lat": np.where(step, lat_deg + 1e-4, lat_deg), "current.lon": np.full(45, lon_deg),
            "current.alt": np.full(45, alt_amsl_m),
        },
        "vehicle_local_position": {
            "ref_lat": np.full(45, HOME.lat_deg), "ref_lon": np.full(45, HOME.lon_deg),
            "ref_alt": np.full(45, HOME.alt_amsl_m),
        },
        "home_position": {
            "valid_hpos": np.ones(45), "valid_alt": np.ones(45), "valid_lpos": np.ones(45),
            "lat": np.full(45, HOME.lat_deg), "lon": np.full(45, HOME.lon_deg),
            "alt": np.full(45, HOME.alt_amsl_m), "x": np.zeros(45), "y": np.zeros(45), "z": np.zeros(45),
        },
        "vehicle_status": {
            "nav_state": np.full(45, 4), "nav_state_user_intention": np.where(step, 18, 4),
            "arming_state": np.full(45, 2),
        },
    }  # fmt: skip
    topics = [Topic(name, "0", at_s, columns, {}) for name, columns in values.items()]
    log = Log(kind="ulog", start_unix_s=None, duration_s=9.0, topics=topics, vehicles=[])
    write_columns(log, overview.encode(log), tmp_path / "columns")
    logged = autopilot_at(Columns(tmp_path / "columns"), None, 1.0, 8.0)
    assert logged.target_ned_m == pytest.approx((30.0, -20.0, -15.0), abs=0.01)
    assert (logged.next_target_s, logged.switched) == (pytest.approx(4.0), (pytest.approx(4.0), 18))
    assert (logged.battery, logged.mission_item, logged.release) == (None, None, None)


@pytest.mark.skipif(not RECORDED.exists(), reason="without ../shared/px4/logs/flight-short.ulg.gz")
@pytest.mark.parametrize(
    ("from_s", "duration_s", "mode"),
    [(20.4, 3.7, "Hold"), (24.5, 4.5, "Hold"), (29.5, 9.0, "Land"), (33.2, 6.0, "Land")],
)
def test_a_recorded_px4_stays_near_its_log(tmp_path, from_s, duration_s, mode):
    """A real PX4 v1.16 (its own SIH): hovering, then a go-to in Hold, then a landing."""
    path = tmp_path / "flight.ulg"
    path.write_bytes(gzip.decompress(RECORDED.read_bytes()))
    log = read_ulog(path)
    write_columns(log, overview.encode(log), tmp_path / "columns")
    result = rerun((tmp_path / "columns", from_s), duration_s=duration_s, plan=False)
    assert modes(result["unchanged"]) == [mode]
    assert result["max_error_m"] < 1.0
    assert result["notes"] == []
