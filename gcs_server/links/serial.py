"""A serial port or USB radio, which may be unplugged and plugged in again."""

from __future__ import annotations

import errno
import math
import os
import termios
from pathlib import Path

import serial

from gcs_server.links.base import Link, Peer
from gcs_server.links.channel import StreamSession
from gcs_server.links.pacing import LinePacer, bytes_in_output_queue
from gcs_server.links.writer import LinkWriter

DEFAULT_BAUD = 57600
UART_PIECE_BYTES, USB_PIECE_BYTES = 6, 64
"""About the number of bytes that the driver passes on at a time."""


class SerialLink(Link):
    """A link over one device, which is opened exclusively."""

    def __init__(self, name: str, url: str, device: str, baud: int, *, forward: bool = False) -> None:
        super().__init__(name, url, forward=forward)
        self._device = device
        self._baud = baud
        self._port: serial.Serial | None = None
        self._session: StreamSession | None = None
        self._peer = Peer(device)

    def _open(self) -> None:
        try:
            port = serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=True)
        except serial.SerialException as error:
            # pyserial keeps the system's error number, but not always the exception class
            raise OSError(error.errno or _errno_of(error), str(error)) from error
        except ValueError as error:
            raise OSError(errno.EINVAL, f"{self._baud} baud is not supported: {error}") from error
        self._port = port
        descriptor = port.fileno()
        os.set_blocking(descriptor, False)
        _block_when_empty(descriptor)
        baud = self._line_baud()
        self._session = StreamSession(
            self._loop,
            descriptor,
            read=lambda size: os.read(descriptor, size),
            write=lambda data: os.write(descriptor, data),
            pacer=LinePacer(baud, lambda: bytes_in_output_queue(descriptor)),
            counts=self._counts,
            on_received=lambda data: self._received(data, self._peer),
            on_end=lambda why: self._lost(f"{self._device} was disconnected ({why}) Plug it in again."),
            faults=self.faults,
            piece_bytes=USB_PIECE_BYTES if math.isinf(baud) else UART_PIECE_BYTES,
        )
        self._peers[self._peer.name] = self._peer
        self._opened()

    def _explain(self, error: OSError) -> str:
        if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
            ports = sorted(
                str(p) for kind in ("ttyACM*", "ttyUSB*", "ttyAMA*") for p in Path("/dev").glob(kind)
            )
            return (
                f"There is no serial port {self._device}. Plug the device in; "
                f"present now: {', '.join(ports) or 'none'}."
            )
        if error.errno in (errno.EACCES, errno.EPERM):
            return (
                f"No permission to open {self._device} for this user. Run: sudo usermod -aG dialout $USER, "
                "then log out and in again."
            )
        if error.errno in (errno.EBUSY, errno.EAGAIN):
            return f"{self._device} is in use by another program (a ground station, ModemManager?). Close it."
        if error.errno == errno.ENOTTY:
            return f"{self._device} is not a serial port."
        return f"{self._device}: {error.strerror or error}"

    def _line_baud(self) -> float:
        """Line speed; infinity for a flight controller's USB port (CDC ACM), which ignores the setting."""
        return math.inf if Path(self._device).resolve().name.startswith("ttyACM") else float(self._baud)

    def _writer(self, peer: Peer) -> LinkWriter | None:
        session = self._session
        return None if session is None else session.writer

    def _close(self) -> None:
        if self._session is not None:
            self._session.close()
            self._session = None
        port, self._port = self._port, None
        if port is not None:
            port.close()


def _block_when_empty(descriptor: int) -> None:
    """Makes reads of an empty port block (VMIN 1). With pyserial's setting they return b"", like the end of
    the stream."""
    try:
        attributes = termios.tcgetattr(descriptor)
        attributes[6][termios.VMIN] = 1
        termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
    except termios.error as error:  # the device was unplugged; termios.error is not an OSError
        raise OSError(*error.args[:2]) from error


def _errno_of(error: Exception) -> int:
    cause = error.__cause__ or error.__context__
    if isinstance(cause, OSError) and cause.errno:
        return cause.errno
    text = str(error).lower()
    return errno.EBUSY if "lock" in text else errno.ENOTTY if "configure" in text else errno.EIO
