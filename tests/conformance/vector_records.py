# SPDX-License-Identifier: Apache-2.0
"""Writes SEGM records field by field, valid or invalid (spec/stgs-format.md 6 to 8), for make_vectors.py.
It shares nothing with the reference decoder."""
import struct
import zlib
from dataclasses import dataclass, field

COMPONENTS = {1: 3, 2: 1, 3: 1, 4: 1, 5: 3, 6: 3, 7: 4, 8: 1, 9: 3, 10: 1, 11: 9, 12: 15, 13: 21}
BYTES, RANS = 0, 1
MORTON = 3


def checksum(data):  # 1.5
    return zlib.crc32(bytes(data))


def number(v):  # 1.4
    out = bytearray()
    while v > 127:
        out.append(128 | v & 127)
        v >>= 7
    return bytes(out + bytes([v]))


def text(v):  # 1.4
    v = v if isinstance(v, bytes) else v.encode()
    return struct.pack("<I", len(v)) + v


def record(tag, payload, flags=1):  # 3.1
    head = tag + struct.pack("<IQI", flags, len(payload), checksum(payload))
    return head + struct.pack("<I", checksum(head)) + payload


def bits_of(value):
    return struct.unpack("<I", struct.pack("<f", value))[0]


def table_bytes(f):  # 7.2; f: {symbol: frequency}
    z, bits = max(f), []

    def put(value, count):
        bits.extend(value >> i & 1 for i in range(count))

    def golomb(value, k):
        shifted = value + (1 << k)
        u = shifted.bit_length() - 1 - k
        put(1 << u, u + 1)
        put(shifted, k + u)

    k, s, after = 9, 0, 0
    while s < z:
        golomb(f.get(s, 0) - after, k)
        if f.get(s, 0) > 0:
            k, s, after = f[s].bit_length() - 1, s + 1, 0
        else:
            run = next(i for i in range(s + 1, z + 1) if f.get(i, 0) > 0) - s - 1
            golomb(run, 0)
            s, after = s + 1 + run, 1
    bits += [0] * (-len(bits) % 8)
    return bytes([z]) + bytes(sum(bits[i + j] << j for j in range(8)) for i in range(0, len(bits), 8))


