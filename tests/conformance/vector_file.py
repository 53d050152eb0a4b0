# SPDX-License-Identifier: Apache-2.0
"""Writes finished .stgs files (spec/stgs-format.md 2 to 5, 10.2) for make_vectors.py."""
import struct
from dataclasses import dataclass, field

from vector_records import checksum, number, record, text

MAGIC = b"\x89STG\r\n\x1a\n"


@dataclass
class Meta:  # 4.2
    time_base: tuple = (1, 30)
    frames: int = 30
    conventions: tuple = (0, 0, 0)      # kernel, axes, SH
    degree: int = 0
    profile: int = 1
    colour: tuple = (1, 13)
    background: tuple = (0.0, 0.0, 0.0)
    minimum: tuple = (-100.0, -100.0, -100.0)
    maximum: tuple = (100.0, 100.0, 100.0)
    near: float = 0.125
    size: tuple = (0, 0)
    rotation: tuple = (1, 0, 0, 0, 1, 0, 0, 0, 1)
    translation: tuple = (0, 0, 0)
    lens: tuple = (0, 0, 0, 0)
    generator: object = "vectors"
    title: object = ""
    metres: float = 0.0
    up: tuple = (0.0, 0.0, 0.0)
    floor: tuple = (0.0, 0.0, 0.0)
    audio: object = ""
    audio_begin: float = 0.0
    extra: bytes = b""

    def payload(self):
        return (struct.pack("<3I4BH2B", *self.time_base, self.frames, *self.conventions, self.degree,
                            self.profile, *self.colour) +
                struct.pack("<10f", *self.background, *self.minimum, *self.maximum, self.near) +
                struct.pack("<2I16f", *self.size, *self.rotation, *self.translation, *self.lens) +
                text(self.generator) + text(self.title) +
                struct.pack("<7f", self.metres, *self.up, *self.floor) + text(self.audio) +
                struct.pack("<d", self.audio_begin) + self.extra)


@dataclass
class Segment:  # 5.3
    level: int
    slot: int
    tiers: list                                      # Body each
    sh: list = field(default_factory=list)           # Body each; empty: no separate records
    further: list = field(default_factory=list)      # (layer, payload)
    counts: list = None                              # overrides the counts in the index
    layers: list = None                              # overrides the layers of further records in the index
    stated: tuple = None                             # overrides level and slot in the records
    flags: int = 1
    tag: bytes = b"SEGM"
    raw_place: int = None
    more: int = 0            # added to the bytes of the first record in the index

    def payloads(self):
        level, slot = self.stated or (self.level, self.slot)
        out = [b.payload(level, i, slot) for i, b in enumerate(self.tiers)]
        out += [b.payload(level, 256 + i, slot) for i, b in enumerate(self.sh)]
        return out + [payload for _, payload in self.further]

    def records(self):
        return b"".join(record(self.tag, payload, self.flags) for payload in self.payloads())

    def entry(self, last_slots):
        delta = self.slot - (last_slots[self.level] + 1 if self.level in last_slots else 0)
        last_slots[self.level] = self.slot
        sizes = [len(p) for p in self.payloads()]
        out = number(32 * delta + self.level + 1 if self.raw_place is None else self.raw_place)
        out += number(4 * len(self.tiers) + 2 * bool(self.further) + bool(self.sh))
        sizes[0] += self.more
        for n, size in zip(self.counts or [b.n for b in self.tiers], sizes):
            out += number(n) + number(size)
        at = len(self.tiers)
        for size in sizes[at:at + len(self.sh)]:
            out += number(size)
        if self.further:
            out += number(len(self.further))
            layers = self.layers or [layer for layer, _ in self.further]
            for layer, size in zip(layers, sizes[at + len(self.sh):]):
                out += number(layer) + number(size)
        return out


@dataclass(eq=False)
class Run:  # 5.3
    segments: list
    begin: float = 0.0
    end: float = 30.0
    cut: tuple = None       # the displayed interval
    chunk: float = 5.0
    part: int = 0
    shift: int = 0          # added to the offset
    raw: bytes = None       # replaces the count and the segments

    def displayed(self):
        return self.cut or (max(self.begin, 0.0), self.end)

    def entry(self, offset):
        out = number(self.part) + struct.pack("<5d", self.begin, self.end, *self.displayed(), self.chunk)
        last_slots = {}
        segments = number(len(self.segments)) + b"".join(s.entry(last_slots) for s in self.segments)
        return out + number(max(0, offset + self.shift)) + (segments if self.raw is None else self.raw)

    def records(self):
        return b"".join(s.records() for s in self.segments)

    def primitives(self):
        return sum(b.n for s in self.segments for b in s.tiers)


