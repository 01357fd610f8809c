"""The files on the simulated vehicle, with packet loss: lists with what hangs on a file, writes beside the
old file, removes, makes folders, and downloads that continue. Nothing changes while the vehicle is armed."""

import asyncio
import base64
import os
from types import SimpleNamespace

import pytest

from gcs_server.api import file_routes as routes
from gcs_server.errors import Disconnected, GcsError, InvalidRequest, NotInControl, Refused
from gcs_server.logbook import transfers
from gcs_server.logbook.file_downloads import FileDownloads
from gcs_server.vehicle.services import files as service
from gcs_server.vehicle.services.files import VehicleFiles
from gcs_server.vehicle.services.ftp_codec import FtpFailed
from tests.protocol.api_calls import ANNA, BOB, json_of, new_station
from tests.protocol.offboard_testbed import OffboardTestbed
from tests.protocol.simulated_autopilot import SimulatedAutopilot

CONTENT = bytes(range(256)) * 40
REMOVE_FILE = 8


def run_with_files(run_simulated, scenario, *, loss=0.0, seed=0):
    async def run():
        testbed = OffboardTestbed()
        autopilot = SimulatedAutopilot(testbed.link())
        try:
            vehicle = await testbed.wait_for_vehicle()
            autopilot.loss = loss
            autopilot.random.seed(seed)
            disk = autopilot.sim.files[0].root
            await scenario(vehicle.service(VehicleFiles), disk, autopilot, vehicle, testbed)
        finally:
            autopilot.alive = False
            await testbed.close()

    run_simulated(run)


def arm(vehicle, monkeypatch):
    monkeypatch.setattr(type(vehicle), "flight_state", SimpleNamespace(armed=True))


@pytest.mark.parametrize(("loss", "seed"), [(0.0, 1), (0.2, 2)])
def test_files_are_written_replaced_listed_and_removed_at_any_packet_loss(run_simulated, loss, seed):
    async def scenario(files, disk, autopilot, vehicle, _):
        await files.make_folder("/etc2")
        progress = []
        await files.put("/etc2/extras.txt", CONTENT, lambda *p: progress.append(p))
        assert (disk / "etc2/extras.txt").read_bytes() == CONTENT
        assert progress[-1] == (len(CONTENT), len(CONTENT))
        await files.put("/etc2/extras.txt", b"new", lambda *_: None)
        await files.put("/etc2/empty", b"", lambda *_: None)
        assert {path.name: path.read_bytes() for path in (disk / "etc2").iterdir()} == {
            "extras.txt": b"new",
            "empty": b"",
        }
        folder = await files.list("/etc2/")
        assert [(e.name, e.path, e.size_bytes) for e in folder.entries] == [
            ("empty", "/etc2/empty", 0),
            ("extras.txt", "/etc2/extras.txt", 3),
        ]
        with pytest.raises(FtpFailed, match="Directory not empty"):
            await files.remove("/etc2")
        for path in ("/etc2/empty", "/etc2/extras.txt", "/etc2"):
            await files.remove(path)
        assert not (disk / "etc2").exists()

    run_with_files(run_simulated, scenario, loss=loss, seed=seed)


def test_what_ends_early_leaves_the_old_file(run_simulated, monkeypatch):
    async def scenario(files, disk, autopilot, vehicle, _):
        (disk / "a.txt").write_bytes(b"old")

        def ends(*_):
            raise Refused("Stopped.")

        with pytest.raises(Refused, match="Stopped"):
            await files.put("/a.txt", CONTENT, ends)
        monkeypatch.setattr(service, "mavlink_crc32", lambda _: 1)
        with pytest.raises(FtpFailed, match="differs from what was sent"):
            await files.put("/a.txt", CONTENT, lambda *_: None)
        monkeypatch.undo()
        writing = asyncio.ensure_future(files.put("/a.txt", CONTENT, lambda *_: None))
        await asyncio.sleep(0.2)
        writing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await writing
        assert [path.name for path in disk.iterdir() if path.name.startswith("a.txt")] == ["a.txt"]
        autopilot.loss = 1.0
        with pytest.raises(Disconnected):
            await files.put("/a.txt", CONTENT, lambda *_: None)
        assert (disk / "a.txt").read_bytes() == b"old"

    run_with_files(run_simulated, scenario)


