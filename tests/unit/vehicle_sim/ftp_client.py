"""A MAVLink FTP client of the simulated vehicle, on a fake clock."""

from vehicle_sim.mavlink.dialect import pack
from vehicle_sim.mavlink.framing import FrameParser, frame_v2
from vehicle_sim.mavlink.services import ftp


class FtpClient:
    """Sends FTP requests on one link and returns the replies."""

    def __init__(self, sim, link="gcs"):
        self._sim, self._link = sim, link
        self._parser = FrameParser()
        self._sequence = 0

    def request(
        self,
        opcode,
        data=b"",
        *,
        size=None,
        offset=0,
        session=0,
        system=1,
        component=1,
        sequence=None,
        wait_s=0.2,
    ):
        """(header, data) of each reply."""
        self._sequence += 2
        request_header = ftp.HEADER.pack(
            self._sequence if sequence is None else sequence,
            session, opcode, len(data) if size is None else size, 0, 0, 0, offset,
        )  # fmt: skip
        layout, payload = pack(
            "FILE_TRANSFER_PROTOCOL",
            target_system=system,
            target_component=component,
            payload=request_header + data,
        )
        self._sim.feed(0, self._link, frame_v2(layout, payload, 0, 255, 190))
        replies = []
        for _ in range(round(wait_s / 0.004)):
            self._sim.step(0.004)
            for message in self._parser.feed(self._sim.drain(0, self._link)):
                if message.name == "FILE_TRANSFER_PROTOCOL":
                    payload_bytes = bytes(message.payload)
                    header = ftp.HEADER.unpack_from(payload_bytes)
                    replies.append((header, payload_bytes[12 : 12 + header[3]]))
        return replies

    def request_one(self, opcode, data=b"", **options):
        """(opcode, data) of the only reply."""
        ((header, reply),) = self.request(opcode, data, **options)
        assert header[4] == opcode
        return header[2], reply
