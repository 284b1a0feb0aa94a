"""Pin the answers of the small inputs of tests/pinned anew, and print what has changed.

    python scripts/pin_answers.py [ROOM ...]

Read every line that it prints before the files are committed: each is a figure or a sentence that users see change.
"""

import sys
from pathlib import Path

TESTS = Path(__file__).parent.parent / "tests"


def main(rooms: list[str]) -> None:
    sys.path.insert(0, str(TESTS))
    from pinned.rooms import ROOMS, cases_of

    from support.pins import differences, pinned, saved, write

    for room in rooms or ROOMS:
        answers = {name: pinned(answer()) for name, answer in cases_of(room).items()}
        changes = differences(saved(room), answers, tolerance=ROOMS[room])
        # where nothing changes, no last digit does either
        if changes:
            write(room, answers)
        print(f"{room}: {len(answers)} answers, {len(changes)} changes", *changes, sep="\n    ")


if __name__ == "__main__":
    main(sys.argv[1:])