def test_a_file_system_that_does_not_replace_files_gets_the_checked_one_after_the_old_is_removed(
    run_simulated, monkeypatch
):
    async def scenario(files, disk, autopilot, vehicle, _):
        vehicle_files = autopilot.sim.files[0]
        rename = vehicle_files.rename

        def rename_like_fat(old, new):
            if (disk / new.strip("/")).exists():
                raise FileExistsError(17, "exists")
            rename(old, new)

        monkeypatch.setattr(vehicle_files, "rename", rename_like_fat)
        (disk / "a.txt").write_bytes(b"old")
        await files.put("/a.txt", CONTENT, lambda *_: None)
        assert (disk / "a.txt").read_bytes() == CONTENT

        def never(*_):
            raise OSError(28, "full")

        monkeypatch.setattr(vehicle_files, "rename", never)
        with pytest.raises(FtpFailed, match=r"is on the vehicle as /a.txt.part"):
            await files.put("/a.txt", b"newest", lambda *_: None)
        assert (disk / "a.txt.part").read_bytes() == b"newest"

    run_with_files(run_simulated, scenario)


def test_nothing_is_read_or_changed_while_armed_and_a_write_ends_when_armed(
    run_simulated, monkeypatch, tmp_path
):
    async def scenario(files, disk, autopilot, vehicle, _):
        (disk / "a.txt").write_bytes(CONTENT)
        downloads = FileDownloads(
            vehicle.clock, tmp_path, transfers.Transfers(vehicle.clock, lambda _: vehicle), lambda _: vehicle
        )
        with monkeypatch.context() as armed:

            def arms(*_):
                arm(vehicle, armed)

            with pytest.raises(Refused, match="is armed"):
                await files.put("/a.txt", CONTENT + CONTENT, arms)
            for refused in (
                lambda: files.put("/a.txt", b"x", lambda *_: None),
                lambda: files.remove("/a.txt"),
                lambda: files.make_folder("/b"),
            ):
                with pytest.raises(Refused, match="is armed"):
                    await refused()
            texts = set()
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(10.0):
                    await downloads.run("1", "/a.txt", lambda text, _: texts.add(text))
            assert "Paused while vehicle 1 is armed" in "".join(texts)
            assert "a.txt" in [entry.name for entry in (await files.list("/")).entries]
        assert (disk / "a.txt").read_bytes() == CONTENT
        assert not (disk / "b").exists()

    run_with_files(run_simulated, scenario)


def test_a_download_continues_where_it_was_cut_off_and_is_compared(run_simulated, monkeypatch, tmp_path):
    monkeypatch.setattr(transfers, "SAVE_PERIOD_S", 0.0)
    content = os.urandom(120_000)

    async def scenario(files, disk, autopilot, vehicle, _):
        (disk / "log/a b.ulg").write_bytes(content)
        received = []

        def new_server():
            shared = transfers.Transfers(vehicle.clock, lambda _: vehicle)
            return FileDownloads(vehicle.clock, tmp_path, shared, lambda _: vehicle)

        def half(text, progress):
            received.append(progress)
            if (progress or 0) > 0.5:
                raise InvalidRequest("path", "Stopped.")

        with pytest.raises(InvalidRequest, match="Stopped"):
            await new_server().run("1", "/log/a b.ulg", half)
        texts = []
        server = new_server()
        result = await server.run("1", "/log/a b.ulg", lambda text, _: texts.append(text))
        assert (result["size_bytes"], result["verified"], result["name"]) == (
            len(content),
            "crc32",
            "a-b.ulg",
        )
        path, name = server.path_of("1", result["file"])
        assert (path.read_bytes(), name) == (content, "a-b.ulg")
        assert texts[0].startswith("0.1 of 0.1 MB received")
        assert server.path_of("2", result["file"]) is None
        assert server.path_of("1", "../../etc/passwd") is None
        for path, why in (("/log", "is a folder"), ("/log/none", "no file"), ("/dev/ttyS0", "no file but a")):
            with pytest.raises(GcsError, match=why):
                await server.run("1", path, lambda *_: None)
        monkeypatch.setattr("gcs_server.logbook.file_downloads.MAX_KEPT", 1)
        (disk / "other").write_bytes(b"x")
        await server.run("1", "/other", lambda *_: None)
        assert server.path_of("1", result["file"]) is None

    run_with_files(run_simulated, scenario, loss=0.2, seed=5)


