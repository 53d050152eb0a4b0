# SPDX-License-Identifier: Apache-2.0
"""Clauses 5.2 to 5.6: nodes, their links, runs and segments. Times are integers here: those of parts
in units of 2^-20 ticks, those of segments in units of 2^-21 ticks."""
import math
from dataclasses import dataclass, field

from fields import RECORD, need, need_memory

UNIT = 2.0 ** 20


@dataclass
class Link:  # 5.2
    first: float
    last: float
    offset: int
    copy: int
    bytes: int


@dataclass
class Record:  # a SEGM record as the index lists it
    bytes: int    # of its payload
    layer: int
    n: int = 0    # primitives, for contents 0 and 1
    offset: int = 0


@dataclass
class Segment:  # 5.3
    level: int
    slot: int
    start: int    # of its interval (5.4), from the beginning of its part
    stop: int
    tiers: list   # records of content 0
    sh: list      # records of content 1, if `apart` is 1
    further: list


@dataclass
class Run:  # 5.3
    part: int
    begin: int
    end: int
    first: int    # of the interval in which the part is displayed
    last: int
    chunk: int
    segments: list = field(default_factory=list)


@dataclass
class Node:  # 5.2
    links: list
    runs: list

    def entries(self):  # conformance.md 1.5
        return len(self.links) + sum(1 + len(s.tiers) + len(s.further) for r in self.runs for s in r.segments)

    def records(self):
        return [r for run in self.runs for s in run.segments for r in s.tiers + s.sh + s.further]


class Entries:
    """Counts entries of the index; those beyond 1,024 take memory (conformance.md 1.5)."""

    def __init__(self, memory):
        self.count, self.memory = 0, memory

    def take(self, count=1):
        self.count += count
        need_memory(512 * (self.count - 1024), self.memory, f"{self.count} entries of the index")


def count_of(fields):
    """Reads a count of items of at least one byte each."""
    count = fields.number()
    need(count <= fields.left(), fields.clause, fields.issue, f"{count} items do not fit")
    return count


def read_links(fields, own, body, entries, growing):
    """Reads links of the record at `own`; `body` is the beginning and the end of the area in which
    records are."""
    links = []
    for _ in range(count_of(fields)):
        link = Link(fields.f64(), fields.f64(), fields.number(), fields.number(), fields.number())
        need(-math.inf < link.first <= link.last < math.inf, "5.2", 316, "the times of a link")
        places = [link.offset] if link.copy == 0 else [link.offset, link.copy]
        for at in places:
            need(body[0] <= at and at + RECORD + link.bytes <= body[1], "5.2", 316, f"a link to {at}")
        if growing:
            need(link.copy == 0, "9.3", 316, "a copy of a FRAG record")
        else:
            need(link.offset > own, "5.2", 316, f"a link from {own} back to {link.offset}")
        entries.take()
        links.append(link)
    return links


def read_node(fields, own, body, memory, growing=False):  # 5.2
    entries = Entries(memory)
    links = read_links(fields, own, body, entries, growing)
    return Node(links, [read_run(fields, body, entries) for _ in range(count_of(fields))])


def ticks(value, number):
    """Returns a time in units of 2^-20 ticks (5.3)."""
    need(abs(value) <= 2.0 ** 32 and math.fmod(value * UNIT, 1.0) == 0, "5.3", number, f"time {value}")
    return int(value * UNIT)


def read_run(fields, body, entries):  # 5.3
    part = fields.number()
    need(part < 1 << 32, "5.3", 300, f"part {part}")
    times = [fields.f64() for _ in range(4)]
    begin, end, first, last = [ticks(v, 311) for v in times]
    chunk = ticks(fields.f64(), 301)
    # begin < end follows from the next two.
    need(end - begin <= 2.0 ** 32 * UNIT, "5.3", 311, "the length of a part")
    need(max(begin, 0) <= first < last <= end, "5.3", 311, "the displayed interval of a part")
    need(chunk >= 1, "5.3", 301, f"a chunk of {chunk}")
    run = Run(part, begin, end, first, last, chunk)
    at, count = fields.number(), count_of(fields)
    need(at >= body[0], "5.3", 304, f"a run at {at}")
    need(count >= 1, "5.3", 300, "a run of no segments")
    last_slot, last_order = {}, None
    for _ in range(count):
        segment, at = read_segment(fields, run, last_slot, at, body[1], entries)
        # 5.6: by beginning; of two that begin together the longer first, a persistent one before all
        order = (segment.start, -math.inf if segment.level < 0 else -segment.level)
        need(last_order is None or last_order < order, "5.6", 303, "segments out of order")
        last_order = order
        run.segments.append(segment)
    return run


def read_segment(fields, run, last_slot, at, end, entries):  # 5.3
    place, shape = fields.number(), fields.number()
    entries.take()
    level, d = place % 32 - 1, place // 32
    slot = d + last_slot[level] + 1 if level in last_slot else d
    last_slot[level] = slot
    need(slot < 1 << 32 and (level >= 0 or slot == 0), "5.3", 302, f"slot {slot} of level {level}")
    start, stop = interval(level, slot, run.chunk, run.end - run.begin)
    need(start < stop, "5.4", 302, "a segment outside its part")
    tiers, more, apart = shape // 4, shape // 2 % 2, shape % 2
    need(tiers <= 256 and (tiers > 0 or (more, apart) == (1, 0)), "5.3", 300, f"a shape of {shape}")
    records = []  # in the order of the file (5.6)
    for i in range(tiers):
        n, size = fields.number(), fields.number()
        need(1 <= n < 1 << 32, "5.3", 305, f"a tier of {n} primitives")
        need(n <= size, "5.5", 305, f"{n} primitives in {size} bytes")
        records.append(Record(size, i, n))
        entries.take()
    for i in range(tiers * apart):
        records.append(Record(fields.number(), 256 + i, records[i].n))
    count = count_of(fields) if more else 0
    need(count >= 1 or not more, "5.3", 300, "no further records")
    layer = 511
    for _ in range(count):
        before, layer = layer, fields.number()
        need(before < layer <= 65535, "5.6", 303, f"a further record of layer {layer}")
        records.append(Record(fields.number(), layer))
        entries.take()
    for r in records:
        r.offset, at = at, at + RECORD + r.bytes
        need(at <= end, "5.3", 304, "a record outside the body")
    split = tiers + tiers * apart
    return Segment(level, slot, start, stop, records[:tiers], records[tiers:split], records[split:]), at


def interval(level, slot, chunk, length):
    """Returns the interval of a segment in units of 2^-21 ticks (5.4)."""
    if level < 0:
        return 0, 2 * length
    half = chunk << level  # H = C * 2^(level - 1)
    return slot * half, min(slot * half + 2 * half, 2 * length)


def may_be_needed(run, segment):
    """Returns whether a segment is needed at a time of some timeline (5.4)."""
    return max(run.begin * 2 + segment.start, 2 * run.first) <= min(2 * run.begin + segment.stop, 2 * run.last)


def needed(run, segment, frames):
    """Returns the first and the last time of the timeline at which a segment is needed, in units of
    2^-21 ticks, and whether the last one is such a time; None if it is never needed (5.4)."""
    first = max(2 * run.begin + segment.start, 2 * run.first)
    end = frames << 21
    last = min(2 * run.begin + segment.stop, 2 * run.last, end)
    closed = last < 2 * run.last or 2 * run.last >= end
    if first > last or (first == last and not closed):
        return None
    return first, last, closed