def table_for(planes):
    """Returns the frequencies of the symbols of some planes, by proportion and rounding."""
    count = {}
    for plane in planes:
        for symbol in plane:
            count[symbol] = count.get(symbol, 0) + 1
    total = sum(count.values())
    if total == 0:
        return {0: 4096}
    f = {s: max(1, c * 4096 // total) for s, c in count.items()}
    top = max(sorted(f), key=lambda s: f[s])
    f[top] += 4096 - sum(f.values())
    return f


def lanes_of(m):  # 7.1
    return 1 << max(0, (m - 1) // 256).bit_length()


def encode_block(planes, tables, lanes, early=None):
    """Returns the states and the words of a block (11.10). The lane `early` puts a word before its first symbol even
    if it need not, which leaves its state below 65536."""
    x, words = [65536] * lanes, []
    for plane, f in reversed(list(zip(planes, tables))):
        start, total = {}, 0
        for s in sorted(f):
            start[s], total = total, total + f[s]
        for i in reversed(range(len(plane))):
            s, lane = plane[i], i % lanes
            if x[lane] >= f[s] << 20 or (i == early and plane is planes[0]):
                words.append(x[lane] & 65535)
                x[lane] >>= 16
            x[lane] = 4096 * (x[lane] // f[s]) + x[lane] % f[s] + start[s]
    return x, list(reversed(words))


def group(planes, tables, n):  # 7.3
    counts, body = [], b""
    if not planes:
        return b""
    for first in range(0, n, 8192):
        m = min(8192, n - first)
        x, words = encode_block([plane[first:first + m] for plane in planes], tables, lanes_of(m))
        counts.append(len(words))
        body += struct.pack(f"<{len(x)}I{len(words)}H", *x, *words)
    return struct.pack(f"<{len(counts[:-1])}I", *counts[:-1]) + body


@dataclass
class Stream:
    attribute: int
    mapping: int
    e: int
    v: list                      # values (8.1), one row per component of the planes
    prediction: int = 0
    coder: int = BYTES
    bits: tuple = (8, 8, 8, 8)
    origin: tuple = ()
    joins: int = 0
    low: int = 0
    m: int = 1
    stored: bytes = None         # replaces the unit
    tables: list = None          # table numbers of the layout, one per plane
    digits: list = None          # planes that replace the digits of v
    later: bytes = b""           # additional bytes after the fields of the row
    length: int = None           # overrides the length of the row

    def component_bits(self, c):
        if self.prediction == MORTON and c > 0:
            return [8] * (self.low // 8) + [self.low % 8] * (self.low % 8 > 0)
        return self.bits

    def planes(self):
        if self.digits is not None:
            return self.digits
        out = []
        for c, row in enumerate(self.v):
            shift = 0
            for b in self.component_bits(c):
                out.append(bytes(value >> shift & (1 << b) - 1 for value in row))
                shift += b
        return out

    def row(self):  # 6.2
        out = struct.pack("<H4BbBBBB", self.attribute, self.mapping, self.prediction, self.coder, self.joins,
                          self.e, self.m, self.low, len(self.bits), len(self.origin))
        out += bytes(self.bits) + struct.pack(f"<{len(self.origin)}f", *self.origin)
        if self.coder == RANS:
            out += struct.pack(f"<{len(self.tables)}H", *self.tables)
        out += self.later
        return struct.pack("<H", len(out) if self.length is None else self.length) + out[:self.length]


def layouts_payload(tables, layouts):  # 6.1
    out = struct.pack("<H", len(tables)) + b"".join(
        f if isinstance(f, bytes) else table_bytes(f) for f in tables)
    out += struct.pack("<H", len(layouts))
    for streams in layouts:
        out += bytes([len(streams)]) + b"".join(s.row() for s in streams)
    return out


@dataclass
class Body:
    """The payload of a SEGM record (6.5), without level, layer and slot."""
    streams: list
    n: int
    layout: int = 65535
    tables: list = field(default_factory=list)
    first_key: int = 0
    degrees: list = None         # overrides n_1 to n_D
    after: bytes = b""
    own_layouts: int = 1
    sizes: dict = field(default_factory=dict)   # number of a unit: its stated size

    def units(self):
        units = []
        for s in self.streams:
            if s.joins and units and s.coder == units[-1][0].coder == RANS:
                units[-1].append(s)
            else:
                units.append([s])
        return [self.unit(streams) for streams in units]

    def unit(self, streams):
        if streams[0].stored is not None:
            return streams[0].stored
        if streams[0].coder != RANS:
            return b"".join(streams[0].planes())
        coded = [(plane, self.tables[t]) for s in streams for plane, t in zip(s.planes(), s.tables)
                 if len(self.tables[t]) > 1]
        planes = [plane for plane, _ in coded]
        return group(planes, [f for _, f in coded], len(planes[0]) if planes else 0)

    def payload(self, level, layer, slot):
        out = struct.pack("<hHIIH", level, layer, slot, self.n, self.layout)
        if self.layout == 65535:
            out += layouts_payload(self.tables, [self.streams] * self.own_layouts)
        sh = [s for s in self.streams if 11 <= s.attribute <= 13]
        if any(s.attribute == 10 for s in self.streams):
            degrees = [len(s.v[0]) for s in sh] if self.degrees is None else self.degrees
            out += struct.pack(f"<{len(degrees)}I", *degrees)
        if any(s.prediction == MORTON and s.attribute < 0x8000 for s in self.streams):
            out += struct.pack("<I", self.first_key)
        units = self.units()
        sizes = [self.sizes.get(i, len(unit)) for i, unit in enumerate(units)]
        out += struct.pack(f"<{len(sizes)}I", *sizes) + b"".join(units) + self.after
        return out + bytes(max(0, self.n - len(out)))  # 5.5


class Patched(Body):
    """A body with some of its bytes replaced."""

    def __init__(self, body, old, new):
        super().__init__(**vars(body))
        self.old, self.new = old, new

    def payload(self, level, layer, slot):
        out = super().payload(level, layer, slot)
        assert self.old in out
        return out.replace(self.old, self.new, 1)
