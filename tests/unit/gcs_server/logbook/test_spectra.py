"""Spectra of a log's values: amplitude and variance are right, also with gaps and uneven samples."""

from types import SimpleNamespace

import numpy as np
import pytest

from gcs_server.logbook import spectra
from gcs_server.logbook.columns import UnknownField

FIELD = "sensor_accel:0/x"


def spectrum_of(times_s, values, from_s=None, to_s=None):
    columns = SimpleNamespace(
        times=lambda _topic: np.asarray(times_s, np.float64),
        column=lambda _topic, _name: (np.asarray(values), "m/s²"),
    )
    return spectra.spectrum(columns, FIELD, from_s, to_s)


def peak_hz(found):
    return found["frequencies_hz"][int(np.argmax(found["density"]))]


def variance(found):
    return sum(found["density"]) / found["segment_s"]


def test_a_tone_is_at_its_frequency_with_its_power():
    times_s = np.arange(0, 40, 0.004)
    found = spectrum_of(times_s, 5 + 3 * np.sin(2 * np.pi * 31.25 * times_s))
    assert peak_hz(found) == pytest.approx(31.25, abs=1 / found["segment_s"])
    assert variance(found) == pytest.approx(4.5, rel=0.01)
    assert found["rate_hz"] == pytest.approx(250)
    assert (found["unit"], found["gaps"], found["irregular"]) == ("(m/s²)²/Hz", 0, 0)
    assert len(found["decibels"]) == len(found["t_s"]) <= spectra.MAX_COLUMNS
    assert all(len(column) == len(found["frequencies_hz"]) for column in found["decibels"])


def test_noise_is_flat_and_has_its_variance():
    values = np.random.default_rng(1).normal(0, 2, 100_000)
    found = spectrum_of(np.arange(100_000) / 1000, values)
    assert variance(found) == pytest.approx(4, rel=0.02)
    assert np.mean(found["density"][5:-5]) == pytest.approx(4 / 500, rel=0.05)


def test_the_spectrogram_shows_when():
    times_s = np.arange(0, 60, 0.005)
    found = spectrum_of(times_s, np.where(times_s < 30, np.sin(80 * np.pi * times_s), 0))
    row = int(np.argmin(np.abs(np.array(found["frequencies_hz"]) - 40)))
    level = {t_s: column[row] for t_s, column in zip(found["t_s"], found["decibels"], strict=True)}
    assert min(value for t_s, value in level.items() if t_s < 25) > -20
    assert max(value for t_s, value in level.items() if t_s > 35) < -100


def test_gaps_and_uneven_steps_make_no_frequencies_and_are_said():
    generator = np.random.default_rng(2)
    times_s = np.cumsum(0.004 + generator.uniform(-0.0015, 0.0015, 20_000))
    times_s[10_000:] += 3.0
    found = spectrum_of(times_s, np.sin(2 * np.pi * 20 * times_s))
    assert found["gaps"] == 1
    assert 0.2 < found["irregular"] < 0.8
    assert peak_hz(found) == pytest.approx(20, abs=1 / found["segment_s"])
    assert variance(found) == pytest.approx(0.5, rel=0.05)
    outside = [d for f, d in zip(found["frequencies_hz"], found["density"], strict=True) if abs(f - 20) > 3]
    assert max(outside) < 0.01 * max(found["density"])
    begin_s, end_s = times_s[9_999], times_s[10_000]
    half_s = found["segment_s"] / 2
    assert not [t for t in found["t_s"] if begin_s - half_s / 2 < t < end_s + half_s / 2]


def test_what_is_missing_or_repeated_is_left_out():
    times_s = np.repeat(np.arange(0, 10, 0.01), 2)
    values = np.sin(2 * np.pi * 5 * times_s)
    values[50:60] = np.nan
    found = spectrum_of(times_s, values)
    assert found["rate_hz"] == pytest.approx(100)
    assert peak_hz(found) == pytest.approx(5, abs=1 / found["segment_s"])


def test_too_few_values_are_refused_in_words():
    with pytest.raises(UnknownField, match="31 values in this time, and a spectrum needs 32"):
        spectrum_of(np.arange(31), np.arange(31))
    with pytest.raises(UnknownField, match="0 values"):
        spectrum_of([], [])
    with pytest.raises(UnknownField, match="so many gaps"):
        spectrum_of(np.arange(100) + 10 * (np.arange(100) // 10), np.ones(100))


def test_a_long_log_is_bounded():
    found = spectrum_of(np.arange(1_000_000) / 1000, np.ones(1_000_000))
    assert len(found["frequencies_hz"]) == spectra.MAX_SEGMENT // 2 + 1
    assert len(found["t_s"]) <= spectra.MAX_COLUMNS
    assert max(found["density"]) == 0