@dataclass(eq=False)
class Node:  # 5.2
    runs: list = field(default_factory=list)
    links: list = field(default_factory=list)
    extra: bytes = b""
    record: object = None    # replaces the PAGE record: a function of its payload

    def payload(self, where):
        out = number(len(self.links)) + b"".join(link.entry(where) for link in self.links)
        out += number(len(self.runs))
        return out + b"".join(r.entry(where.get(r, 0)) for r in self.runs) + self.extra

    def page(self, where):
        payload = self.payload(where)
        return self.record(payload) if self.record else record(b"PAGE", payload)

    def times(self):
        times = [v for r in self.runs for v in r.displayed()]
        times += [v for link in self.links for v in link.node.times()]
        return min(times, default=0.0), max(times, default=0.0)


@dataclass(eq=False)
class Link:  # 5.2
    node: Node
    times: tuple = None
    copied: bool = False
    offset: int = None
    copy: int = None
    bytes: int = None
    shift: int = 0          # added to the bytes
    to: Node = None         # overrides where the link leads to

    def entry(self, where):
        offset = where.get(self.to or self.node, 0) if self.offset is None else self.offset
        copy = where.get(("copy", self.node), 0) * self.copied if self.copy is None else self.copy
        size = len(self.node.page(where)) - 24 if self.bytes is None else self.bytes
        return struct.pack("<dd", *self.times or self.node.times()) + number(offset) + number(copy) + number(size + self.shift)


@dataclass(eq=False)
class PageCopy:
    """A copy of the PAGE record of a node, as an item of a body."""
    node: Node
    make: object = None      # a function of the payload that returns the record

    def page(self, where):
        return self.make(self.node.payload(where)) if self.make else self.node.page(where)


def body_of(node):
    """Returns the items of the body in the recommended order: each page before what it lists."""
    items = list(node.runs)
    for link in node.links:
        items += [] if link.to else [link.node] + body_of(link.node)
    return items


@dataclass
class File:
    root: object                      # Node, or a list of runs
    meta: Meta = field(default_factory=Meta)
    layouts: bytes = None             # payload of LAYT
    totals: tuple = ()
    total: int = None
    index: bytes = None               # replaces the payload of INDX
    index_extra: bytes = b""
    major: int = 2
    minor: int = 0
    flags: int = 0
    first_records: bytes = b""        # records of the head before META
    last_records: bytes = b""         # records of the head after INDX
    body: list = None                 # items: Run, Node (its page), PageCopy, or bytes
    tail: bytes = b""                 # records after all others, before COPY
    copy: object = None               # a function of the head that returns the COPY record
    record_flags: dict = field(default_factory=dict)
    order: tuple = (b"META", b"LAYT", b"INDX")
    file_bytes: int = 0               # added to the stated sizes
    head_bytes: int = 0

    def node(self):
        if not isinstance(self.root, Node):
            self.root = Node(self.root)
        return self.root

    def items(self):
        if self.body is None:
            self.body = body_of(self.node())
        return self.body

    def index_payload(self, where):  # 5.1
        total = sum(r.primitives() for r in self.items() if isinstance(r, Run))
        out = number(total if self.total is None else self.total) + number(len(self.totals))
        for attribute, size in self.totals:
            out += number(attribute) + number(size)
        return out + self.node().payload(where) + self.index_extra

    def head_records(self, where):
        payloads = {b"META": self.meta.payload(), b"LAYT": self.layouts,
                    b"INDX": self.index_payload(where) if self.index is None else self.index}
        out = self.first_records
        for tag in self.order:
            if payloads[tag] is not None:
                out += record(tag, payloads[tag], self.record_flags.get(tag, 1))
        return out + self.last_records

    def render(self, where):
        """Returns the file, if the offsets of its parts are those in `where`, and the offsets of this one."""
        records = self.head_records(where)
        at, found, body = 32 + len(records), {}, b""
        for item in self.items():
            found[("copy", item.node) if isinstance(item, PageCopy) else item] = at + len(body)
            if isinstance(item, bytes):
                body += item
            elif isinstance(item, Run):
                body += item.records()
            else:
                body += item.page(where)
        body += self.tail
        head = header(self.major, self.minor, self.flags, max(0, where.get("size", 0) + self.file_bytes),
                      at + self.head_bytes) + records
        body += self.copy(head) if self.copy else b""
        found["size"] = at + len(body)
        return head + body, found

    def bytes(self):
        where = {}
        for _ in range(20):  # numbers become longer as offsets grow
            data, found = self.render(where)
            if found == where:
                return data
            where = found
        raise ValueError("the offsets do not settle")


def header(major, minor, flags, file_bytes, head_bytes):  # 2.1
    out = MAGIC + struct.pack("<HHIQI", major, minor, flags, file_bytes, head_bytes)
    return out + struct.pack("<I", checksum(out))


def copy_record(head, flags=0, length=0):  # 10.2
    return record(b"COPY", head + struct.pack("<Q", len(head) + 8 + length), flags)
