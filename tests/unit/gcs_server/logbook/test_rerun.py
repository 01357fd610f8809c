"""A flight is flown again from its log: unchanged it stays with the log, and a change does what it does to a
simulated flight with that change."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from gcs_server.logbook import columns, overview, tasks
from gcs_server.logbook.ulog import read_ulog
from missions.what_if.flight import NotFlyable
from tests.support.flown_log import flown_log
from vehicle_sim.parameters import Parameters

pytestmark = pytest.mark.flight

WIND = (1.0, 3.0, 0.0)
RECORDED = Path(__file__).resolve().parents[5] / "shared/px4/logs/flight-short.ulg.gz"


def fly(folder, parameters=None):
    """The columns of a flight's log, and the time of its step."""
    path, step_s = flown_log(folder / "vehicle", WIND, parameters)
    log = read_ulog(path)
    columns.write(log, overview.encode(log), folder / "columns")
    return folder / "columns", step_s


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flight"))


def rerun(flight, *, duration_s=7.0, before_s=0.5, parameters=None, wind=None, health=None, moved=None):
    folder, step_s = flight
    from_s = step_s - before_s
    change = {"parameters": parameters or {}, "wind_ned_m_s": wind, "motor_health": health}
    change["moved_ned_m"] = moved
    return json.loads(tasks.rerun(str(folder), from_s, from_s + duration_s, change))


def north(track):
    return np.array(track["position_ned_m"])[:, 0]


def test_an_unchanged_flight_stays_with_the_log_and_finds_the_wind(flight):
    result = rerun(flight)
    assert result["max_error_m"] < 0.8
    assert result["source"] == "parameters"
    assert result["wind_ned_m_s"] == pytest.approx(WIND, abs=0.4)
    assert result["changed"] == result["unchanged"]
    assert north(result["logged"])[-1] == pytest.approx(8.0, abs=0.8)
    assert len(result["t_s"]) == len(result["error_m"]) == len(north(result["changed"])) == 70


def test_a_changed_gain_flies_as_a_vehicle_with_that_gain(flight, tmp_path):
    slower = {"MPC_XY_P": 0.4, "MPC_XY_VEL_MAX": 3.0}
    true = rerun(fly(tmp_path, slower))
    predicted = rerun(flight, parameters=slower)
    apart = np.abs(north(true["logged"]) - north(predicted["logged"])).max()
    assert apart > 1.0, "the change makes a difference"
    assert np.abs(north(predicted["changed"]) - north(true["logged"])).max() < 0.2 * apart


def test_a_body_that_no_parameter_describes_is_found_in_the_flight(flight, tmp_path):
    folder, step_s = flight
    unknown = tmp_path / "columns"
    unknown.mkdir()
    for name in ("columns.json", "columns.bin"):
        (unknown / name).symlink_to(folder / name)
    log = json.loads((folder / columns.OVERVIEW).read_text())
    log["parameters"] = [each for each in log["parameters"] if not each["name"].startswith("SIH_")]
    (unknown / columns.OVERVIEW).write_text(json.dumps(log))
    result = rerun((unknown, step_s))
    own = Parameters()
    thrust_m_s2 = 4 * own.get("SIH_T_MAX") / own.get("SIH_MASS")
    assert result["source"] == "flight"
    assert result["model"]["thrust_m_s2"]["value"] == pytest.approx(thrust_m_s2, rel=0.1)
    assert result["model"]["drag_per_s"]["value"] == pytest.approx(
        own.get("SIH_KDV") / own.get("SIH_MASS"), rel=0.1
    )
    assert result["max_error_m"] < 1.5


def test_a_stopped_motor_brings_the_vehicle_down_to_the_lowest_known_height(flight):
    result = rerun(flight, health=[0.0, 1.0, 1.0, 1.0])
    down = np.array(result["changed"]["position_ned_m"])[:, 2]
    lowest = np.array(result["logged"]["position_ned_m"])[:, 2].max()
    assert down.max() == pytest.approx(lowest, abs=1.0)
    assert np.array(result["changed"]["velocity_ned_m_s"])[-1] == pytest.approx([0, 0, 0])


def test_a_moved_target_is_flown_to_instead(flight):
    result = rerun(flight, moved=[0.0, 3.0, -1.0])
    unchanged, changed = (np.array(result[each]["position_ned_m"])[-1] for each in ("unchanged", "changed"))
    assert changed - unchanged == pytest.approx([0.0, 3.0, -1.0], abs=0.3)


def test_other_wind_pushes_the_vehicle(flight):
    east = np.array(rerun(flight, wind=[1.0, -8.0, 0.0])["changed"]["position_ned_m"])[:, 1]
    assert east.min() < -1.0


@pytest.mark.parametrize(
    ("changed", "field", "words"),
    [
        ({"parameters": {"MPC_ACC_HOR": 2.0}}, "parameters", "MPC_ACC_HOR does not change"),
        ({"parameters": {"NO_SUCH": 2.0}}, "parameters", "NO_SUCH does not change"),
        ({"parameters": {"SIH_MASS": 0.0}}, "parameters", "SIH_MASS is 0.0"),
        ({"before_s": 24.0}, "from_s", "not in the air"),
        ({"before_s": -500.0}, "from_s", "The log ends"),
    ],
)
def test_what_cannot_be_flown_is_refused_with_the_reason(flight, changed, field, words):
    with pytest.raises(NotFlyable, match=words) as refused:
        rerun(flight, **changed)
    assert refused.value.field == field


@pytest.mark.skipif(not RECORDED.exists(), reason="without ../shared/px4/logs/flight-short.ulg.gz")
@pytest.mark.parametrize("from_s", [16.0, 20.0, 30.0])
def test_a_recorded_px4_stays_near_its_log(tmp_path, from_s):
    path = tmp_path / "flight.ulg"
    path.write_bytes(gzip.decompress(RECORDED.read_bytes()))
    log = read_ulog(path)
    columns.write(log, overview.encode(log), tmp_path / "columns")
    change = {"parameters": {}, "wind_ned_m_s": None, "motor_health": None}
    result = json.loads(tasks.rerun(str(tmp_path / "columns"), from_s, from_s + 8.0, change))
    assert result["max_error_m"] < 1.0
