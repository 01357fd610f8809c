"""Repeated log lines are limited in number and length."""

import logging

import pytest

from gcs_server.log_limit import LINES_PER_PERIOD, MAX_LINE_LENGTH, PERIOD_S, LogLimit


class LineRecorder(logging.Handler):
    def __init__(self):
        super().__init__()
        self.now_s, self.texts = 0.0, []
        self.addFilter(LogLimit(lambda: self.now_s))
        self.setFormatter(logging.Formatter("%(message)s"))

    def emit(self, record):
        self.texts.append(self.format(record))


@pytest.fixture
def recorder():
    handler, logger = LineRecorder(), logging.getLogger("test")
    logger.addHandler(handler)
    yield handler
    logger.removeHandler(handler)


def test_equal_lines_and_tracebacks_beyond_the_limit_are_counted_and_not_written(recorder):
    def fail(number):
        try:
            raise ValueError(number)
        except ValueError:
            logging.getLogger("test").exception("connection %d", number)

    for number in range(1000):
        fail(number)
    assert len(recorder.texts) == LINES_PER_PERIOD
    recorder.now_s += PERIOD_S
    fail(1000)
    assert len(recorder.texts) == LINES_PER_PERIOD + 1
    assert recorder.texts[-1].startswith(f"connection 1000 ({1000 - LINES_PER_PERIOD} more such lines")
    logging.getLogger("test").warning("another")
    assert recorder.texts[-1] == "another"


def test_a_very_long_log_line_is_cut(recorder):
    logging.getLogger("test").error("%s", "x" * 1_000_000)
    assert len(recorder.texts[0]) < MAX_LINE_LENGTH + 100
    assert "1000000 characters" in recorder.texts[0]
