"""The text that describes what the vehicle's failsafe does when the stream stops."""

import pytest

from gcs_server.streamer.offboard.configuration import Failsafe


@pytest.mark.parametrize(
    ("failsafe", "expected"),
    [  # COM_OF_LOSS_T [s], COM_OBL_RC_ACT, whether an RC transmitter is connected
        (Failsafe(1.0, 0, False), "lands at its current position"),
        (Failsafe(1.0, 0, True), "RC pilot"),
        (Failsafe(0.5, 3, False), "after 0.5 s the vehicle returns to launch"),
        (Failsafe(1.0, 5, False), "Hold"),
        (Failsafe(1.0, 7, False), "falls"),
        (Failsafe(None, None, False), "unknown"),
        (Failsafe(1.0, 42, False), "unknown to this server"),
    ],
)
def test_the_text_of_a_failsafe_describes_its_action(failsafe, expected):
    assert expected in failsafe.text()
