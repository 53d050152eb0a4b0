#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Decodes .stgs files as stgs-format.md defines, favouring clarity over speed.

usage: decode.py [--max-primitives N] [--max-memory BYTES] [--integers] FILE...

Prints for each file a line for each attribute of each tier of a segment, with the XXH3-64 of its
floats (f32, one primitive after the other); with --integers also that of its integers (i64, one
component after the other). Refused tiers, records or files are printed with the clause that refuses
them. Exit code 3: something was refused.
"""
import sys

import numpy as np

from container import Limits, open_file, read_importance
from fields import Refused, checksum
from layouts import NAMES
from segment import decode_tier


def describe(data, limits, integers=False):
    """Returns the lines for a file, and the clauses that refuse it or parts of it."""
    lines, refused = [], []

    def refuse(part, error):
        refused.append(error.clause)
        lines.append(f"{part}refused: {error}")

    try:
        file = open_file(data, limits)
    except Refused as error:
        refuse("", error)
        return lines, refused
    for error in file.damage:
        refuse("damage ", error)
    for i, tier in enumerate(file.tiers):
        try:
            streams, sh_error = decode_tier(file, tier)
            for attribute, (q, floats) in sorted(streams.items()):
                line = f"segment {i} {NAMES[attribute]} {checksum(floats.astype('<f4').tobytes()):016x}"
                if integers:
                    line += f" {checksum(np.array(q, dtype='<i8').tobytes()):016x}"
                lines.append(line)
            if sh_error:  # SH above degree 0 is 0 (5.7)
                refuse(f"segment {i} sh ", sh_error)
        except Refused as error:
            refuse(f"segment {i} ", error)
    try:
        importance = read_importance(file)
        if importance is not None:
            lines.append(f"importance {checksum(importance):016x}")
    except Refused as error:
        refuse("importance ", error)
    return lines, refused


def main(arguments):
    limits, integers, files = Limits(), False, []
    while arguments:
        argument = arguments.pop(0)
        if argument == "--integers":
            integers = True
        elif argument in ("--max-primitives", "--max-memory") and arguments:
            setattr(limits, argument[2:].replace("-", "_"), int(arguments.pop(0)))
        elif argument.startswith("-"):
            sys.exit(__doc__)
        else:
            files.append(argument)
    if not files:
        sys.exit(__doc__)
    any_refused = False
    for path in files:
        with open(path, "rb") as file:
            lines, refused = describe(file.read(), limits, integers)
        print(f"{path}:")
        print("\n".join("  " + line for line in lines))
        any_refused = any_refused or bool(refused)
    sys.exit(3 if any_refused else 0)


if __name__ == "__main__":
    main(sys.argv[1:])
