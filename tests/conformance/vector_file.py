# SPDX-License-Identifier: Apache-2.0
"""Writes .stgs files field by field, valid or invalid, for make_vectors.py. It shares nothing with the
reference decoder. Clauses are those of spec/stgs-format.md."""
import struct
from dataclasses import dataclass, field

import xxhash

COMPONENTS = {1: 3, 2: 1, 3: 1, 4: 1, 5: 3, 6: 3, 7: 4, 8: 1, 9: 3, 10: 9, 11: 15, 12: 21}
STORED, RANS = 0, 1
VERSION = 1, 0


def checksum(data):
    return xxhash.xxh3_64_intdigest(bytes(data))


def number(v):  # 1.8
    out = bytearray()
    while v > 127:
        out.append(128 | v & 127)
        v >>= 7
    return bytes(out + bytes([v]))


def text(v):  # 1.4
    v = v if isinstance(v, bytes) else v.encode()
    return struct.pack("<I", len(v)) + v


def record(tag, payload, flags=1):  # 3.1
    head = tag + struct.pack("<IQQ", flags, len(payload), checksum(payload))
    return head + struct.pack("<Q", checksum(head)) + payload


def bits_of(value):
    return struct.unpack("<I", struct.pack("<f", value))[0]


@dataclass
class Meta:  # 4.2
    time_base: tuple = (1, 30)
    frames: int = 30
    conventions: tuple = (0, 0, 0, 0)
    profile: int = 1
    degree: int = 0
    minimum: tuple = (-100.0, -100.0, -100.0)
    maximum: tuple = (100.0, 100.0, 100.0)
    near: float = 0.125
    size: tuple = (0, 0)
    rotation: tuple = (1, 0, 0, 0, 1, 0, 0, 0, 1)
    lens: tuple = (0, 0, 0, 0)
    generator: object = "vectors"
    metres: float = 0.0
    up: tuple = (0.0, 0.0, 0.0)
    floor: tuple = (0.0, 0.0, 0.0)
    audio: object = ""
    audio_begin: float = 0.0
    extra: bytes = b""

    def payload(self):
        return (struct.pack("<3I4B2H", *self.time_base, self.frames, *self.conventions, self.profile,
                            self.degree) +
                struct.pack("<3f3f3ff", 0, 0, 0, *self.minimum, *self.maximum, self.near) +
                struct.pack("<2I9f3f4f", *self.size, *self.rotation, 0, 0, 0, *self.lens) +
                text(self.generator) + text("") +
                struct.pack("<7f", self.metres, *self.up, *self.floor) + text(self.audio) +
                struct.pack("<d", self.audio_begin) + self.extra)


# Annex A

