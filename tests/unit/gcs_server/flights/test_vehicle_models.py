"""Kept models of vehicles last over a restart, for the same vehicle only; damaged files are said."""

import asyncio
import json
from dataclasses import replace

import pytest

from gcs_server.errors import Refused
from gcs_server.flights.vehicle_models import KeptModel, VehicleModels
from gcs_server.storage.records import Records
from gcs_server.vehicle.identity import Identity

ONE = Identity(1, 1, 12, 2, "0011223344556677", False, False, "1.16.0", None)
OTHER = replace(ONE, uid="7766554433221100")
MODEL = KeptModel(
    flight="a-0",
    log="a.ulg",
    kept_unix_s=1_700_000_000.5,
    kept_by="Anna",
    mass_kg=1.5,
    thrust_m_s2=20.0,
    thrust_error_m_s2=0.3,
    drag_per_s=None,
    drag_error_per_s=None,
    parameters={"SIH_MASS": 1.5, "MPC_THR_HOVER": 0.49},
    turns_known=True,
)


def store_in(folder):
    store = VehicleModels(Records(folder))
    asyncio.run(store.load())
    return store


def keep(store, identity, model):
    asyncio.run(store.keep(identity, model))


def test_a_model_is_there_after_a_restart_for_the_same_vehicle_only_until_it_is_forgotten(tmp_path):
    store = store_in(tmp_path)
    keep(store, ONE, MODEL)
    store.close()
    store = store_in(tmp_path)
    assert (store.find(ONE), store.find(OTHER), store.warnings()) == (MODEL, None, [])
    keep(store, ONE, None)
    store.close()
    assert store_in(tmp_path).find(ONE) is None
    assert list(tmp_path.iterdir()) == []


def test_a_model_that_was_kept_before_turning_was_recorded_is_used_and_says_so(tmp_path):
    store = store_in(tmp_path)
    keep(store, ONE, MODEL)
    store.close()
    (path,) = tmp_path.iterdir()
    content = json.loads(path.read_text())
    del content["turns_known"]
    path.write_text(json.dumps(content))
    found = store_in(tmp_path).find(ONE)
    assert found == replace(MODEL, turns_known=None)
    assert "whether the turning was known is not recorded" in found.text()


def test_it_says_in_words_what_is_known():
    assert MODEL.text() == (
        "thrust by mass 20.0 m/s² (±0.3), drag not known, so the simulated quadrotor’s, turning as in the "
        "flight, from “a.ulg”, kept on 2023-11-14"
    )
    assert "turning not known about all axes (there the simulated" in replace(MODEL, turns_known=False).text()
    assert "drag 0.40 1/s (±0.02)" in replace(MODEL, drag_per_s=0.4, drag_error_per_s=0.02).text()


@pytest.mark.parametrize("identity", [replace(ONE, firmware=None), replace(ONE, replayed=True)])
def test_a_vehicle_that_is_not_identified_keeps_nothing(tmp_path, identity):
    store = store_in(tmp_path)
    with pytest.raises(Refused, match="who it is"):
        keep(store, identity, MODEL)
    assert store.find(identity) is None


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("format", 2),
        ("thrust_m_s2", float("nan")),
        ("parameters", {"COM_ARM_WO_GPS": 1.0}),
        ("parameters", {"SIH_MASS": float("inf")}),
        ("mass_kg", "1"),
        ("log", "x" * 301),
    ],
)
def test_a_damaged_file_is_a_warning_and_is_replaced(tmp_path, field, value):
    store = store_in(tmp_path)
    keep(store, ONE, MODEL)
    store.close()
    (file,) = tmp_path.iterdir()
    file.write_text(json.dumps({**json.loads(file.read_text()), field: value}))
    store = store_in(tmp_path)
    assert store.find(ONE) is None
    (warning,) = store.warnings()
    assert file.name in warning
    assert "simulated quadrotor's body" in warning
    keep(store, ONE, MODEL)
    assert (store.find(ONE), store.warnings()) == (MODEL, [])


def test_a_model_that_cannot_be_written_is_not_kept(tmp_path):
    (tmp_path / "models").write_text("a file, not a folder")
    store = VehicleModels(Records(tmp_path / "models"))
    with pytest.raises(Refused, match="cannot be written"):
        keep(store, ONE, MODEL)
    assert store.find(ONE) is None
