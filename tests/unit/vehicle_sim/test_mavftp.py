"""The FTP client of pymavlink on a vehicle in the same process: ten rounds, and no session is left open."""

from __future__ import annotations

import io
import logging
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink import mavftp
from pymavlink.mavftp import MAVFTP, FtpError, MAVFTPSettings

from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.storage import metadata

STEP_S = 0.004
ROUNDS = 10
SETTINGS = MAVFTPSettings(
    [
        ("debug", int, 0), ("pkt_loss_tx", int, 0), ("pkt_loss_rx", int, 0), ("max_backlog", int, 5),
        ("burst_read_size", int, 80), ("write_size", int, 80), ("write_qsize", int, 5),
        ("idle_detection_time", float, 0.3), ("read_retry_time", float, 0.25), ("retry_time", float, 0.2),
    ]
)  # fmt: skip
"""The client's defaults with shorter timeouts [s]: the client waits for a timeout after creating a
directory."""


class Connection:
    """A MAVLink connection for the client; waiting for a message advances simulated time."""

    source_system, source_component = 255, 190

    def __init__(self) -> None:
        self.sim = SimulatedFleet()
        self.mav = self
        self.sent_count = 0
        self._parser, self._received = FrameParser(), list[Any]()

    def file_transfer_protocol_send(
        self, network: int, target_system: int, target_component: int, payload: bytearray
    ) -> None:
        layout, packed = pack(
            "FILE_TRANSFER_PROTOCOL", target_network=network, target_system=target_system,
            target_component=target_component, payload=bytes(payload),
        )  # fmt: skip
        self.sent_count += 1
        self.sim.feed(0, "gcs", frame_v2(layout, packed, self.sent_count & 0xFF, 255, 190))

    def recv_match(self, timeout: float = 0.0, **_: Any) -> Any:
        for _step in range(round(timeout / STEP_S)):
            if self._received:
                return self._received.pop(0)
            self.sim.step(STEP_S)
            self._received += [
                SimpleNamespace(
                    target_system=m.target_system, target_component=m.target_component,
                    payload=list(m.payload), get_type=lambda name=m.name: name,
                )
                for m in self._parser.feed(self.sim.drain(0, "gcs"))
                if m.name == "FILE_TRANSFER_PROTOCOL"
            ]  # fmt: skip
        return None


@pytest.mark.parametrize("target_system", [1, 0])
def test_ten_rounds_of_listing_writing_reading_and_removing_leave_no_session_open(
    target_system: int, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    connection = Connection()
    clock = SimpleNamespace(time=lambda: connection.sim.time_s, sleep=lambda seconds: None)
    monkeypatch.setattr(mavftp, "time", clock)
    client = MAVFTP(connection, target_system, 1, SETTINGS)
    for n in range(ROUNDS):
        content = bytes((n + k) % 251 for k in range(700))
        assert client.cmd_list(["/"]).error_code == FtpError.Success
        assert client.cmd_mkdir(["round"]).error_code == FtpError.Success
        client.cmd_put(["-", "round/data.bin"], fh=io.BytesIO(content))
        assert client.process_ftp_reply("put").error_code == FtpError.Success
        assert client.read("round/data.bin", len(content)) == content
        assert client.read(metadata.GENERAL, 64) is not None
        assert client.cmd_rm(["round/data.bin"]).error_code == FtpError.Success
        assert client.cmd_rmdir(["round"]).error_code == FtpError.Success
    assert [r.message for r in caplog.records if r.levelno >= logging.ERROR] == []
    assert connection.sim.time_s < 1.5 * ROUNDS, "a request was repeated after a timeout"
