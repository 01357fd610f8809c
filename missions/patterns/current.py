"""Patterns of a plan: their items, made anew when the pattern has been changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate

from missions.errors import PlanError
from missions.items import Jump
from missions.pattern_settings import PatternDocument
from missions.patterns.document import make
from missions.plan import ItemGroup, PatternItem, Plan, PlanItem, SimpleItem, pattern_key


def pattern_item(
    pattern: PatternDocument, items: tuple[SimpleItem, ...] | None = None, *, original: str | None = None
) -> PatternItem:
    """The row of a plan for a pattern.

    Args:
        pattern: geometry and values.
        items: its mission items, for example of a file; None: they are made from the pattern.
        original: JSON text of the pattern in a file.

    Raises:
        PlanError: The pattern cannot be flown.
    """
    items = make(pattern).items if items is None else items
    return PatternItem(pattern=pattern, items=items, items_key=pattern_key(pattern), original=original)


def with_current_patterns(plan: Plan) -> Plan:
    """The plan with the items of every pattern; items that belong to their pattern are kept.

    Raises:
        PlanError: A pattern cannot be flown; the error names item and field.
    """
    items = [_current(item, number) for number, item in enumerate(plan.items, start=1)]
    return plan.model_copy(update={"items": tuple(_retargeted(plan.items, items))})


def _retargeted(before: Sequence[PlanItem], after: Sequence[PlanItem]) -> Iterator[PlanItem]:
    """The items; jumps keep their targets, which count mission items. A jump into a pattern whose items have
    been made anew goes to its first item."""
    new_starts = [0, *accumulate(len(_mission_items(item)) for item in after)]
    new_index: list[int] = []
    for old, new, start in zip(before, after, new_starts, strict=False):
        keeps = old is new
        new_index += [start + offset if keeps else start for offset in range(len(_mission_items(old)))]
    for item in after:
        if isinstance(item, Jump) and item.target_index < len(new_index):
            yield item.model_copy(update={"target_index": new_index[item.target_index]})
        else:
            yield item


def _mission_items(item: PlanItem) -> tuple[SimpleItem, ...]:
    return item.items if isinstance(item, ItemGroup) else (item,)


def _current(item: PlanItem, number: int) -> PlanItem:
    if not isinstance(item, PatternItem) or item.is_current:
        return item
    try:
        return pattern_item(item.pattern, original=item.original)
    except PlanError as error:
        place = f"item {number} ({item.pattern.kind}), {error.place}"
        raise PlanError(place, error.reason, error.fix, field=f"items[{number - 1}].pattern") from None
