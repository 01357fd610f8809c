"""The console command `param`."""

from __future__ import annotations

import json
from collections.abc import Callable
from fnmatch import fnmatchcase
from functools import cache

from vehicle_sim.parameters import DATA_FILE, Parameters, ParameterValue
from vehicle_sim.shell.console import Arguments, Command, CommandFailed, Usage, error, info

USAGE = (
    "show [-a|-c|-q] [FILTER*] | get NAME | set NAME VALUE | reset NAME... | reset_all [EXCLUDED*...] | "
    "compare NAME VALUE | greater NAME VALUE | touch NAME... | index N | find NAME | save | status"
)
ALL_PARAMETERS = 1800
"""Number of parameters of the build, used or unused."""


@cache
def _build_indexes() -> tuple[int, ...]:
    """Index of each used parameter among all parameters of the build."""
    return tuple(json.loads((DATA_FILE.parent / "parameter_indexes.json").read_text(encoding="utf-8")))


class ParamCommand:
    """The command `param` of one vehicle.

    Args:
        parameters: the vehicle's parameter store.
        unsaved: returns the names of parameters that are not saved yet.
    """

    def __init__(self, parameters: Parameters, unsaved: Callable[[], frozenset[str]]) -> None:
        self._parameters, self._unsaved = parameters, unsaved
        self._subcommands: dict[str, Callable[[Arguments], str]] = {
            "show": self._show, "get": self._get, "set": self._set, "reset": self._reset,
            "reset_all": self._reset_all, "compare": self._compare, "greater": self._greater,
            "touch": self._touch, "index": self._index, "index_used": self._index, "find": self._find,
            "save": lambda arguments: "", "status": self._status,
        }  # fmt: skip
        self.command = Command(self.run, USAGE)

    def run(self, arguments: Arguments) -> str:
        """Runs `param …`."""
        subcommand = self._subcommands.get(arguments[0]) if arguments else None
        if subcommand is None:
            raise Usage(f"unknown: {arguments[0]}" if arguments else "")
        return subcommand(arguments[1:])

    def _existing(self, name: str) -> str:
        if name not in self._parameters:
            raise CommandFailed(error("param", f"there is no parameter {name}"))
        return name

    def _text(self, name: str) -> str:
        value = self._parameters.get(name)
        return f"{value}" if self._parameters.type_of(name) == "INT32" else f"{value:.4f}"

    def _number(self, name: str, text: str) -> ParameterValue:
        try:
            return int(text, 0) if self._parameters.type_of(name) == "INT32" else float(text)
        except ValueError:
            raise CommandFailed(
                error("param", f"{name}: {text!r} is not a value of type {self._parameters.type_of(name)}")
            ) from None

    def _show(self, arguments: Arguments) -> str:
        options = {word for word in arguments if word.startswith("-")}
        patterns = [word for word in arguments if not word.startswith("-")]
        if "-q" in options:
            if not patterns:
                raise Usage("param show -q needs a name")
            return self._text(self._existing(patterns[0])) + "\n"
        changed, unsaved = set(self._parameters.changed_names()), self._unsaved()
        out = ["Symbols: x = used, + = saved, * = unsaved\n"]
        for index, (name, in_build) in enumerate(zip(self._parameters.names, _build_indexes(), strict=True)):
            if patterns and not any(fnmatchcase(name, pattern) for pattern in patterns):
                continue
            if "-c" in options and name not in changed:
                continue
            state = "*" if name in unsaved else "+" if name in changed else " "
            out.append(f"x {state} {name} [{index},{in_build}] : {self._text(name)}\n")
        out.append(f"\n {len(self._parameters)}/{ALL_PARAMETERS} parameters used.\n")
        return "".join(out)

    def _get(self, arguments: Arguments) -> str:
        if len(arguments) != 1:
            raise Usage("param get takes one name")
        return f"{arguments[0]}: {self._text(self._existing(arguments[0]))}\n"

    def _set(self, arguments: Arguments) -> str:
        if len(arguments) not in (2, 3):
            raise Usage("param set takes a name and a value")
        name = self._existing(arguments[0])
        before = self._text(name)
        try:
            self._parameters.set(name, self._number(name, arguments[1]))
        except ValueError as problem:
            raise CommandFailed(error("param", str(problem))) from None
        after = self._text(name)
        if after == before:
            return ""
        return f"  {name}: curr: {before} -> new: {after}\n"

    def _reset(self, arguments: Arguments) -> str:
        if not arguments:
            raise Usage("param reset takes names; use reset_all for all parameters")
        for pattern in arguments:
            names = [name for name in self._parameters.names if fnmatchcase(name, pattern)]
            if not names:
                self._existing(pattern)
            for name in names:
                self._parameters.reset(name)
        return ""

    def _reset_all(self, excluded: Arguments) -> str:
        self._parameters.reset_all(keep=excluded)
        return ""

    def _name_and_numbers(self, arguments: Arguments) -> tuple[float, list[float]]:
        if len(arguments) < 2:
            raise Usage("give a name and one or more values")
        name = self._existing(arguments[0])
        return float(self._parameters.get(name)), [float(self._number(name, word)) for word in arguments[1:]]

    def _compare(self, arguments: Arguments) -> str:
        value, numbers = self._name_and_numbers(arguments)
        if not any(abs(value - number) < 1e-7 * max(1.0, abs(number)) for number in numbers):
            raise CommandFailed()
        return ""

    def _greater(self, arguments: Arguments) -> str:
        value, numbers = self._name_and_numbers(arguments)
        if not value > numbers[0]:
            raise CommandFailed()
        return ""

    def _touch(self, arguments: Arguments) -> str:
        for name in arguments:
            self._existing(name)
        return ""

    def _index(self, arguments: Arguments) -> str:
        name = self._parameters.name_at(int(arguments[0])) if arguments and arguments[0].isdecimal() else None
        if name is None:
            raise CommandFailed(error("param", f"give an index from 0 to {len(self._parameters) - 1}"))
        return f"index {arguments[0]}: {name} : {self._text(name)}\n"

    def _find(self, arguments: Arguments) -> str:
        if len(arguments) != 1:
            raise Usage("param find takes one name")
        name = self._existing(arguments[0])
        return f"Found param {name} at index {self._parameters.index_of(name)}\n"

    def _status(self, arguments: Arguments) -> str:
        changed, unsaved = self._parameters.changed_names(), self._unsaved()
        return (
            info("parameters", f"{len(self._parameters)}/{ALL_PARAMETERS} used")
            + info("parameters", f"{len(changed)} differ from the defaults")
            + info("parameters", f"{len(unsaved)} not saved yet")
        )
