"""The recording of a killed server contains all records that were written before the server was killed."""

import signal
import subprocess
import sys
import time

from gcs_server.mavlink.codec import encode_frame
from gcs_server.replay.records import read_tlog

FIRST_UNIX_US = 1_700_000_000_000_000
FRAME = encode_frame(0, b"\x01" * 9, 0, 1, 1)


def recordings_in(folder):
    return sorted(folder.glob("*.tlog"))


def test_the_recording_of_a_killed_server_has_all_flushed_records(tmp_path):
    program = (
        "import sys,time;from pathlib import Path\n"
        "from gcs_server.mavlink.tlog_writer import TlogRecorder,stamp\n"
        "recorder=TlogRecorder(Path(sys.argv[1]),max_bytes=10**9,keep_free_bytes=0);recorder.start()\n"
        "channel=recorder.channel('a')\n"
        f"[channel.append(stamp({FIRST_UNIX_US}+n),bytes.fromhex('{FRAME.hex()}')) for n in range(500)]\n"
        "print('ready',flush=True);time.sleep(60)"
    )
    process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE)
    try:
        assert process.stdout.readline() == b"ready\n"
        deadline_s = time.monotonic() + 30
        while [len(list(read_tlog(path))) for path in recordings_in(tmp_path)] != [500]:
            assert time.monotonic() < deadline_s, "the records were not flushed"
            time.sleep(0.05)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
    (path,) = recordings_in(tmp_path)
    assert len(list(read_tlog(path))) == 500
