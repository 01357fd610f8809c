"""The parameter store: PX4's types, order and hash, and a file that survives a restart."""

import json
import math
import struct

import pytest

from vehicle_sim.parameters import Parameters, UnknownParameterError, is_volatile
from vehicle_sim.px4_version import V1_16, V1_17


def test_the_store_has_px4s_parameters_in_its_order():
    parameters = Parameters()
    assert len(parameters) == 913
    assert parameters.name_at(0) == "ASPD_SCALE_1"
    assert parameters.name_at(912) == "WV_YRATE_MAX"
    assert parameters.name_at(913) is None
    assert list(parameters.names) == sorted(parameters.names)
    assert parameters.index_of("WV_YRATE_MAX") == 912


def test_the_values_at_boot_equal_the_recorded_values():
    parameters = Parameters()
    assert parameters.get("MNT_MODE_IN") == 4
    assert parameters.get("MNT_MODE_OUT") == 0
    assert parameters.get("MAV_SYS_ID") == 1
    assert parameters.type_of("MAV_SYS_ID") == "INT32"
    assert parameters.get("MPC_XY_P") == pytest.approx(0.95, abs=1e-6)


@pytest.mark.parametrize(
    ("px4", "folder", "of_the_recorded_instance"),
    [(V1_16, "px4", "MAV_SYS_ID"), (V1_17, "px4/v1.17", "CAL_BARO0_OFF")],
    ids=lambda value: getattr(value, "name", None),
)
def test_the_defaults_are_the_values_of_the_real_vehicle(
    px4, folder, of_the_recorded_instance, reference_data
):
    path = reference_data / folder / "parameters-live.json"
    recorded = json.loads(path.read_text(encoding="utf-8"))
    parameters = Parameters(px4=px4)
    assert list(parameters) == list(recorded)
    for name, entry in recorded.items():
        assert parameters.index_of(name) == entry["index"]
        assert parameters.type_of(name) == entry["type"].upper()
        if name != of_the_recorded_instance:
            assert parameters.get(name) == pytest.approx(entry["value"], rel=1e-6), name


def test_floats_are_single_precision_and_integers_wrap():
    parameters = Parameters()
    assert parameters.set("MPC_XY_P", 0.1) == struct.unpack("<f", struct.pack("<f", 0.1))[0]
    assert parameters.set("MAV_SYS_ID", 2**31) == -(2**31)
    assert parameters.set("MAV_SYS_ID", 7.0) == 7
    assert isinstance(parameters.get("MAV_SYS_ID"), int)


@pytest.mark.parametrize("value", [500.0, math.inf, -math.inf])
def test_values_out_of_range_are_stored(value):
    parameters = Parameters()
    parameters.set("MPC_XY_VEL_MAX", value)
    assert parameters.get("MPC_XY_VEL_MAX") == value


def test_an_integer_parameter_cannot_be_nan():
    with pytest.raises(ValueError, match="MAV_SYS_ID is an integer"):
        Parameters().set("MAV_SYS_ID", math.nan)


def test_the_error_about_an_unknown_parameter_names_the_parameter():
    with pytest.raises(UnknownParameterError, match="'NO_SUCH'"):
        Parameters().get("NO_SUCH")
    with pytest.raises(UnknownParameterError):
        Parameters().set("NO_SUCH", 1)


def test_listeners_are_called_for_changes_only():
    parameters = Parameters()
    changes = []
    remove_listener = parameters.add_listener(lambda name, value: changes.append((name, value)))
    parameters.set("MPC_XY_CRUISE", 5.0)
    parameters.set("MPC_XY_CRUISE", 6.0)
    parameters.set("MPC_XY_CRUISE", math.nan)
    parameters.set("MPC_XY_CRUISE", math.nan)
    remove_listener()
    parameters.set("MPC_XY_CRUISE", 7.0)
    assert changes[0] == ("MPC_XY_CRUISE", 6.0)
    assert len(changes) == 2