@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("/a/../etc/x", "has . or .. in it"),
        ("/a/./b", "has . or .. in it"),
        ("/a\nb", "a character"),
        ("/a\0b", "a character"),
        ("\\a", "a character"),
        ("/" + "a" * 120, "longer than 110 bytes"),
        ("/", "names no file"),
    ],
)
def test_paths_that_could_hide_what_they_name_are_refused(run_simulated, path, why):
    async def scenario(files, disk, autopilot, vehicle, _):
        before = autopilot.count(110)
        for change in (files.remove, files.make_folder, lambda p: files.put(p, b"", lambda *_: None)):
            with pytest.raises(InvalidRequest, match=why) as caught:
                await change(path)
            assert caught.value.field == "path"
        with pytest.raises(Refused, match="no file but a device"):
            await files.remove("/DEV/ttyS3")
        assert autopilot.count(110) == before

    run_with_files(run_simulated, scenario)


def test_routes_need_control_and_the_confirmation_that_names_file_and_vehicle(run_simulated, tmp_path):
    async def scenario(files, disk, autopilot, vehicle, testbed):
        station = new_station(testbed)
        (disk / "a.txt").write_bytes(b"old")

        def written(confirm="/a.txt is written on vehicle 1", content=b"new"):
            text = base64.b64encode(content).decode()
            return routes.WrittenFile(path="/a.txt", content_base64=text, confirm=confirm)

        with pytest.raises(InvalidRequest, match="not the required text"):
            await routes.put_file("1", written("yes"), station, ANNA)
        with pytest.raises(InvalidRequest, match="not base64"):
            await routes.put_file(
                "1", routes.WrittenFile(path="/a", content_base64="%", confirm=""), station, ANNA
            )
        operation = json_of(await routes.put_file("1", written(), station, ANNA))
        with pytest.raises(Refused, match="Another file is being written"):
            await routes.put_file("1", written(content=b"other"), station, ANNA)
        done = await station.operations.wait(operation["id"])
        assert (done.state, done.result) == ("succeeded", {"path": "/a.txt", "size_bytes": 3})
        assert (disk / "a.txt").read_bytes() == b"new"
        with pytest.raises(NotInControl):
            await routes.put_file("1", written(), station, BOB)
        removed = routes.RemovedFile(path="/a.txt", confirm="/a.txt is removed from vehicle 2")
        with pytest.raises(InvalidRequest, match="not the required text"):
            await routes.remove_file("1", removed, station, ANNA)
        removed = routes.RemovedFile(path="/a.txt", confirm="/a.txt is removed from vehicle 1")
        await routes.remove_file("1", removed, station, ANNA)
        assert not (disk / "a.txt").exists()
        await routes.make_folder("1", routes.NewFolder(path="/b"), station, ANNA)
        folder = json_of(await routes.list_folder(vehicle, routes.FilePath()))
        dangers = {entry["path"]: entry["danger"] for entry in folder["entries"]}
        assert dangers["/b"] is None
        assert dangers["/parameters.bson"] == "parameters"
        assert dangers["/dataman"] == "missions"
        assert dangers["/log"] == "log"
        entry = station.journal.tail(10)
        assert not any("bmV3" in str(line.arguments) for line in entry), "content is in the journal"

    run_with_files(run_simulated, scenario)
