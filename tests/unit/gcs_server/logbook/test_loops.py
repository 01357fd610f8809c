"""Step and frequency responses from a log: those of second-order systems whose rise, overshoot and bandwidth
are known; and where a log says too little, it says why."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from gcs_server.logbook import columns, overview, tasks
from gcs_server.logbook.log import Log, Span, Topic, VehicleStates
from gcs_server.logbook.loops import MAX_POINTS, loops
from gcs_server.logbook.ulog import read_ulog
from tests.support.flown_log import flown_log

END_S = 80.0
RECORDED = Path(__file__).resolve().parents[5] / "shared/px4/logs/flight-short.ulg.gz"


def second_order(values, rate_hz, natural_hz, damping):
    """Output of y'' = w² (u - y) - 2 d w y' for an input that is linear between its samples."""
    fine, w = 20, 2 * np.pi * natural_hz
    step_s, y, speed, out = 1 / rate_hz / fine, 0.0, 0.0, []
    for now, after in zip(values, np.append(values[1:], values[-1]), strict=True):
        out.append(y)
        for k in range(fine):
            wanted = now + (after - now) * k / fine
            speed += step_s * (w * w * (wanted - y) - 2 * damping * w * speed)
            y += step_s * speed
    return np.array(out)


def truth(natural_hz, damping):
    """Rise time, overshoot and bandwidth of the system."""
    response = second_order(np.ones(20_000), 5000, natural_hz, damping)
    rise_s = (np.argmax(response >= 0.9) - np.argmax(response >= 0.1)) / 5000
    e = 1 - 2 * damping**2
    return rise_s, max(0.0, response.max() - 1.0), natural_hz * np.sqrt(e + np.sqrt(e * e + 1))