def test_changed_parameters_are_listed_until_they_are_reset():
    parameters = Parameters({"MPC_XY_CRUISE": 6.0, "MAV_SYS_ID": 3})
    assert parameters.changed_names() == ("MAV_SYS_ID", "MPC_XY_CRUISE")
    parameters.reset("MAV_SYS_ID")
    assert parameters.get("MAV_SYS_ID") == 1
    parameters.reset("MPC_XY_CRUISE")
    assert parameters.changed_names() == ()


def test_reset_all_resets_values_stored_at_boot_except_the_values_to_keep():
    parameters = Parameters({"MPC_XY_CRUISE": 6.0, "LND_FLIGHT_T_LO": 77})
    parameters.reset_all(keep=("LND_*",))
    assert parameters.get("MPC_XY_CRUISE") == parameters.default_of("MPC_XY_CRUISE")
    assert parameters.get("LND_FLIGHT_T_LO") == 77
    assert parameters.get("CAL_ACC0_ID") == 0
    assert parameters.get("CAL_MAG0_PRIO") == -1
    assert parameters.get("SYS_AUTOSTART") == 0
    parameters = Parameters({"MPC_XY_CRUISE": 6.0})
    parameters.reset_all(only=("CAL_ACC*",))
    assert parameters.get("CAL_ACC0_ID") == 0
    assert parameters.get("CAL_GYRO0_ID") != 0
    assert parameters.get("MPC_XY_CRUISE") == 6.0


def test_a_start_after_a_reset_stores_the_sensor_parameters_again(tmp_path):
    store = tmp_path / "parameters.json"
    parameters = Parameters(storage=store)
    parameters.reset_all()
    parameters.set("MPC_XY_CRUISE", 6.0)
    parameters.set("COM_ARM_AUTH_ID", 0)
    reopened = Parameters(storage=store)
    assert reopened.get("COM_ARM_AUTH_ID") == 0
    assert reopened.get("SYS_AUTOSTART") == Parameters().get("SYS_AUTOSTART")
    assert reopened.get("CAL_ACC0_ID") == Parameters().get("CAL_ACC0_ID")
    assert reopened.get("MPC_XY_CRUISE") == 6.0


def test_the_hash_is_a_crc_over_names_and_values():
    parameters = Parameters()
    hash_before = parameters.hash()
    crc = 0
    for name, value in parameters.items():
        if not is_volatile(name):
            struct_format = "<i" if parameters.type_of(name) == "INT32" else "<f"
            for byte in name.encode() + struct.pack(struct_format, value):
                crc ^= byte
                for _ in range(8):
                    crc = (crc >> 1) ^ (0xEDB88320 if crc & 1 else 0)
    assert hash_before == crc
    parameters.set("LND_FLIGHT_T_LO", 12345)
    assert parameters.hash() == hash_before, "the flight time changed the hash"
    parameters.set("MPC_XY_CRUISE", 6.0)
    assert parameters.hash() != hash_before
    parameters.reset("MPC_XY_CRUISE")
    assert parameters.hash() == hash_before


def test_changes_survive_a_restart(tmp_path):
    storage = tmp_path / "vehicle" / "parameters.json"
    parameters = Parameters(storage=storage)
    parameters.set("MPC_XY_CRUISE", 6.0)
    parameters.set("MPC_XY_VEL_MAX", math.inf)
    reopened = Parameters(storage=storage)
    assert reopened.get("MPC_XY_CRUISE") == 6.0
    assert reopened.get("MPC_XY_VEL_MAX") == math.inf
    assert reopened.changed_names() == ("MPC_XY_CRUISE", "MPC_XY_VEL_MAX")
    reopened.reset_all(only=("MPC_*",))
    assert Parameters(storage=storage).changed_names() == ()
    assert [path.name for path in storage.parent.iterdir()] == ["parameters.json"]


@pytest.mark.parametrize("content", ["{broken", "[1, 2]"])
def test_the_error_about_an_invalid_file_names_the_file(tmp_path, content):
    storage = tmp_path / "parameters.json"
    storage.write_text(content)
    with pytest.raises(ValueError, match=r"parameters\.json"):
        Parameters(storage=storage)
