# SPDX-License-Identifier: Apache-2.0
"""Opening, validating and reading hostile files stays within the promised memory (SECURITY.md).

usage: test_resources.py MEASURE_SCENE
Every case of hostile.py, with the arguments at both ends of their ranges and with the worst ones
that search.py found, as a small and as a large file.
"""
import sys

import hostile
import hostile_records  # noqa: F401, adds cases
from search import LIMIT, PER_BYTE, READ_LIMIT, measure

WORST = {  # found by search.py
    "entries": {"segments": 1000, "tiers": 255},
    "further_entries": {"records": 4096},
    "pages": {"entries_each": 129, "damaged": 0},
    "layouts": {"rows": 255, "extra": 0},
    "fragments": {"tables_each": 4, "damaged": 1},
}
OK, INVALID, UNSUPPORTED = 0, 3, 5


def arguments_of(name, case):
    ends = [{k: v[i] for k, v in case.ranges.items()} for i in (0, 1)]
    return [a for i, a in enumerate(ends) if a not in ends[:i]] + [WORST[n] for n in WORST if n == name]


def problems(program, name, size, arguments):
    opening, validating, reading = measure(program, hostile.CASES[name].make(size, **arguments))
    for f in opening, validating, reading:
        about = f"{name} {arguments}, {f.size} bytes, {f.step}"
        limit = LIMIT + PER_BYTE * f.read
        if f is reading:
            limit = READ_LIMIT + opening.peak
        if f.peak > limit:
            yield f"{about}: {f.peak} bytes of memory for {f.read} bytes read"
        if f.read > 2.5 * f.size + 4096:
            yield f"{about}: reads {f.read} bytes"
        if f.status not in (OK, INVALID, UNSUPPORTED):
            yield f"{about}: status {f.status}"


def check_refusals(program):
    """The limits take effect: on a long index when it is opened, and on many values per byte when they are validated."""
    many = measure(program, hostile.links(8_000_000, copies=0))[0]
    few = measure(program, hostile.links(1_000_000, copies=0))[0]
    assert (many.status, few.status) == (UNSUPPORTED, OK), (many, few)
    short = measure(program, hostile.entries(300_000, segments=1000, tiers=255))[0]
    shorter = measure(program, hostile.entries(8_000, segments=15, tiers=255))[0]
    assert (short.status, shorter.status) == (UNSUPPORTED, OK), (short, shorter)
    beyond = measure(program, hostile.entries(300_000, segments=1000, tiers=1, long=1))[0]
    assert beyond.status == UNSUPPORTED, beyond
    paged = measure(program, hostile.pages(4_000_000, entries_each=129, damaged=0))[0]
    assert paged.status == UNSUPPORTED, paged
    empty = measure(program, hostile.pages(200_000, entries_each=0, damaged=0))[0]
    lost = measure(program, hostile.pages(200_000, entries_each=1, damaged=1))[0]
    repaired = measure(program, hostile.pages(80_000, entries_each=0, damaged=1, copied=1))[0]
    intact = measure(program, hostile.pages(80_000, entries_each=0, damaged=0, copied=1))[0]
    assert (empty.status, lost.status) == (UNSUPPORTED, UNSUPPORTED), (empty, lost)
    assert (repaired.status, intact.status) == (UNSUPPORTED, OK), (repaired, intact)
    dense = measure(program, hostile.frequent_symbols(300_000, blocks=16, degree=3, joined=1))[1]
    small = measure(program, hostile.frequent_symbols(8_000, blocks=1, degree=3, joined=1))[1]
    assert (dense.status, small.status) == (UNSUPPORTED, OK), (dense, small)


def main():
    program = sys.argv[1]
    found = []
    for name, case in hostile.CASES.items():
        every = arguments_of(name, case)
        for size, some in ((200_000, every), (5_000_000, every[-1:])):
            found += [problem for arguments in some for problem in problems(program, name, size, arguments)]
    print("\n".join(found))
    check_refusals(program)
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
