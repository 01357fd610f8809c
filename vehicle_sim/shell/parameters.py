"""The console command `param`."""

from __future__ import annotations

import json
from collections.abc import Callable
from fnmatch import fnmatchcase
from functools import cache

from vehicle_sim.parameters import Parameters, ParameterValue
from vehicle_sim.px4_version import DATA_FOLDER, Px4Version
from vehicle_sim.shell.console import Arguments, Command, CommandFailed, UsageError, error, info

USAGE = (
    "show [-a|-c|-q] [FILTER*] | get NAME | set NAME VALUE | reset NAME... | reset_all [EXCLUDED*...] | "
    "compare NAME VALUE | greater NAME VALUE | touch NAME... | index N | find NAME | save | status"
)
BUILD_PARAMETER_COUNT = 1800
"""Number of all parameters of PX4's build; the vehicle uses some of them."""


@cache
def _indexes_in_build(px4: Px4Version) -> tuple[int, ...]:
    """For each parameter that the vehicle uses: its index among all parameters of PX4's build."""
    indexes = px4.differences.get("indexes")
    return tuple(indexes or json.loads((DATA_FOLDER / "parameter_indexes.json").read_text(encoding="utf-8")))


class ParamCommand:
    """The command `param` of one vehicle.

    Args:
        parameters: the vehicle's parameter store.
        unsaved_names: returns the names of parameters that are not saved yet.
    """

    def __init__(self, parameters: Parameters, unsaved_names: Callable[[], frozenset[str]]) -> None:
        self._parameters, self._unsaved_names = parameters, unsaved_names
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
            raise UsageError(f"unknown: {arguments[0]}" if arguments else "")
        return subcommand(arguments[1:])

    def _checked_name(self, name: str) -> str:
        if name not in self._parameters:
            raise CommandFailed(error("param", f"there is no parameter {name}"))
        return name

    def _value_text(self, name: str) -> str:
        value = self._parameters.get(name)
        return f"{value}" if self._parameters.type_of(name) == "INT32" else f"{value:.4f}"

    def _parsed_value(self, name: str, text: str) -> ParameterValue:
        try:
            return int(text, 0) if self._parameters.type_of(name) == "INT32" else float(text)
        except ValueError:
            raise CommandFailed(
                error("param", f"{name}: {text!r} is not a value of type {self._parameters.type_of(name)}")
            ) from None

    def _show(self, arguments: Arguments) -> str:
        options = {argument for argument in arguments if argument.startswith("-")}
        patterns = [argument for argument in arguments if not argument.startswith("-")]
        if "-q" in options:
            if not patterns:
                raise UsageError("param show -q needs a name")
            return self._value_text(self._checked_name(patterns[0])) + "\n"
        changed, unsaved_names = set(self._parameters.changed_names()), self._unsaved_names()
        out = ["Symbols: x = used, + = saved, * = unsaved\n"]
        names_and_indexes = zip(self._parameters.names, _indexes_in_build(self._parameters.px4), strict=True)
        for index, (name, index_in_build) in enumerate(names_and_indexes):
            if patterns and not any(fnmatchcase(name, pattern) for pattern in patterns):
                continue
            if "-c" in options and name not in changed:
                continue
            symbol = "*" if name in unsaved_names else "+" if name in changed else " "
            out.append(f"x {symbol} {name} [{index},{index_in_build}] : {self._value_text(name)}\n")
        out.append(f"\n {len(self._parameters)}/{BUILD_PARAMETER_COUNT} parameters used.\n")
        return "".join(out)

    def _get(self, arguments: Arguments) -> str:
        if len(arguments) != 1:
            raise UsageError("param get takes one name")
        return f"{arguments[0]}: {self._value_text(self._checked_name(arguments[0]))}\n"

    def _set(self, arguments: Arguments) -> str:
        if len(arguments) not in (2, 3):
            raise UsageError("param set takes a name and a value")
        name = self._checked_name(arguments[0])
        old_text = self._value_text(name)
        try:
            self._parameters.set(name, self._parsed_value(name, arguments[1]))
        except ValueError as problem:
            raise CommandFailed(error("param", str(problem))) from None
        new_text = self._value_text(name)
        if new_text == old_text:
            return ""
        return f"  {name}: curr: {old_text} -> new: {new_text}\n"

    def _reset(self, arguments: Arguments) -> str:
        if not arguments:
            raise UsageError("param reset takes names; use reset_all for all parameters")
        for pattern in arguments:
            names = [name for name in self._parameters.names if fnmatchcase(name, pattern)]
            if not names:
                self._checked_name(pattern)
            for name in names:
                self._parameters.reset(name)
        return ""

    def _reset_all(self, excluded: Arguments) -> str:
        self._parameters.reset_all(keep=excluded)
        return ""

    def _value_and_numbers(self, arguments: Arguments) -> tuple[float, list[float]]:
        if len(arguments) < 2:
            raise UsageError("give a name and one or more values")
        name = self._checked_name(arguments[0])
        numbers = [float(self._parsed_value(name, text)) for text in arguments[1:]]
        return float(self._parameters.get(name)), numbers

    def _compare(self, arguments: Arguments) -> str:
        value, numbers = self._value_and_numbers(arguments)
        if not any(abs(value - number) < 1e-7 * max(1.0, abs(number)) for number in numbers):
            raise CommandFailed()
        return ""

    def _greater(self, arguments: Arguments) -> str:
        value, numbers = self._value_and_numbers(arguments)
        if not value > numbers[0]:
            raise CommandFailed()
        return ""

    def _touch(self, arguments: Arguments) -> str:
        for name in arguments:
            self._checked_name(name)
        return ""

    def _index(self, arguments: Arguments) -> str:
        name = self._parameters.name_at(int(arguments[0])) if arguments and arguments[0].isdecimal() else None
        if name is None:
            raise CommandFailed(error("param", f"give an index from 0 to {len(self._parameters) - 1}"))
        return f"index {arguments[0]}: {name} : {self._value_text(name)}\n"

    def _find(self, arguments: Arguments) -> str:
        if len(arguments) != 1:
            raise UsageError("param find takes one name")
        name = self._checked_name(arguments[0])
        return f"Found param {name} at index {self._parameters.index_of(name)}\n"

    def _status(self, arguments: Arguments) -> str:
        changed, unsaved_names = self._parameters.changed_names(), self._unsaved_names()
        return (
            info("parameters", f"{len(self._parameters)}/{BUILD_PARAMETER_COUNT} used")
            + info("parameters", f"{len(changed)} differ from the defaults")
            + info("parameters", f"{len(unsaved_names)} not saved yet")
        )
