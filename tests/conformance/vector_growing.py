# SPDX-License-Identifier: Apache-2.0
"""Writes growing files (spec/stgs-format.md 9) for the vectors."""
import struct
from dataclasses import dataclass, field

from vector_file import Meta, Node, header
from vector_records import number, record


@dataclass
class Fragment:
    """What a fragment adds, and fields of its FRAG record; None: the value that a writer would write."""
    runs: list
    before: bytes = b""      # records before those of the runs
    frames: int = None
    flags: int = 0
    offset: int = None
    bounds: tuple = (-10.0, -10.0, -10.0, 10.0, 10.0, 10.0)
    total: int = None
    head: bytes = None
    links: list = None       # overrides the links of the node: bytes each
    earlier: list = None     # overrides the earlier links: bytes each
    extra: bytes = b""
    length: int = 0          # added to the length at the end of the payload
    record_flags: int = 1


@dataclass
class Written:  # a FRAG record of the file
    at: int
    size: int
    first: float
    last: float

    def link(self, offset=None, size=None, times=None, copy=0):
        times = times or (self.first, self.last)
        return struct.pack("<dd", *times) + number(self.at if offset is None else offset) + number(copy) + \
            number(self.size if size is None else size)


@dataclass
class Recording:
    """A recording that is written fragment by fragment."""
    meta: Meta = field(default_factory=lambda: Meta(profile=0, frames=1))
    last_records: bytes = b""
    flags: int = 1
    file_bytes: int = 0
    out: bytes = b""
    head: bytes = b""
    links: list = field(default_factory=list)   # (number, Written) of fragments that no node links
    count: int = 0
    total: int = 0
    frames: int = 0

    def __post_init__(self):
        records = record(b"META", self.meta.payload()) + self.last_records
        self.head = header(2, 0, self.flags, self.file_bytes, 32 + len(records)) + records
        self.out = self.head
        self.offsets = []

    def add(self, fragment):
        where = {}
        self.out += fragment.before
        for run in fragment.runs:
            where[run] = len(self.out)
            self.out += run.records()
        self.count += 1
        size = 1
        while self.count % (16 * size) == 0:
            size *= 16
        # 9.3: the links since count - size belong to the node, the others are earlier links.
        inner = [w for number_of, w in self.links if number_of > self.count - size]
        outer = [(number_of, w) for number_of, w in self.links if number_of <= self.count - size]
        node = Node(fragment.runs).payload(where)[1:]
        inner_links = [w.link() for w in inner] if fragment.links is None else fragment.links
        earlier = [w.link() for _, w in outer] if fragment.earlier is None else fragment.earlier
        self.total += sum(run.primitives() for run in fragment.runs)
        self.frames = int(max([self.frames] + [run.displayed()[1] for run in fragment.runs]))
        at = len(self.out)
        head = self.head if fragment.head is None else fragment.head
        payload = struct.pack("<QII6f", at if fragment.offset is None else fragment.offset,
                              self.frames if fragment.frames is None else fragment.frames, fragment.flags,
                              *fragment.bounds)
        payload += number(self.total if fragment.total is None else fragment.total)
        payload += struct.pack("<I", len(head)) + head
        payload += number(len(earlier)) + b"".join(earlier)
        payload += number(len(inner_links)) + b"".join(inner_links) + node + fragment.extra
        payload += struct.pack("<Q", len(payload) + 8 + fragment.length)
        times = [v for run in fragment.runs for v in run.displayed()]
        times += [v for w in inner for v in (w.first, w.last)]
        written = Written(at, len(payload), min(times, default=0.0), max(times, default=0.0))
        self.links = outer + [(self.count, written)]
        self.offsets.append(at)
        self.out += record(b"FRAG", payload, fragment.record_flags)
        return written


def growing(fragments, tail=b"", **more):
    """Returns the bytes of a recording with these fragments."""
    return recording(fragments, **more).out + tail


def recording(fragments, **more):
    out = Recording(**more)
    for fragment in fragments:
        out.add(fragment)
    return out
