#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the project's decoder with the reference decoder on mutated conformance vectors, most of
them with recalculated checksums, so that the mutations reach the decoders: both must decode and
refuse the same parts.

usage: check_mutations.py PROGRAM [COUNT [SEED]]      PROGRAM is describe_vectors
"""
import json
import os
import random
import struct
import sys
import tempfile

from check_vectors import HERE, MANIFEST, checksum, describe, program_blocks, split
from container import Limits

LIMITS = {"max_primitives": 100_000, "max_memory": 1 << 22}
NUMBERS = (0, 1, 2, 3, 4, 7, 8, 16, 31, 32, 127, 128, 254, 255)
WIDE = (0, 1, -1, 1 << 31, 1 << 24, (1 << 63) - 1, 65535, 1 << 20)


def records(data):
    """Returns the offset and the payload size of each record."""
    at, out = 40, []
    while at + 32 <= len(data):
        size = struct.unpack_from("<Q", data, at + 8)[0]
        if at + 32 + size > len(data):
            break
        out.append((at, size))
        at += 32 + size
    return out


def with_checksums(data):
    data = bytearray(data)
    for at, size in records(data):
        struct.pack_into("<Q", data, at + 16, checksum(data[at + 32:at + 32 + size]))
        struct.pack_into("<Q", data, at + 24, checksum(data[at:at + 24]))
    struct.pack_into("<Q", data, 32, checksum(data[:32]))
    return bytes(data)


def mutated(data, rng):
    """Changes one or two bytes or numbers, mostly near the beginning of a record."""
    data = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2))):
        at, size = rng.choice(records(data) or [(0, 8)])
        if size == 0 or rng.random() < 0.1:
            position = at + rng.randrange(16)
        else:
            position = at + 32 + rng.randrange(rng.choice((size, min(size, 160))))
        kind = rng.randrange(4)
        if kind == 0:
            data[position] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[position] = rng.choice(NUMBERS)
        elif kind == 2:
            data[position] = (data[position] + rng.choice((-2, -1, 1, 2))) % 256
        else:
            width = min(rng.choice((2, 4, 8)), len(data) - position)
            data[position:position + width] = rng.choice(WIDE).to_bytes(8, "little", signed=True)[:width]
    return with_checksums(data) if rng.random() < 0.8 else bytes(data)


def without_importance(lines):
    # If ignored records are damaged, a reader may look for IMPO after them or not.
    return split([line for line in lines if not line.startswith("importance")])


def main():
    if not 2 <= len(sys.argv) <= 4:
        sys.exit(__doc__)
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 300
    rng = random.Random(int(sys.argv[3]) if len(sys.argv) > 3 else 1)
    with open(MANIFEST, encoding="utf-8") as file:
        names = [entry["name"] for entry in json.load(file)["vectors"]
                 if "refused" not in entry and "reported" not in entry and entry["bytes"] < 4000]
    valid = []
    for name in names:
        with open(os.path.join(HERE, "vectors", name + ".stgs"), "rb") as file:
            valid.append(file.read())
    differing, refused = 0, 0
    with tempfile.TemporaryDirectory() as folder:
        inputs = {}
        for i in range(count):
            number = rng.randrange(len(valid))
            path = os.path.join(folder, f"{i}_{names[number]}.stgs")
            inputs[path] = mutated(valid[number], rng)
            with open(path, "wb") as file:
                file.write(inputs[path])
        results = program_blocks(sys.argv[1], list(inputs), LIMITS)
        for path, data in inputs.items():
            decoded, parts = without_importance(describe(data, Limits(**LIMITS))[0])
            other, other_parts = without_importance(results[path][:-1])
            refused += bool(parts)
            if decoded == other and [p for p, _ in parts] == [p for p, _ in other_parts]:
                continue
            differing += 1
            print(f"{os.path.basename(path)}: the reference refuses {parts}, the decoder "
                  f"{other_parts}:\n{data.hex()}")
    print(f"{count} mutated vectors, {refused} refused, {differing} decoded differently")
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
