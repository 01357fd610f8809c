"""Checks a plan. Each finding has a stable code, a message, the item concerned, and a fix if there is one.

`check` never raises: a rule that fails becomes a finding. An error: PX4 v1.16 refuses the plan, or the plan
is unsafe. A warning: the flight may differ from what the pilot expects.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

from missions import check_items, check_obstacles, check_space
from missions.check_context import (
    CODES,
    UNKNOWN_PARAMETERS_FIX,
    CheckLimits,
    Context,
    Finding,
    unknown_parameters_text,
)
from missions.estimates import estimate
from missions.plan import ItemGroup, Plan

__all__ = ["CODES", "CheckLimits", "Finding", "check"]

Rule = Callable[[Context], Iterator[Finding]]
"""One kind of check."""


def check(plan: Plan, limits: CheckLimits | None = None) -> tuple[Finding, ...]:
    """All findings about a plan, in the order of the rules."""
    limits = limits or CheckLimits()
    rules: tuple[Rule, ...] = (
        *check_items.RULES, *check_space.RULES, *check_obstacles.RULES, _endurance, _parameters
    )  # fmt: skip
    findings: list[Finding] = []
    try:
        context = Context.from_plan(plan, limits)
    except Exception as error:
        return (Finding("check_failed", f"The plan could not be checked: {error!r:.200}."),)
    for rule in rules:
        try:
            findings += list(rule(context))
        except Exception as error:
            name = getattr(rule, "__name__", "rule").strip("_").replace("_", " ")
            message = f"The check of {name} could not be carried out: {error!r:.200}."
            findings.append(Finding("check_failed", message))
    return tuple(_once_per_group(plan, findings))


def _once_per_group(plan: Plan, findings: list[Finding]) -> Iterator[Finding]:
    """The findings; of those with one code about the items of one pattern only the first, with a number."""
    groups = {row for row, item in enumerate(plan.items) if isinstance(item, ItemGroup)}
    counts = Counter((each.code, each.row) for each in findings)
    seen: set[tuple[str, int | None]] = set()
    for finding in findings:
        key, count = (finding.code, finding.row), counts[(finding.code, finding.row)]
        if finding.row not in groups or count == 1:
            yield finding
        elif key not in seen:
            is_error = any(each.is_error for each in findings if (each.code, each.row) == key)
            message = f"{finding.message} ({count} times in this pattern)"
            yield replace(finding, message=message, is_error=is_error)
        seen.add(key)


def _parameters(context: Context) -> Iterator[Finding]:
    """Parameters of the vehicle that the other checks would need."""
    names = context.limits.unknown_parameters
    if names:
        yield Finding("parameters_unknown", unknown_parameters_text(names), fix=UNKNOWN_PARAMETERS_FIX)


def _endurance(context: Context) -> Iterator[Finding]:
    """Endurance of the whole flight."""
    limits = context.limits
    total = estimate(context.plan, limits.vehicle, limits.power)
    if total.energy_wh is None or limits.power is None:
        return
    if total.endless:
        message = "The plan repeats endlessly: no battery is large enough."
        yield Finding("endurance_endless", message, fix="Give the jump a number of repeats.")
    elif total.energy_wh > limits.power.usable_wh:
        message = (
            f"The flight takes {total.energy_wh:.0f} Wh ({total.time_s / 60:.0f} min), the battery provides "
            f"{limits.power.usable_wh:.0f} Wh with {limits.power.reserve:.0%} in reserve."
        )
        yield Finding(
            "endurance_exceeded", message, fix="Shorten the plan, or split it into several flights."
        )
