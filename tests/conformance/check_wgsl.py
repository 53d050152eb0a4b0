#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares spec/shaders/decode.wgsl with the reference decoder on the conformance vectors.

usage: check_wgsl.py

Runs the shader on the records of all tiers, as they are and with damage to each unit. The
integers of each stream (stgs-format.md 8.3, 8.4) and the refused units must be the same. Needs Node and
its module webgpu: `npm install -g webgpu`, or set STGS_WEBGPU to the folder of the module. Without a
GPU, it needs lavapipe of Mesa 25 (not of Debian 12, whose 22.3 WebGPU does not accept) or SwiftShader of
Debian's chromium-common, which is used if it is installed. Exit code 77: something is missing.
"""
import os
import random
import shutil
import struct
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, field

HERE = os.path.dirname(os.path.abspath(__file__))
SPEC = os.path.join(HERE, "../../spec")
sys.path.insert(0, os.path.join(SPEC, "reference_decoder"))
SKIPPED = 77
STREAM = 14  # u32 in a struct Stream of the shader
SWIFTSHADER = "/usr/lib/chromium/vk_swiftshader_icd.json"


def skip(reason):
    print(f"skipped: {reason}")
    sys.exit(SKIPPED)


try:
    from container import Limits, open_file
    from decode import segments_of
    from fields import Refused
    from layouts import MORTON, RANS, SH_DEGREE
    from segment import Memory, check_units, count_of, little_endian, open_record, record_layout, unit_planes, units_of
    from streams import predicted, values
except ImportError as error:
    skip(f"{error} (tools/setup/packages.txt)")


@dataclass
class Coded:
    """The units of a record, and what it takes to decode them."""
    rows: list     # of each unit
    data: list     # bytes of each unit
    tables: list
    counts: list   # primitives, and those with SH of each degree (6.5)
    first_key: int


def read_units(file, segment, record):
    """Returns the Coded of a SEGM record (6.5), without optional streams."""
    f = open_record(file, segment, record)
    counts = [f.u32()]
    layout, tables = record_layout(file, f, Memory(1 << 40))
    counts += [f.u32() if any(r.attribute == SH_DEGREE for r in layout) else 0 for _ in range(file.meta.degree)]
    first_key = f.u32() if any(r.prediction == MORTON and not r.optional() for r in layout) else 0
    units = units_of(layout)
    sizes = [f.u32() for _ in units]
    stored = [(rows, f.bytes(size)) for rows, size in zip(units, sizes)]
    required = [(rows, data) for rows, data in stored if not rows[0].optional()]
    return Coded([rows for rows, _ in required], [data for _, data in required], tables, counts, first_key)


def records_of(data):
    """Yields the Coded of each record of contents 0 and 1 that can be split into units."""
    try:
        file = open_file(data, Limits())
    except Refused:
        return
    for _, segment in segments_of(file):
        for record in segment.tiers + segment.sh:
            try:
                yield read_units(file, segment, record)
            except Refused:
                continue


def expected(coded, u):
    """Returns the integers of the streams of a unit by the reference decoder; None: it is refused."""
    rows, data = coded.rows[u], coded.data[u]
    try:
        check_units([rows], [data], coded.tables, coded.counts, Memory(1 << 40))
        planes = unit_planes(rows, data, coded.tables, coded.counts)
        return [predicted(row, values(row, planes[row.attribute], count_of(row, coded.counts)), coded.first_key)
                for row in rows]
    except Refused:
        return None


def damaged(coded, rng):
    """Returns the record with damage to each unit, and, of some, another first key."""
    kinds = (flipped, lambda data, _: data[:-1], lambda data, _: data + b"\0", lambda data, _: data + b"\0\0",
             lambda data, _: data[:2] + bytes(2) + data[4:], lambda data, _: data[:-4] + data[-2:])
    data = [rng.choice(kinds)(unit, rng) for unit in coded.data]
    first_key = rng.choice((coded.first_key, coded.first_key ^ 1 << 29, 0xFFFFFFFF))
    return Coded(coded.rows, data, coded.tables, coded.counts, first_key)


def flipped(data, rng):
    if not data:
        return data
    out = bytearray(data)
    out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def lookup(table):
    """Returns the 4096 entries of a table."""
    return [s << 24 | table.f[s] - 1 << 12 | q - table.start[s] for q, s in enumerate(table.symbol)]


@dataclass
class Buffers:
    """The contents of the bindings 0 to 4, and the length of 5."""
    data: bytearray = field(default_factory=lambda: bytearray(b"\xff"))  # units may begin at any byte
    lookups: list = field(default_factory=list)
    units: list = field(default_factory=list)
    streams: list = field(default_factory=list)
    tables: list = field(default_factory=list)
    integers: int = 0
    numbers: dict = field(default_factory=dict)  # of the tables in `lookups`, by those of the record

    def add_unit(self, coded, u):
        """Returns the location of the first integer, and the count of components, of each stream."""
        rows, n = coded.rows[u], count_of(coded.rows[u][0], coded.counts)
        planes = sum(row.planes() for row in rows)
        self.units += [len(self.data), len(coded.data[u]), rows[0].coder, n, len(self.tables), planes,
                       len(self.streams) // STREAM, len(rows)]
        self.data += coded.data[u]
        locations = []
        for row in rows:
            morton, components = row.prediction == MORTON, len(row.components())
            locations.append((self.integers, 3 if morton else components))
            self.streams += [self.integers, 4 if morton else components, row.prediction, row.low, coded.first_key,
                             len(row.bits), *row.bits, *[0] * (8 - len(row.bits))]
            self.integers += (4 if morton else components) * n
            self.tables += [self.number(t, coded.tables) for t in row.tables] or [0] * row.planes()
        return locations

    def number(self, t, tables):
        if t not in self.numbers:
            self.numbers[t] = len(self.numbers)
            self.lookups += lookup(tables[t])
        return self.numbers[t]


class Shader:
    """run_wgsl.mjs in a process of its own."""

    def __init__(self):
        node, module = shutil.which("node"), module_folder()
        if node is None or module is None:
            skip("no Node with the module webgpu (npm install -g webgpu)")
        environment = dict(os.environ)
        if os.path.exists(SWIFTSHADER):
            environment.setdefault("VK_ADD_DRIVER_FILES", SWIFTSHADER)
        self.messages = tempfile.TemporaryFile()
        self.process = subprocess.Popen(
            [node, os.path.join(HERE, "run_wgsl.mjs"), os.path.join(module, "index.js"),
             os.path.join(SPEC, "shaders/decode.wgsl")],
            env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.messages)
        self.adapter = self.process.stdout.readline().decode().strip()
        if not self.adapter:
            if self.process.wait() == SKIPPED:
                skip("WebGPU finds no adapter (install chromium-common, or Mesa 25)")
            self.fail()

    def fail(self):
        self.process.wait()
        self.messages.seek(0)
        sys.exit(f"run_wgsl.mjs exited with {self.process.returncode}: {self.messages.read().decode()}")

    def run(self, buffers):
        """Returns the contents of the bindings 5 and 6."""
        data = bytes(buffers.data) + bytes(-len(buffers.data) % 4)
        inputs = [data] + [little_endian(v) for v in (buffers.lookups, buffers.units, buffers.streams, buffers.tables)]
        lengths = [len(v) // 4 for v in inputs] + [buffers.integers, len(buffers.units) // 8]
        try:
            self.process.stdin.write(b"".join([little_endian(lengths), *inputs]))
            self.process.stdin.flush()
        except BrokenPipeError:
            self.fail()
        size = 4 * sum(lengths[5:])
        result = self.process.stdout.read(size)
        if len(result) < size:
            self.fail()
        words = struct.unpack(f"<{size // 4}I", result)
        return words[:lengths[5]], words[lengths[5]:]


def module_folder():
    folder = os.environ.get("STGS_WEBGPU")
    npm = shutil.which("npm")
    if folder is None and npm is not None:
        root = subprocess.run([npm, "root", "-g"], capture_output=True, text=True, check=False)
        folder = os.path.join(root.stdout.strip(), "webgpu")
    return folder if folder is not None and os.path.exists(os.path.join(folder, "index.js")) else None


def check(shader, coded, counts):
    """Yields a message for each mismatch, and counts what agrees."""
    buffers = Buffers()
    locations = [buffers.add_unit(coded, u) for u in range(len(coded.rows))]
    q, damage = shader.run(buffers)
    for u, rows in enumerate(coded.rows):
        wanted, n = expected(coded, u), count_of(rows[0], coded.counts)
        if (wanted is None) != (damage[u] != 0):
            verdict = "refuses" if wanted is None else "accepts"
            yield f"unit {u}: {damage[u]} from the shader; the reference {verdict} it"
        elif wanted is None:
            counts["refused units"] += 1
        else:
            for row, (at, components), integers in zip(rows, locations[u], wanted):
                found = [q[at + n * c:at + n * (c + 1)] for c in range(components)]
                if found == [tuple(v & 0xFFFFFFFF for v in component) for component in integers]:
                    counts[f"streams with prediction {row.prediction}"] += 1
                else:
                    yield f"attribute {row.attribute}: other integers"


def main():
    if len(sys.argv) != 1:
        sys.exit(__doc__)
    shader, rng, problems, vectors = Shader(), random.Random(1), [], 0
    intact, hurt = Counter(), Counter()
    folder = os.path.join(HERE, "vectors")
    for name in sorted(os.listdir(folder)):
        with open(os.path.join(folder, name), "rb") as file:
            records = [coded for coded in records_of(file.read()) if coded.rows]
        vectors += bool(records)
        for coded in records:
            problems += [f"{name}: {problem}" for problem in check(shader, coded, intact)]
            for _ in range(3):
                problems += [f"{name}, damaged: {problem}" for problem in check(shader, damaged(coded, rng), hurt)]
    for problem in problems:
        print(problem)
    for kind, counts in ("intact", intact), ("damaged", hurt):
        print(f"identical, {kind}: " + ", ".join(f"{counts[key]} {key}" for key in sorted(counts)))
    print(f"{vectors} vectors on {shader.adapter}: {len(problems)} problems")
    complete = vectors > 150 and hurt["refused units"] > 1000 and \
        all(intact[f"streams with prediction {p}"] > 0 for p in range(4))
    if not complete:
        print("too few vectors, refused units or predictions")
    sys.exit(0 if complete and not problems else 1)


if __name__ == "__main__":
    main()
