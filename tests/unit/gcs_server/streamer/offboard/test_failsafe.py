"""The text that describes what the vehicle's failsafe does when the stream stops."""

import pytest

from gcs_server.vehicle.autopilot import autopilot_of
from gcs_server.vehicle.px4.stream_loss import StreamLoss


@pytest.mark.parametrize(
    ("failsafe", "expected"),
    [  # COM_OF_LOSS_T [s], COM_OBL_RC_ACT, whether an RC transmitter is connected
        (StreamLoss(1.0, 0, False, 2, (1, 16)), "lands at its current position; it reports Position"),
        (StreamLoss(1.0, 0, False, 2, (1, 17)), "the vehicle returns to launch and lands there, because"),
        (StreamLoss(1.0, 2, False, 3, (1, 17)), "lands at its current position, because"),
        (StreamLoss(1.0, 1, False, None, (1, 18)), "returns to launch"),
        (StreamLoss(1.0, 0, False, 9, (1, 17)), "does what NAV_RCL_ACT selects"),
        (StreamLoss(1.0, 0, True, 2, (1, 17)), "RC pilot in Position mode"),
        (StreamLoss(1.0, 0, False), "or with PX4 v1.17 or newer returns to launch"),
        (StreamLoss(1.0, 0, True), "RC pilot"),
        (StreamLoss(0.5, 3, False), "after 0.5 s the vehicle returns to launch"),
        (StreamLoss(1.0, 5, False), "Hold"),
        (StreamLoss(1.0, 7, False), "falls"),
        (StreamLoss(None, None, False), "from v1.17 on returns to launch"),
        (StreamLoss(None, None, False, None, (1, 16)), "PX4 lands at its current position"),
        (StreamLoss(1.0, 42, False), "unknown to this server"),
    ],
)
def test_the_text_of_a_failsafe_describes_its_action(failsafe, expected):
    assert expected in failsafe.text()


def test_the_release_of_the_vehicle_decides_what_it_does_without_sticks():
    parameters = {"COM_OBL_RC_ACT": 0.0, "NAV_RCL_ACT": 1.0}
    texts = [
        autopilot_of(12, firmware).stream_loss(parameters, False).text()
        for firmware in ("1.16.2", "1.17.0", None)
    ]
    assert "reports Position mode (COM_OBL" in texts[0]
    assert "holds its position in Hold mode, because" in texts[1]
    assert "reports Position mode, or with PX4 v1.17 or newer holds its position" in texts[2]
    assert "unknown" in autopilot_of(3, "4.5.0").stream_loss(parameters, False).text()