def steps(rate_hz, every_s, size, lag_s, seed=0, end_s=END_S):
    """Setpoints that step at random and are smoothed, as a vehicle's are."""
    held = round(every_s * rate_hz)
    count = round(end_s * rate_hz)
    wanted = np.repeat(np.random.default_rng(seed).normal(0, size, count // held + 1), held)[:count]
    out, now, share = np.empty(count), 0.0, 1 - np.exp(-1 / rate_hz / lag_s)
    for n, value in enumerate(wanted):
        now += share * (value - now)
        out[n] = now
    return out


def quaternions(roll_deg):
    half = np.radians(roll_deg) / 2
    return {"0": np.cos(half), "1": np.sin(half), "2": np.zeros(len(half)), "3": np.zeros(len(half))}


def log_of(wanted, measured, rate_hz, *, topics=(), times_s=None, landed_until_s=-1.0):
    """A log whose roll rate [deg/s] was `wanted` and `measured`; nothing moves on the other axes."""
    t_s = np.arange(len(wanted)) / rate_hz if times_s is None else times_s
    still = np.zeros(len(t_s))
    rates = [
        Topic("vehicle_rates_setpoint", "0", t_s,
              {"roll": np.radians(wanted), "pitch": still, "yaw": still}, {}),
        Topic("vehicle_angular_velocity", "0", t_s,
              {"xyz[0]": np.radians(measured), "xyz[1]": still, "xyz[2]": still}, {}),
        Topic("vehicle_land_detected", "0", t_s, {"landed": t_s < landed_until_s}, {}),
    ]  # fmt: skip
    states = VehicleStates("1", armed=[Span(0.0, float(t_s[-1]), "armed")])
    return Log("ulog", None, float(t_s[-1]), [*rates, *topics], [states])


def attitude_topics(wanted, measured, rate_hz):
    t_s = np.arange(len(wanted)) / rate_hz
    return [
        Topic(name, "0", t_s, {f"{field}[{k}]": v for k, v in quaternions(values).items()}, {})
        for name, field, values in (
            ("vehicle_attitude_setpoint", "q_d", wanted),
            ("vehicle_attitude", "q", measured),
        )
    ]


def one(found, loop="rate", axis="roll"):
    (response,) = [each for each in found.loops if (each.loop, each.axis) == (loop, axis)]
    return response


@pytest.mark.parametrize("noise", [0.0, 5.0])
@pytest.mark.parametrize(("rate_hz", "natural_hz", "damping"), [(50, 3, 0.7), (50, 5, 0.5), (250, 8, 0.4)])
def test_a_rate_loop_of_known_response_is_found(rate_hz, natural_hz, damping, noise):
    wanted = steps(rate_hz, 0.7, 60.0, 0.03)
    measured = second_order(wanted, rate_hz, natural_hz, damping)
    measured += np.random.default_rng(1).normal(0, noise, len(measured))
    found = one(loops(log_of(wanted, measured, rate_hz), None, None))
    rise_s, overshoot, bandwidth_hz = truth(natural_hz, damping)
    assert found.step.rise_s == pytest.approx(rise_s, rel=0.15)
    assert found.step.overshoot == pytest.approx(overshoot, abs=0.04)
    assert found.step.final == pytest.approx(1.0, abs=0.03)
    assert found.frequency.bandwidth_hz == pytest.approx(bandwidth_hz, rel=0.1)
    assert found.coherence > 0.95
    assert found.rate_hz == pytest.approx(rate_hz)
    low, high = found.step.rise_range_s
    assert low <= found.step.rise_s * 1.02
    assert high >= found.step.rise_s * 0.98
    assert len(found.step.value) == len(found.step.lowest) <= MAX_POINTS + 1
    assert found.excited_s == pytest.approx(found.flown_s, abs=4.0)
    assert found.setpoint == "degrees({vehicle_rates_setpoint:0/roll})"


def test_an_attitude_loop_of_known_response_is_found():
    wanted = steps(20, 3.0, 12.0, 0.15)
    measured = second_order(wanted, 20, 1.2, 0.5) + 4.0  # trim does not count
    still = np.zeros(50)
    log = log_of(still, still, 50, topics=attitude_topics(wanted, measured, 20))
    log.vehicles[0].armed = [Span(0.0, END_S, "armed")]
    log.topics = [each for each in log.topics if each.name != "vehicle_land_detected"]
    found = one(loops(log, None, None), "attitude")
    rise_s, overshoot, bandwidth_hz = truth(1.2, 0.5)
    assert found.step.rise_s == pytest.approx(rise_s, rel=0.15)
    assert found.step.overshoot == pytest.approx(overshoot, abs=0.05)
    assert found.frequency.bandwidth_hz == pytest.approx(bandwidth_hz, rel=0.1)
    assert found.frequency.phase_at_bandwidth_deg == pytest.approx(-116, abs=10)
    assert found.frequency.peak_db == pytest.approx(20 * np.log10(1 / (2 * 0.5 * np.sqrt(0.75))), abs=0.5)


def test_without_movement_of_the_setpoint_nothing_is_claimed():
    quiet = np.random.default_rng(2).normal(0, 1.0, 4000)
    found = one(loops(log_of(quiet, quiet, 50), None, None))
    assert (found.windows, found.excited_s) == (0, 0.0)
    assert found.step is found.frequency is found.coherence is None
    assert "hardly moves" in found.notes[0]
    assert "Fly quick turns on this axis." in found.notes[0]


def test_an_answer_that_noise_covers_has_no_numbers():
    wanted = steps(50, 0.7, 60.0, 0.03)
    found = one(loops(log_of(wanted, np.random.default_rng(3).normal(0, 60, len(wanted)), 50), None, None))
    assert found.coherence < 0.2
    assert found.step is None
    assert any("coherence" in note for note in found.notes)
    assert found.frequency is None or found.frequency.bandwidth_hz is None


def test_a_log_that_is_too_slow_for_the_loop_says_so():
    wanted = steps(10, 0.7, 60.0, 0.03)
    found = one(loops(log_of(wanted, second_order(wanted, 10, 4, 0.6), 10), None, None))
    assert any("samples a second are too few" in note for note in found.notes)


def test_setpoints_without_quick_movement_say_that_it_may_rise_faster():
    t_s = np.arange(0, END_S, 0.02)
    wanted = 40 * np.sin(2 * np.pi * 0.4 * t_s) + 20 * np.sin(2 * np.pi * 0.9 * t_s + 1)
    measured = second_order(wanted, 50, 6, 0.7) + np.random.default_rng(4).normal(0, 3, len(t_s))
    found = one(loops(log_of(wanted, measured, 50), None, None))
    assert found.frequency.bandwidth_hz is None
    assert any("does not say the bandwidth" in note for note in found.notes)
    assert any("may rise faster" in note for note in found.notes)


def test_only_the_time_in_the_air_in_the_window_counts_and_no_window_reaches_over_a_gap():
    wanted = steps(50, 0.7, 60.0, 0.03)
    measured = second_order(wanted, 50, 5, 0.5)
    measured[: 50 * 20] = 0.0  # on the ground it does not move
    t_s = np.arange(len(wanted)) / 50
    t_s[50 * 40 :] += 5.0
    log = log_of(wanted, measured, 50, times_s=t_s, landed_until_s=20.0)
    found = one(loops(log, None, None))
    assert found.flown_s == pytest.approx(60.0 - 2.0, abs=0.2)
    assert found.step.overshoot == pytest.approx(0.163, abs=0.04)
    part = one(loops(log, 21.0, 31.0))
    assert part.flown_s == pytest.approx(10.0, abs=0.1)
    assert part.windows == 4
    assert part.notes[-1] == "These values are uncertain: the setpoint moves enough in only 4 windows."
    assert one(loops(log, 1.0, 5.0)).notes == [
        "Less than 4 s of this part are flown in the air with this setpoint."
    ]


def test_what_is_not_logged_is_said():
    wanted = steps(50, 0.7, 60.0, 0.03)
    found = loops(log_of(wanted, wanted, 50), None, None)
    assert [(each.loop, each.axis) for each in found.loops] == [
        (loop, axis) for loop in ("rate", "attitude") for axis in ("roll", "pitch", "yaw")
    ]
    assert one(found, "attitude").notes == ["The topic vehicle_attitude_setpoint is not logged."]
    empty = loops(Log("ulog", None, 0.0, [], []), None, None)
    assert {each.notes[0] for each in empty.loops} == {
        "The topic vehicle_rates_setpoint is not logged.",
        "The topic vehicle_attitude_setpoint is not logged.",
    }
    telemetry = loops(Log("tlog", None, 0.0, [], [VehicleStates("1")]), None, None)
    assert "the vehicle's own log has" in one(telemetry).notes[0]


def test_damaged_values_and_times_are_left_out():
    wanted = steps(50, 0.7, 60.0, 0.03)
    measured = second_order(wanted, 50, 5, 0.5)
    measured[100:110] = np.nan
    measured[300] = 1e30
    t_s = np.arange(len(wanted)) / 50
    t_s[500] = t_s[499]
    found = one(loops(log_of(wanted, measured, 50, times_s=t_s), None, None))
    assert found.step.overshoot == pytest.approx(0.163, abs=0.04)


def answers(path, folder):
    log = read_ulog(path)
    columns.write(log, overview.encode(log), folder)
    found = json.loads(tasks.loops(str(folder), None, None))["loops"]
    return {(each["loop"], each["axis"]): each for each in found}


@pytest.mark.flight
def test_a_simulated_flight_says_of_some_axes_how_they_respond_and_of_others_why_not(tmp_path):
    path, _ = flown_log(tmp_path / "vehicle", (0.0, 3.0, 0.0))
    found = answers(path, tmp_path / "columns")
    assert found["rate", "roll"]["step"]["rise_s"] == pytest.approx(0.11, abs=0.05)
    assert found["attitude", "yaw"]["step"] is None
    assert "hardly moves" in found["attitude", "yaw"]["notes"][0]


@pytest.mark.skipif(not RECORDED.exists(), reason="without ../shared/px4/logs/flight-short.ulg.gz")
def test_a_recorded_px4_rises_as_its_default_gains_do(tmp_path):
    path = tmp_path / "flight.ulg"
    path.write_bytes(gzip.decompress(RECORDED.read_bytes()))
    found = answers(path, tmp_path / "columns")
    assert found["rate", "pitch"]["step"]["rise_s"] == pytest.approx(0.14, abs=0.04)
    assert found["rate", "pitch"]["frequency"]["bandwidth_hz"] == pytest.approx(3.6, abs=0.8)
    assert found["attitude", "roll"]["step"]["rise_s"] == pytest.approx(0.2, abs=0.06)
