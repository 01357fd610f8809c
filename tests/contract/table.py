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
from tests.contract.rules import ParameterHashes


def main() -> None:
    folder = Path(__file__).resolve().parents[3] / "shared" / "px4" / "dialogues"
    difference_counts: Counter[str] = Counter()
    different_dialogues: set[str] = set()
    dialogue_count = 0
    for name, dialogues in sessions(folder):
        if len(sys.argv) > 1 and not any(name.startswith(each) for each in sys.argv[1:]):
            continue
        began_s = time.perf_counter()
        player, difference_count = DialoguePlayer(log=needs_logs(dialogues)), 0
        hashes = ParameterHashes()
        for dialogue, next_dialogue in itertools.zip_longest(dialogues, dialogues[1:]):
            dialogue_count += 1
            for difference in compare(dialogue, player.play(dialogue, next_dialogue), hashes):
                print(f"{name} | {difference}"[:420])
                difference_counts[f"{difference.message} {difference.field}"] += 1
                different_dialogues.add(name + dialogue["id"])
                difference_count += 1
        spent_s = time.perf_counter() - began_s
        print(f"## {name}: {len(dialogues)} dialogues, {difference_count} differences, {spent_s:.1f} s")
    print(f"{len(different_dialogues)} of {dialogue_count} differ")
    if os.environ.get("SUMMARY"):
        for kind, difference_count in difference_counts.most_common(60):
            print(difference_count, kind)


if __name__ == "__main__":
    main()
