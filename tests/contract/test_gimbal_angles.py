"""The angles of the simulated gimbal after each recorded gimbal dialogue, compared with those of PX4."""

import math
from pathlib import Path
from typing import Any

from tests.contract.driver import DialoguePlayer
from tests.contract.recordings import load_dialogues
from tests.contract.replay_vehicle import Vehicle

ANGLE_TOLERANCE_DEG = 1.5
"""The vehicle's heading drifted by one or two degrees while the recording read the angles."""

READ_BEFORE_END_S = 0.3
"""The recording read the angles 2.0 s after the command; each dialogue lasts 2.3 s."""

UNRECORDED_START = "an earlier, unrecorded step commanded other angles"
POINT_BELOW = "the point is straight below, so GPS noise determines the bearing"
EXPLAINED: dict[str, str] = {  # cause of a difference, by the id of the dialogue
    "gimbal_pitchyaw_other_sender": UNRECORDED_START,
    "gimbal_release_by_non_owner": UNRECORDED_START,
    "gimbal_secondary_commands": UNRECORDED_START,
    "gimbal_take_for_third_party": UNRECORDED_START,
    "gimbal_take_back": UNRECORDED_START,
    "mount_control_gps_point": POINT_BELOW,
    "gimbal_release_end": POINT_BELOW,
}


def gimbal_angles(vehicle: Vehicle) -> dict[str, float]:
    _, mount = vehicle.newest_messages["gcs", "MOUNT_ORIENTATION"]
    _, device = vehicle.newest_messages["gcs", "GIMBAL_DEVICE_ATTITUDE_STATUS"]
    return {
        "device_flags": device["flags"],
        "mount_roll": mount["roll"],
        "mount_pitch": mount["pitch"],
        "mount_yaw": mount["yaw"],
    }


def angle_differences(real: dict[str, Any], simulated: dict[str, float]) -> list[str]:
    different = []
    for name, value in simulated.items():
        difference = (
            abs(math.remainder(value - real[name], 360.0)) if name != "device_flags" else value != real[name]
        )
        if difference > (ANGLE_TOLERANCE_DEG if name != "device_flags" else 0):
            different.append(f"{name}: PX4 {real[name]}, simulator {value:.2f}")
    return different


def test_the_simulated_gimbal_reaches_the_recorded_angles(recordings_folder: Path) -> None:
    player = DialoguePlayer(listen=("MOUNT_ORIENTATION",))
    different: dict[str, list[str]] = {}
    compared_count = 0
    for dialogue in load_dialogues(recordings_folder / "dialogues" / "gimbal.jsonl"):
        player.play({**dialogue, "window_s": dialogue["window_s"] - READ_BEFORE_END_S, "received": []})
        if "gimbal_after" not in dialogue:
            continue
        compared_count += 1
        found = angle_differences(dialogue["gimbal_after"], gimbal_angles(player.vehicle))
        if found:
            different[dialogue["id"]] = found
    assert compared_count > 35
    unexplained = {name: found for name, found in different.items() if name not in EXPLAINED}
    assert not unexplained, "\n".join(f"{name}: {found}" for name, found in unexplained.items())
    not_different = [name for name in EXPLAINED if name not in different]
    assert not not_different, f"these no longer differ, delete them from EXPLAINED: {not_different}"
