"""A mission compared with the recording of a real PX4: the time of each item, and the path."""

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.unit.vehicle_sim.plan_station import PlanStation
from tests.unit.vehicle_sim.sim_station import RTL_MODE
from vehicle_sim.px4_version import V1_16

pytestmark = [pytest.mark.flight, pytest.mark.story]

TAKEOFF, ARM, MISSION_START = 22, 400, 300
TIME_TOLERANCE = 0.06
"""Relative tolerance of the times: only the recorded vehicle drifts with GPS noise."""


def test_a_mission_along_a_box_is_flown_as_recorded(reference_data: Path) -> None:
    recording = json.loads(
        gzip.decompress((reference_data / "px4/flights/mission_box_40m.json.gz").read_bytes())
    )
    recorded_times_s: dict[int, float] = {}
    for message in recording["messages"]:
        if message["message"] == "MISSION_ITEM_REACHED":
            recorded_times_s.setdefault(message["fields"]["seq"], message["t_s"])
    columns = {name: k for k, name in enumerate(recording["columns"])}
    rows = np.array([[math.nan if v is None else v for v in row] for row in recording["rows"]], dtype=float)

    station = PlanStation(sensor_noise=False, px4=V1_16)
    station.wait_until_ready_to_arm()
    items = [dict(item) for item in recording["stimulus"][0]["items"]]
    home_item = station.item(TAKEOFF)
    recorded_home_x, recorded_home_y = items[0]["x"], items[0]["y"]
    for item in items:
        if item["x"]:
            item["x"] += home_item["x"] - recorded_home_x
            item["y"] += home_item["y"] - recorded_home_y
        item.update({name: math.nan for name, value in item.items() if value is None})
        del item["seq"], item["mission_type"]
    assert station.upload(items) == 0
    start_s = station.now_s
    station.command(ARM, 1)
    station.run(0.02)
    station.command(MISSION_START)
    track: list[tuple[float, float, float, float]] = []
    station.run_until(
        lambda: station.active_mode == RTL_MODE,
        75,
        lambda: track.append((station.now_s - start_s, *station.position_ne_m, station.height_m)),
    )

    simulated_times_s: dict[int, float] = {}
    for t_s, link, message in station.log:
        if link == "gcs" and message.name == "MISSION_ITEM_REACHED":
            simulated_times_s.setdefault(message.seq, t_s - start_s)
    assert list(simulated_times_s) == list(recorded_times_s) == [0, 1, 2, 3, 4]
    for seq, t_s in recorded_times_s.items():
        assert simulated_times_s[seq] == pytest.approx(t_s, rel=TIME_TOLERANCE), f"item {seq}"
    samples = np.array(track)
    x0, y0 = rows[0, columns["x"]], rows[0, columns["y"]]
    path = rows[rows[:, 0] < recorded_times_s[4]][:, [columns["x"], columns["y"]]] - (x0, y0)
    deviations_m = [np.hypot(*(path - position).T).min() for position in samples[::25, 1:3]]
    assert max(deviations_m) < 1.6, "too far from the recorded path"
    assert samples[:, 3].max() < 10.6
    speeds = np.hypot(np.diff(samples[:, 1]), np.diff(samples[:, 2])) / 0.02
    recorded_speeds = np.hypot(rows[:, columns["vx"]], rows[:, columns["vy"]])
    assert speeds.max() == pytest.approx(recorded_speeds.max(), rel=0.07)
