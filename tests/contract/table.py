"""Prints the table of differences: `python -m tests.contract.table [group or session…]`."""

import itertools
import os
import sys
import time
from collections import Counter
from pathlib import Path

from tests.contract.compare import compare
from tests.contract.driver import DialoguePlayer
from tests.contract.recordings import needs_logs, sessions
from tests.contract.rules import Hashes


def main() -> None:
    folder = Path(__file__).resolve().parents[3] / "shared" / "px4" / "dialogues"
    rows: Counter[str] = Counter()
    different: set[str] = set()
    total = 0
    for name, dialogues in sessions(folder):
        if len(sys.argv) > 1 and not any(name.startswith(each) for each in sys.argv[1:]):
            continue
        began = time.perf_counter()
        player, count = DialoguePlayer(log=needs_logs(dialogues)), 0
        hashes = Hashes()
        for dialogue, next_dialogue in itertools.zip_longest(dialogues, dialogues[1:]):
            total += 1
            for difference in compare(dialogue, player.play(dialogue, next_dialogue), hashes):
                print(f"{name} | {difference}"[:420])
                rows[f"{difference.message} {difference.field}"] += 1
                different.add(name + dialogue["id"])
                count += 1
        spent_s = time.perf_counter() - began
        print(f"## {name}: {len(dialogues)} dialogues, {count} differences, {spent_s:.1f} s")
    print(f"{len(different)} of {total} differ")
    if os.environ.get("SUMMARY"):
        for what, count in rows.most_common(60):
            print(count, what)


if __name__ == "__main__":
    main()
