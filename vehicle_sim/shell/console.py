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
    """A command has failed with exit code `code`; `output` is the command's output."""

    def __init__(self, output: str = "", code: int = 1) -> None:
        super().__init__(output)
        self.output = output
        self.code = code


class UsageError(Exception):
    """A command has invalid arguments; the text is the reason."""


Arguments = list[str]
"""Arguments of a command, without its name."""
Output = str | Iterator[tuple[str, float]]
"""Output of a command: a text, or pairs of a text and the time to wait after the text [s]."""
CommandFunction = Callable[[Arguments], Output]


@dataclass(frozen=True, slots=True)
class Command:
    """One command of the console."""

    run: CommandFunction
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
    """One session of the console.

    Args:
        commands: the simulated commands, by name.
        built_in: names of all modules of the build, also of modules that are not simulated.
        now_s: returns the simulated time.
    """

    def __init__(
        self, commands: Mapping[str, Command], built_in: tuple[str, ...], now_s: Callable[[], float]
    ) -> None:
        self._commands, self._built_in, self._now_s = commands, built_in, now_s
        self._line = ""
        self._waiting_lines: list[str] = []
        """Complete lines that were typed while a command was running."""
        self._running: Iterator[tuple[str, float]] | None = None
        self._running_name = ""
        self._resume_at_s = math.inf

    @property
    def busy(self) -> bool:
        """Whether a command is still running."""
        return self._running is not None

    def receive_text(self, text: str) -> str:
        """Processes typed characters; returns the echo and the output."""
        output = ""
        for character in text:
            if character == "\n":
                line, self._line = self._line, ""
                output += character
                if self.busy:
                    self._waiting_lines.append(line)
                else:
                    output += self._process(line)
            elif len(self._line) < MAX_LINE_LENGTH:
                self._line += character
                output += character
        return output

    def step(self) -> str:
        """Continues the running command, then runs waiting lines; returns the output."""
        output = ""
        while self._running is not None and self._now_s() >= self._resume_at_s:
            output += self._advance()
            while self._waiting_lines and not self.busy:
                output += self._process(self._waiting_lines.pop(0))
        return output

    def _process(self, line: str) -> str:
        words = line.split()
        if not words:
            return PROMPT
        name, arguments = words[0], words[1:]
        if name == "help":
            return "".join(("Builtin Commands:\n", *(f"  {module}\n" for module in self._built_in), PROMPT))
        command = self._commands.get(name)
        if command is None:
            if name in self._built_in:
                return error(name, "the simulated vehicle has no such module") + self._failure_text(name, 1)
            return f"Invalid command: {name}\ntype 'help' for a list of commands\n" + PROMPT
        try:
            output = command.run(arguments)
        except UsageError as problem:
            text = f"{problem}\n" if str(problem) else ""
            return f"{text}Usage: {name} {command.usage}\n" + self._failure_text(name, 1)
        except CommandFailed as failure:
            return failure.output + self._failure_text(name, failure.code)
        if isinstance(output, str):
            return output + PROMPT
        self._running, self._running_name, self._resume_at_s = output, name, self._now_s()
        return self._advance()

    def _advance(self) -> str:
        assert self._running is not None
        try:
            text, wait_s = next(self._running)
        except StopIteration:
            self._running = None
            return PROMPT
        except CommandFailed as failure:
            self._running = None
            return failure.output + self._failure_text(self._running_name, failure.code)
        self._resume_at_s = self._now_s() + wait_s
        return text

    @staticmethod
    def _failure_text(name: str, code: int) -> str:
        return f"Command '{name}' failed, returned {code}.\n" + PROMPT
