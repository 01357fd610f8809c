"""Simulated flights with faults: their logs, with PX4's default topics, show the fault; healthy flights are
silent. `python -m tests.bench findings` flies two hundred."""

import pytest

from gcs_server.logbook.findings.table import findings
from gcs_server.logbook.ulog import read_ulog
from tests.support.finding_flights import CASES, case, fly

pytestmark = pytest.mark.flight
SHORT = case(
    "vibration, noise on the GPS and a loaded processor",
    "vibration_m_s2: 4, gps_jamming: 130, cpu_load: 0.98, battery_resistance_ohm: 0.12",
)


def kinds(one, folder, seed):
    return [
        {each["kind"] for each in findings(read_ulog(path))["findings"]} for path in fly(one, folder, 1, seed)
    ]


def test_several_faults_of_one_flight_are_found(tmp_path):
    (found,) = kinds(SHORT, tmp_path, 3)
    assert {"vibration", "gps_interference", "load", "battery_resistance"} <= found
    assert found <= {"vibration", "gps_interference", "load", "battery_resistance", "battery_sag"}


@pytest.mark.story
@pytest.mark.parametrize("one", CASES, ids=lambda one: one.name)
def test_each_fault_of_a_flight_is_found_and_a_healthy_one_is_silent(one, tmp_path):
    (found,) = kinds(one, tmp_path, 5)
    assert found & one.expected if one.expected else not found
