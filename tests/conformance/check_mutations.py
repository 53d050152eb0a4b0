#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the project's decoder with the reference decoder on mutated conformance vectors, most of them with
recalculated checksums, so that the mutations reach the decoders: both must decode and refuse the same parts.

usage: check_mutations.py [--count N] [--seed N] PROGRAM...      PROGRAM is describe_vectors, or a command that runs it
"""
import argparse
import json
import os
import random
import struct
import sys
import tempfile
import zlib

from check_vectors import HERE, MANIFEST, program_results, reference

LIMITS = {"max_primitives": 100_000, "max_memory": 1 << 22}
NUMBERS = (0, 1, 2, 3, 4, 7, 8, 16, 31, 32, 127, 128, 254, 255)
WIDE = (0, 1, -1, 1 << 31, 1 << 24, (1 << 63) - 1, 65535, 1 << 20)


def records(data):
    """Returns the offset and the payload size of each record."""
    at, out = 32, []
    while at + 24 <= len(data):
        size = struct.unpack_from("<Q", data, at + 8)[0]
        if at + 24 + size > len(data):
            break
        out.append((at, size))
        at += 24 + size
    return out


def with_checksums(data):
    data = bytearray(data)
    struct.pack_into("<I", data, 28, zlib.crc32(data[:28]))
    for at, size in records(data):
        struct.pack_into("<I", data, at + 16, zlib.crc32(data[at + 24:at + 24 + size]))
        struct.pack_into("<I", data, at + 20, zlib.crc32(data[at:at + 20]))
    return bytes(data)


def mutated(data, rng):
    """Changes one or two bytes or numbers, mostly near the beginning of a record."""
    data = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2))):
        at, size = rng.choice(records(data) or [(0, 8)])
        if size == 0 or rng.random() < 0.1:
            position = at + rng.randrange(16)
        else:
            position = at + 24 + rng.randrange(rng.choice((size, min(size, 160))))
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


def outcome(result):
    """Returns what both decoders must agree on. If records that readers ignore are damaged, a reader may look for
    IMPO after them or not; which error of a part is found first may differ."""
    lines = [line for line in result.text.splitlines() if not line.startswith("importance")]
    return lines, [part for part, _ in result.refused if part != "importance"], sorted(set(result.reported))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("program", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with open(MANIFEST, encoding="utf-8") as file:
        names = [e["name"] for e in json.load(file)["vectors"] if "refused" not in e and e["bytes"] < 8000]
    valid = []
    for name in names:
        with open(os.path.join(HERE, "vectors", name + ".stgs"), "rb") as file:
            valid.append(file.read())
    differing, refused = 0, 0
    with tempfile.TemporaryDirectory() as folder:
        inputs = {}
        for i in range(options.count):
            number = rng.randrange(len(valid))
            path = os.path.join(folder, f"{i}_{names[number]}.stgs")
            inputs[path] = mutated(valid[number], rng)
            with open(path, "wb") as file:
                file.write(inputs[path])
        results = program_results(options.program, [(path, LIMITS) for path in inputs])
        for path, data in inputs.items():
            expected = reference(data, LIMITS)[0]
            refused += bool(expected.refused)
            if outcome(expected) == outcome(results[path]):
                continue
            differing += 1
            print(f"{os.path.basename(path)}: the reference finds {expected.refused} {expected.reported}, the decoder "
                  f"{results[path].refused} {results[path].reported}:\n{data.hex()}")
    print(f"{options.count} mutated vectors, {refused} refused, {differing} decoded differently")
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
