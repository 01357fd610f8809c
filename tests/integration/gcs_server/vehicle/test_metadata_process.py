"""The process that reads a vehicle's metadata files: its results, errors and limits."""

import asyncio
import json
import lzma
import subprocess
import sys

import pytest

from gcs_server.vehicle import metadata_files, metadata_process, param_document
from gcs_server.vehicle.metadata_files import PARAMETERS

VALID_PARAMETER = {"name": "GOOD", "type": "Float", "max": 3.0}


def parameter_document(*entries):
    return json.dumps({"version": 1, "parameters": [*entries, VALID_PARAMETER]}).encode()


def read_in_process(kind, packed, crc=0):
    return asyncio.run(metadata_process.DocumentReader().read(kind, packed, crc))


@pytest.mark.parametrize(
    ("content", "reasons"),
    [
        (b'{"version":1,"parameters":[' + b"{}," * 3_000_000 + b"{}]}", "more than 8,000,000 bytes"),
        (b'{"version":1,"x":' + b"[" * 3_000_000 + b"]" * 3_000_000 + b"}", "recursion|memory"),
        (bytes(100_000_000), "more than 8,000,000 bytes"),
    ],
)
def test_a_compressed_file_that_is_too_large_is_refused(content, reasons):
    packed = lzma.compress(content, preset=1)
    with pytest.raises(ValueError) as caught:  # noqa: PT011 the text is compared below
        read_in_process(PARAMETERS, packed)
    assert any(text in str(caught.value) for text in reasons.split("|"))


def test_a_file_is_read_completely_in_another_process(monkeypatch):
    content = parameter_document(
        {"name": "A", "type": "Int32", "values": [{"value": 1, "description": "one"}]}
    )
    expected = dict(param_document.parse(content))
    monkeypatch.setattr(metadata_files, "encode_document", None)  # must not be called in this process
    monkeypatch.setattr(param_document, "parse", None)
    document = read_in_process(PARAMETERS, content)
    assert dict(document) == expected
    assert document.omission_text is None


@pytest.mark.parametrize("work", ["bytes(10**9)", "[0 for _ in iter(int, 1)]"])
def test_the_process_ends_at_its_limits_of_memory_and_cpu_time(work):
    code = (
        "from gcs_server.vehicle import metadata_files, metadata_process as process\n"
        f"metadata_files.encode_document = lambda *_: {work}\n"
        "process.COMPUTING_S = 1\n"
        "process.main(['1', '0'])\n"
    )
    result = subprocess.run([sys.executable, "-c", code], input=b"", capture_output=True, timeout=60)
    assert result.returncode != 0
    assert not result.stdout


def test_a_process_that_ends_without_a_result_raises_an_error_with_the_reason(monkeypatch):
    monkeypatch.setattr(metadata_process, "__name__", "gcs_server.vehicle.no_such_module")
    with pytest.raises(ValueError, match="more memory or time than"):
        read_in_process(PARAMETERS, b"{}")


def test_the_documents_of_all_vehicles_take_limited_memory(monkeypatch):
    monkeypatch.setattr(metadata_process, "MAX_BUFFERED_BYTES", 250)
    reader = metadata_process.DocumentReader()

    async def read():
        return await reader.read(PARAMETERS, parameter_document(), 0)

    documents = [asyncio.run(read())]
    with pytest.raises(ValueError, match="metadata of all vehicles"):
        asyncio.run(read())
    documents.clear()
    assert list(asyncio.run(read())) == ["GOOD"]
