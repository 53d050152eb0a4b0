# SPDX-License-Identifier: Apache-2.0
"""Searches for the files of each record type that take the most memory and time for their bytes.

usage: search.py MEASURE_SCENE [--rounds N] [--size BYTES]... [CASE...]

Varies the arguments of the cases in hostile.py by powers of two, one at a time, and keeps the
worst. Prints a Markdown table: per record type the largest share of the limit of opening and
validating (64 MiB and 4 bytes for each byte read), and the longest time per byte read.
"""
import argparse
import collections
import subprocess
import sys
import tempfile
from pathlib import Path

import hostile
import hostile_records  # noqa: F401, adds cases

LIMIT, PER_BYTE = 64 << 20, 4
READ_LIMIT = 64 << 20  # of memory for decoding and for reading complete files
Figures = collections.namedtuple("Figures", "step status size read peak seconds")


def measure(program, data, timeout=600):
    """Returns the Figures of opening, validating and reading a file with these bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hostile.stgs"
        path.write_bytes(data)
        out = subprocess.run([program, str(READ_LIMIT), path], check=True, capture_output=True, text=True, timeout=timeout).stdout
    lines = [line.split()[1:] for line in out.splitlines()]
    assert len(lines) == 3, out
    return [Figures(step, int(status), int(size), int(read), int(peak), float(seconds))
            for step, status, size, read, peak, seconds in lines]


def share_of_limit(f):
    return f.peak / (LIMIT + PER_BYTE * f.read)


def nanoseconds(f):
    return 1e9 * f.seconds / max(f.read, f.size)


def neighbours(arguments, ranges):
    for name, (least, greatest) in ranges.items():
        value = arguments[name]
        for other in (value * 2 if value else 1, value // 2, value + 1, value - 1):
            if least <= other <= greatest and other != value:
                yield {**arguments, name: other}


class Search:
    def __init__(self, program, name, size):
        self.program, self.case, self.size, self.known = program, hostile.CASES[name], size, {}

    def figures(self, arguments):
        key = tuple(sorted(arguments.items()))
        if key not in self.known:
            opening, validating, _ = measure(self.program, self.case.make(self.size, **arguments))
            self.known[key] = [opening, validating]
        return self.known[key]

    def climb(self, arguments, rating, rounds):
        best = max(map(rating, self.figures(arguments)))
        for _ in range(rounds):
            better = max(neighbours(arguments, self.case.ranges), default=None,
                         key=lambda a: max(map(rating, self.figures(a))))
            rated = 0 if better is None else max(map(rating, self.figures(better)))
            if rated <= best * 1.02:
                break
            arguments, best = better, rated
        return arguments

    def run(self, rounds):
        ranges = self.case.ranges
        for arguments in ({k: v[0] for k, v in ranges.items()}, {k: v[1] for k, v in ranges.items()}):
            for rating in (share_of_limit, nanoseconds):
                self.climb(arguments, rating, rounds)
        return [(dict(key), f) for key, figures in self.known.items() for f in figures]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--size", type=int, action="append")
    parser.add_argument("cases", nargs="*")
    options = parser.parse_intermixed_args()
    found = collections.defaultdict(list)
    for name in options.cases or hostile.CASES:
        for size in options.size or (1_000_000, 8_000_000):
            found[hostile.CASES[name].tag] += [
                (name, *result) for result in Search(options.program, name, size).run(options.rounds)]
        print(name, file=sys.stderr)
    print("| record | most memory, of its limit | file | most time per byte | file |\n|---|---|---|---|---|")
    for tag, results in found.items():
        cells = []
        for rating, text in ((share_of_limit, lambda f: f"{f.peak / 1e6:.1f} MB, {100 * share_of_limit(f):.0f} %"),
                             (nanoseconds, lambda f: f"{nanoseconds(f):.1f} ns")):
            name, arguments, f = max(results, key=lambda result: rating(result[2]))
            stated = "".join(f" {k}={v}" for k, v in arguments.items())
            cells += [text(f), f"{name}{stated}, {f.step}, {f.size} bytes"]
        print(f"| {tag} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
