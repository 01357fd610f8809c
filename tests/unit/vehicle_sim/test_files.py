"""The vehicle's folder stores files and refuses paths outside it; files of the build are read-only."""

import json
import lzma

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_sim.autopilot.announcer import EVENTS
from vehicle_sim.parameters import load_boot_parameters
from vehicle_sim.px4_version import DEFAULT, V1_16, V1_17, VERSIONS
from vehicle_sim.storage import metadata
from vehicle_sim.storage.files import PathOutsideError, VehicleFiles


@pytest.fixture
def files(tmp_path):
    return VehicleFiles(tmp_path / "vehicle", {"etc/extras/a.txt": lambda: b"built in"})


def test_files_are_written_read_truncated_renamed_and_removed(files):
    files.create("a.bin")
    files.write("/a.bin", 0, b"0123456789")
    files.write("./a.bin", 4, b"xy")
    assert files.read("a.bin", 2, 5) == b"23xy6"
    assert files.size("a.bin") == 10
    files.truncate("a.bin", 3)
    assert ("a.bin", 3) in files.listing("/")
    files.rename("a.bin", "b.bin")
    files.remove("b.bin")
    with pytest.raises(FileNotFoundError):
        files.size("b.bin")


@pytest.mark.parametrize("path", ["../x", "a/../../x", "/../etc/passwd", "a\0b"])
def test_paths_outside_the_folder_are_refused(files, path):
    for operation in (files.create, files.size, files.listing, lambda p: files.read(p, 0, 1)):
        with pytest.raises(PathOutsideError):
            operation(path)


def test_a_symbolic_link_to_the_outside_is_not_followed(files, tmp_path):
    (tmp_path / "secret").write_text("x")
    (files.root / "way_out").symlink_to(tmp_path / "secret")
    with pytest.raises(PathOutsideError):
        files.read("way_out", 0, 1)


@settings(max_examples=200, deadline=None)
@given(path=st.text(max_size=40))
def test_any_path_is_accepted_or_refused(path):
    files = VehicleFiles(None, {"etc/extras/a.txt": lambda: b"built in"})
    for operation in (files.size, files.listing, files.is_directory):
        try:
            operation(path)
        except OSError:
            continue


def test_the_files_of_the_build_are_read_only(files):
    assert files.read("etc/extras/a.txt", 6, 99) == b"in"
    assert files.listing("etc") == [("extras", None)]
    for operation in (
        lambda: files.create("etc/extras/a.txt"),
        lambda: files.remove("etc/extras/a.txt"),
        lambda: files.remove_directory("etc"),
        lambda: files.rename("etc", "x"),
    ):
        with pytest.raises(PermissionError):
            operation()


def test_a_symbolic_link_in_the_folder_is_listed_as_a_link(tmp_path):
    (tmp_path / "link").symlink_to("log")
    files = VehicleFiles(tmp_path)
    assert [name for name, _ in files.listing("/")] == ["eeprom", "link", "log", "test_data"]
    assert [files.is_link("/", name) for name in ("link", "log")] == [True, False]


def test_a_given_folder_is_kept_and_a_temporary_folder_is_removed(tmp_path):
    VehicleFiles(tmp_path / "kept").create("a")
    assert ("a", 0) in VehicleFiles(tmp_path / "kept").listing("/")
    temporary = VehicleFiles()
    temporary.create("a")
    root = temporary.root
    del temporary
    assert not root.exists()


def read_metadata(path, px4=DEFAULT):
    return json.loads(lzma.decompress(metadata.built_in(px4)[path]()))


def test_general_metadata_names_the_other_files_with_their_checksums():
    general = read_metadata(metadata.GENERAL)
    assert {entry["type"] for entry in general["metadataTypes"]} == {1, 4, 5}
    for entry in general["metadataTypes"]:
        path = entry["uri"].removeprefix("mftp://")
        assert entry["fileCrc"] == metadata.crc32(metadata.built_in()[path]())


def test_the_checksum_equals_the_checksum_that_px4_sends(reference_data):
    parameters_file = (reference_data / "px4" / "parameters.json.xz").read_bytes()
    general_file = (reference_data / "px4" / "component_general.json.xz").read_bytes()
    general = json.loads(lzma.decompress(general_file))
    assert metadata.general_crc(general_file) == 3923591749, "COMPONENT_METADATA as recorded"
    assert metadata.crc32(parameters_file) == general["metadataTypes"][0]["fileCrc"]


def test_every_live_parameter_has_metadata_and_a_default_within_its_range():
    entries_by_name = {entry["name"]: entry for entry in read_metadata(metadata.PARAMETERS)["parameters"]}
    assert list(entries_by_name) == [default.name for default in load_boot_parameters()]
    for entry in entries_by_name.values():
        assert entry["type"] in ("Int32", "Float")
        assert entry.get("min", -1e30) <= entry["default"] <= entry.get("max", 1e30), entry["name"]


@pytest.mark.parametrize(("px4", "folder"), [(V1_16, "px4"), (V1_17, "px4/v1.17")], ids=VERSIONS)
def test_the_parameter_metadata_match_the_metadata_of_the_build(px4, folder, reference_data):
    path = reference_data / folder / "parameters.json.xz"
    px4_entries = json.loads(lzma.decompress(path.read_bytes()))["parameters"]
    px4_entries = {entry["name"]: entry for entry in px4_entries}
    for entry in read_metadata(metadata.PARAMETERS, px4)["parameters"]:
        for key in ("group", "type", "default", "min", "max", "units", "decimalPlaces", "rebootRequired"):
            assert entry.get(key) == px4_entries[entry["name"]].get(key), (entry["name"], key)
        assert [v["value"] for v in entry.get("values", [])] == [
            v["value"] for v in px4_entries[entry["name"]].get("values", [])
        ]


def test_a_hundred_parameters_are_described_in_the_simulators_own_words(reference_data):
    entries = read_metadata(metadata.PARAMETERS)["parameters"]
    titles = {entry["name"]: entry["shortDesc"] for entry in entries if "shortDesc" in entry}
    assert len(titles) >= 100
    path = reference_data / "px4" / "v1.17" / "parameters.json.xz"
    for entry in json.loads(lzma.decompress(path.read_bytes()))["parameters"]:
        words = {entry.get("shortDesc"), *entry.get("longDesc", "").split("\n")}
        assert titles.get(entry["name"]) not in words


def test_every_event_that_the_vehicle_sends_is_defined_with_its_name():
    component = read_metadata(metadata.EVENTS)["components"]["1"]
    names = {
        int(event_id): event["name"]
        for group in component["event_groups"].values()
        for event_id, event in group["events"].items()
    }
    for name, (event_id, _levels) in EVENTS.items():
        assert names[event_id & 0xFFFFFF] == name
