"""PX4's console, independent of the transport: reads lines, returns output and prompt.

The commands are in `commands.py`; this module handles echo, prompt, unknown and failed commands, and commands
that take simulated time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

PROMPT = "pxh> "
MAX_LINE_LENGTH = 1000


class CommandFailed(Exception):
    """A command that ends with an error; `output` is the command's text."""

    def __init__(self, output: str = "", code: int = 1) -> None:
        super().__init__(output)
        self.output = output
        self.code = code


class Usage(Exception):
    """A command has invalid arguments; the text is the reason."""


Arguments = list[str]
"""Arguments of a command, without its name."""
Output = str | Iterator[tuple[str, float]]
"""Output of a command: a text, or pairs of a text and the time to wait after the text [s]."""
Run = Callable[[Arguments], Output]


@dataclass(frozen=True, slots=True)
class Command:
    """One command of the console."""

    run: Run
    usage: str
    """The arguments that the command accepts, as the console prints them."""


def info(module: str, text: str) -> str:
    """An information line of a module."""
    return f"INFO  [{module}] {text}\n"


def warning(module: str, text: str) -> str:
    """A warning line of a module."""
    return f"WARN  [{module}] {text}\n"


def error(module: str, text: str) -> str:
    """An error line of a module."""
    return f"ERROR [{module}] {text}\n"


class Console:
    """One session.

    Args:
        commands: the simulated commands, by name.
        builtin: names of all modules of the build; modules not in `commands` report that they are not
            simulated.
        now_s: returns the simulated time.
    """

    def __init__(
        self, commands: Mapping[str, Command], builtin: tuple[str, ...], now_s: Callable[[], float]
    ) -> None:
        self._commands, self._builtin, self._now_s = commands, builtin, now_s
        self._line = ""
        self._lines: list[str] = []
        self._running: Iterator[tuple[str, float]] | None = None
        self._name = ""
        self._resume_at_s = math.inf

    @property
    def busy(self) -> bool:
        """Whether a command is still running."""
        return self._running is not None

    def receive_text(self, text: str) -> str:
        """Processes typed characters; returns the output."""
        output = ""
        for character in text:
            if character == "\n":
                line, self._line = self._line, ""
                output += character
                if self.busy:
                    self._lines.append(line)
                else:
                    output += self._process(line)
            elif len(self._line) < MAX_LINE_LENGTH:
                self._line += character
                output += character
        return output

    def step(self) -> str:
        """New output of the running command."""
        output = ""
        while self._running is not None and self._now_s() >= self._resume_at_s:
            output += self._advance()
            while self._lines and not self.busy:
                output += self._process(self._lines.pop(0))
        return output

    def _process(self, line: str) -> str:
        words = line.split()
        if not words:
            return PROMPT
        name, arguments = words[0], words[1:]
        if name == "help":
            return "".join(("Builtin Commands:\n", *(f"  {each}\n" for each in self._builtin), PROMPT))
        command = self._commands.get(name)
        if command is None:
            if name in self._builtin:
                return error(name, "the simulated vehicle has no such module") + self._failed(name, 1)
            return f"Invalid command: {name}\ntype 'help' for a list of commands\n" + PROMPT
        try:
            output = command.run(arguments)
        except Usage as problem:
            text = f"{problem}\n" if str(problem) else ""
            return f"{text}Usage: {name} {command.usage}\n" + self._failed(name, 1)
        except CommandFailed as failed:
            return failed.output + self._failed(name, failed.code)
        if isinstance(output, str):
            return output + PROMPT
        self._running, self._name, self._resume_at_s = output, name, self._now_s()
        return self._advance()

    def _advance(self) -> str:
        assert self._running is not None
        try:
            text, wait_s = next(self._running)
        except StopIteration:
            self._running = None
            return PROMPT
        except CommandFailed as failed:
            self._running = None
            return failed.output + self._failed(self._name, failed.code)
        self._resume_at_s = self._now_s() + wait_s
        return text

    @staticmethod
    def _failed(name: str, code: int) -> str:
        return f"Command '{name}' failed, returned {code}.\n" + PROMPT
