"""What the vehicle does in Mission mode without a ground station, by its parameters."""

import pytest

from gcs_server.flights.waypoint_flights import link_loss_text


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({}, None),
        ({"COM_DL_LOSS_T": 10, "COM_DLL_EXCEPT": 0}, None),
        ({"NAV_DLL_ACT": 0}, "The vehicle continues the mission (NAV_DLL_ACT 0)."),
        ({"NAV_DLL_ACT": 2, "COM_DLL_EXCEPT": 5}, "The vehicle continues the mission (COM_DLL_EXCEPT 5)."),
        (
            {"NAV_DLL_ACT": 1, "COM_DL_LOSS_T": 10, "COM_DLL_EXCEPT": 2},
            "After about 10 s without any ground station, the vehicle holds its position in Hold mode "
            "(NAV_DLL_ACT 1).",
        ),
        (
            {"NAV_DLL_ACT": 2, "COM_DL_LOSS_T": 10, "COM_FAIL_ACT_T": 5.0},
            "After about 10 s without any ground station, the vehicle holds for 5 s, then returns (RTL) "
            "(NAV_DLL_ACT 2).",
        ),
        (
            {"NAV_DLL_ACT": 3, "COM_DL_LOSS_T": 10},
            "After about 10 s without any ground station, the vehicle holds for COM_FAIL_ACT_T, then lands "
            "at its current position (NAV_DLL_ACT 3).",
        ),
        (
            {"NAV_DLL_ACT": 3, "COM_DL_LOSS_T": 10, "COM_FAIL_ACT_T": 0.0},
            "After about 10 s without any ground station, the vehicle lands at its current position "
            "(NAV_DLL_ACT 3).",
        ),
        (
            {"NAV_DLL_ACT": 5, "COM_DL_LOSS_T": 7},
            "After about 7 s without any ground station, the vehicle terminates the flight: the motors stop "
            "and it falls (NAV_DLL_ACT 5).",
        ),
        (
            {"NAV_DLL_ACT": 9},
            "After COM_DL_LOSS_T without any ground station, the vehicle does an action that is unknown to "
            "this server (NAV_DLL_ACT 9).",
        ),
    ],
)
def test_the_action_after_link_loss_is_described_with_the_parameter_that_sets_it(parameters, text):
    assert link_loss_text(parameters) == text