def table_bytes(f):  # A.2; f: {symbol: frequency}
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
    f = {s: max(1, c * 4096 // total) for s, c in count.items()}
    top = max(sorted(f), key=lambda s: f[s])
    f[top] += 4096 - sum(f.values())
    return f


def group(planes, tables, n):  # A.3, A.8
    heads, body = b"", b""
    for first in range(0, n, 2048):
        m = min(2048, n - first)
        lanes = (m + 63) // 64
        x, words = [65536] * lanes, []
        for plane, f in reversed(list(zip(planes, tables))):
            start, total = {}, 0
            for s in sorted(f):
                start[s], total = total, total + f[s]
            for i in reversed(range(m)):
                s, lane = plane[first + i], i % lanes
                if x[lane] >= f[s] << 20:
                    words.append(x[lane] & 65535)
                    x[lane] >>= 16
                x[lane] = 4096 * (x[lane] // f[s]) + x[lane] % f[s] + start[s]
        heads += struct.pack("<I", len(words))
        body += struct.pack(f"<{lanes}I", *x) + struct.pack(f"<{len(words)}H", *reversed(words))
    return heads + body


def zstd_frame(planes, repeat=False, size=None):
    """Returns a frame of one block, raw or of a repeated byte, independent of any zstd version."""
    size = len(planes) if size is None else size
    block = len(planes) << 3 | (2 if repeat else 0) | 1
    return (struct.pack("<IBI", 0xFD2FB528, 0xA0, size) + struct.pack("<I", block)[:3] +
            (planes[:1] if repeat else planes))


# Clauses 6 and 7

@dataclass
class Stream:
    attribute: int
    mapping: int
    e: int
    v: list                      # values (7.4), one row per component of the planes
    prediction: int = 0
    coder: int = STORED
    bits: tuple = (8, 8, 8, 8)
    origin: tuple = ()
    zstd: str = ""               # "raw", "repeat"
    stored: bytes = None         # replaces the stored planes
    components: int = None
    tables: list = None          # table numbers of the layout, one per plane
    digits: list = None          # planes that replace the digits of v
    m: int = 1
    later: bytes = b""           # additional bytes after the fields of the row
    length: int = None           # overrides the length of the row

    def planes(self):
        if self.digits is not None:
            return self.digits
        out = []
        for row in self.v:
            shift = 0
            for b in self.bits:
                out.append(bytes(value >> shift & (1 << b) - 1 for value in row))
                shift += b
        return out

    def row(self):  # 6.3
        components = len(self.v) if self.components is None else self.components
        out = struct.pack("<H4BbBBB", self.attribute, components, self.mapping, self.prediction,
                          self.coder, self.e, self.m, len(self.bits), len(self.origin))
        out += bytes(self.bits) + struct.pack(f"<{len(self.origin)}f", *self.origin)
        if self.coder == RANS:
            out += struct.pack(f"<{len(self.tables)}H", *self.tables)
        out += self.later
        return struct.pack("<H", len(out) if self.length is None else self.length) + out[:self.length]


def layouts_payload(tables, layouts):  # 6.2
    out = struct.pack("<H", len(tables)) + b"".join(
        f if isinstance(f, bytes) else table_bytes(f) for f in tables)
    out += struct.pack("<H", len(layouts))
    for streams in layouts:
        out += bytes([len(streams)]) + b"".join(s.row() for s in streams)
    return out


@dataclass
class Body:
    """The payload of a SEGM record (6.1), without level, layer and slot."""
    streams: list
    n: int
    layout: int = 65535
    tables: list = field(default_factory=list)
    first_key: int = 0
    planes_sum: int = None
    group: bytes = None
    after: bytes = b""
    own_layouts: int = 1

    def payload(self, level, layer, slot):
        out = struct.pack("<hHIIH", level, layer, slot, self.n, self.layout)
        summed, coded, tables, stored = b"", [], [], []
        for s in self.streams:
            planes = s.planes()
            if s.coder == RANS:
                for plane, t in zip(planes, s.tables):
                    if len(self.tables[t]) > 1:
                        coded.append(plane)
                        tables.append(self.tables[t])
                        summed += plane
                continue
            joined = b"".join(planes)
            if s.attribute < 0x8000:
                summed += joined
            if s.stored is not None:
                stored.append(s.stored)
            else:
                stored.append(zstd_frame(joined, s.zstd == "repeat") if s.zstd else joined)
        out += struct.pack("<Q", checksum(summed) if self.planes_sum is None else self.planes_sum)
        if self.layout == 65535:
            out += layouts_payload(self.tables, [self.streams] * self.own_layouts)
        if any(s.prediction == 3 and s.attribute < 0x8000 for s in self.streams):
            out += struct.pack("<Q", self.first_key)
        out += b"".join(struct.pack("<Q", len(data)) for data in stored) + b"".join(stored)
        if any(s.coder == RANS for s in self.streams):
            out += group(coded, tables, self.n) if self.group is None else self.group
        return out + self.after


class Patched(Body):
    """A body with some of its bytes replaced."""

    def __init__(self, body, old, new):
        super().__init__(**vars(body))
        self.old, self.new = old, new

    def payload(self, level, layer, slot):
        return super().payload(level, layer, slot).replace(self.old, self.new, 1)


@dataclass
class Segment:  # 5.3
    level: int
    slot: int
    tiers: list                                      # Body each
    sh: list = field(default_factory=list)           # Body each; empty: no separate records
    further: list = field(default_factory=list)      # (layer, payload)
    counts: list = None                              # overrides the counts in the index
    stated: tuple = None                             # overrides level and slot in the records
    flags: int = 1
    raw_place: int = None

    def payloads(self):
        level, slot = self.stated or (self.level, self.slot)
        out = [b.payload(level, i, slot) for i, b in enumerate(self.tiers)]
        out += [b.payload(level, 256 + i, slot) for i, b in enumerate(self.sh)]
        return out + [payload for _, payload in self.further]

    def row(self, last_slots):
        delta = self.slot - (last_slots[self.level] + 1 if self.level in last_slots else 0)
        last_slots[self.level] = self.slot
        place = 32 * delta + self.level + 1 if self.raw_place is None else self.raw_place
        sizes = [len(p) for p in self.payloads()]
        out = number(place)
        out += number(4 * len(self.tiers) + 2 * bool(self.further) + bool(self.sh))
        counts = self.counts or [b.n for b in self.tiers]
        for n, size in zip(counts, sizes):
            out += number(n) + number(size)
        at = len(self.tiers)
        for size in sizes[at:at + len(self.sh)]:
            out += number(size)
        if self.further:
            out += number(len(self.further))
            for (layer, _), size in zip(self.further, sizes[at + len(self.sh):]):
                out += number(layer) + number(size)
        return out


@dataclass
class Part:
    segments: list
    begin: float = 0.0
    end: float = 30.0
    before: bytes = b""     # records between the previous part and this one
    after: bytes = b""      # records after those of this part
    skip: int = None        # overrides the skip in the index
    cut: tuple = None       # the displayed interval
    chunk: float = None     # overrides the file's chunk


@dataclass
class File:
    parts: list
    meta: Meta = field(default_factory=Meta)
    layouts: bytes = None             # payload of LAYT
    chunk: float = 5.0
    totals: tuple = ()
    total: int = None
    index_extra: bytes = b""
    major: int = VERSION[0]
    minor: int = VERSION[1]
    flags: int = 0
    first_records: bytes = b""        # records of the head before META
    last_records: bytes = b""         # records of the head after INDX
    tail: bytes = b""                 # records after the last segment
    record_flags: dict = field(default_factory=dict)
    order: tuple = (b"META", b"LAYT", b"INDX")
    index: bytes = None
    file_bytes: int = 0               # added to the stated sizes
    head_bytes: int = 0

    def index_payload(self):  # 5.2
        total = sum(b.n for p in self.parts for s in p.segments for b in s.tiers)
        out = struct.pack("<d", self.chunk) + number(total if self.total is None else self.total)
        out += number(len(self.totals))
        for attribute, size in self.totals:
            out += number(attribute) + number(size)
        out += number(len(self.parts))
        for p in self.parts:
            skip = len(p.before) if p.skip is None else p.skip
            out += struct.pack("<dd", p.begin, p.end) + number(4 * skip + 2 * (p.chunk is not None) + bool(p.cut))
            out += struct.pack("<dd", *p.cut) if p.cut else b""
            out += b"" if p.chunk is None else struct.pack("<d", p.chunk)
            out += number(len(p.segments))
            last_slots = {}
            out += b"".join(s.row(last_slots) for s in p.segments)
        return out + self.index_extra

    def body(self):
        return b"".join(p.before + b"".join(record(b"SEGM", payload, s.flags)
                                            for s in p.segments for payload in s.payloads()) +
                        p.after for p in self.parts) + self.tail

    def bytes(self):
        payloads = {b"META": self.meta.payload(), b"LAYT": self.layouts,
                    b"INDX": self.index_payload() if self.index is None else self.index}
        head = self.first_records
        for tag in self.order:
            if payloads[tag] is not None:
                head += record(tag, payloads[tag], self.record_flags.get(tag, 1))
        head += self.last_records
        body = self.body()
        out = b"\x89STG\r\n\x1a\n" + struct.pack(
            "<HHIQQ", self.major, self.minor, self.flags, 40 + len(head) + len(body) + self.file_bytes,
            40 + len(head) + self.head_bytes)
        return out + struct.pack("<Q", checksum(out)) + head + body
