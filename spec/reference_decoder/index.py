# SPDX-License-Identifier: Apache-2.0
"""Clauses 5.2 to 5.6: the index in the payloads of INDX and FRAG."""
import math
from dataclasses import dataclass

from fields import RECORD, need


@dataclass
class Record:  # location of a SEGM record
    offset: int
    size: int


@dataclass
class Tier:
    """The primitives of one tier of a segment (5.3, 5.7)."""
    level: int
    slot: int
    number: int
    n: int
    base: Record
    sh: Record = None        # the record of content 1
    part: tuple = None       # begin and end of its part
    start: float = 0.0       # beginning of its interval (5.4), from the beginning of its part


def read_index(file, fields, at, end=None):  # 5.2
    chunk, stated = fields.f64(), fields.number()
    need_chunk(chunk, "5.2")
    need(file.chunk in (None, chunk), "5.12", "another chunk than the fragment before")
    file.chunk = chunk
    totals = fields.number()
    need(totals <= 1024, "5.2", f"{totals} attribute totals")
    for _ in range(totals):
        need(fields.number() <= 65535, "5.2", "an attribute above 65535")
        fields.number()
    first = len(file.tiers)
    for _ in range(count_of(fields, "5.2")):
        at = read_part(file, fields, chunk, at, file.end if end is None else end)
    file.body_at = at
    total = sum(tier.n for tier in file.tiers[first:])
    need(total == stated, "5.2", f"{total} primitives, not {stated}")


def need_chunk(chunk, clause):
    need(2.0 ** -20 <= chunk <= 2.0 ** 32 and math.fmod(chunk, 2.0 ** -20) == 0, clause,
         f"a chunk of {chunk} ticks")


def count_of(fields, clause):
    """Reads a count of items of at least one byte each."""
    count = fields.number()
    need(count <= fields.left(), clause, f"{count} do not fit")
    return count


def read_part(file, fields, chunk, at, body_end):  # 5.3
    begin, end = fields.f64(), fields.f64()
    skip, other, cut = (number := fields.number()) // 4, number // 2 % 2, number % 2
    first, last = (fields.f64(), fields.f64()) if cut else (max(begin, 0.0), end)
    if other:
        chunk = fields.f64()
        need_chunk(chunk, "5.3")
    for time in (begin, end, first, last):
        need(abs(time) <= 2.0 ** 32 and math.fmod(time, 2.0 ** -20) == 0, "5.3", f"time {time}")
    need(begin < end, "5.3", f"a part of [{begin}, {end})")
    need(end - begin <= 2.0 ** 32, "5.3", f"a part of {end - begin} ticks")
    need(not cut or max(begin, 0) <= first < last <= end, "5.3", f"[{first}, {last}) is displayed")
    at += skip
    need(at <= body_end, "5.3", "a skip beyond the body")
    file.entries += 1
    last_slot, last_order = {}, None
    for _ in range(count_of(fields, "5.3")):
        place, shape = fields.number(), fields.number()
        level, tiers, more, apart = place % 32 - 1, shape // 4, shape // 2 % 2, shape % 2
        slot = place // 32 + (last_slot[level] + 1 if level in last_slot else 0)
        last_slot[level] = slot
        need(slot < 1 << 32 and (level >= 0 or slot == 0), "5.3", f"slot {slot} of level {level}")
        need(tiers <= 256 and (tiers > 0 or (more, apart) == (1, 0)), "5.3", f"{tiers} tiers")
        start, stop = interval(level, slot, chunk, end - begin)
        need(start < stop, "5.4", "a segment outside its part")
        # 5.6: by beginning; of two that begin together the longer first, a persistent one before all
        order = (-math.inf, 0) if level < 0 else (start, -level)
        need(last_order is None or last_order < order, "5.6", "segments out of order")
        last_order = order
        counts, sizes = [], []
        for _ in range(tiers):
            counts.append(fields.number())
            sizes.append(fields.number())
            need(1 <= counts[-1] < 1 << 32, "5.3", f"{counts[-1]} primitives in a tier")
        extra = [fields.number() for _ in range(tiers)] if apart else []
        further = []
        count = count_of(fields, "5.3") if more else 0
        need(count > 0 or not more, "5.3", "no further records")
        for _ in range(count):
            layer = fields.number()
            need(512 <= layer <= 65535, "5.3", f"layer {layer} of a further record")
            further.append(fields.number())
        file.entries += tiers + len(further)
        records = []
        for size in sizes + extra + further:
            need(at + RECORD + size <= body_end, "5.3", "a record outside the body")
            records.append(Record(at, RECORD + size))
            at += RECORD + size
        for i, n in enumerate(counts):
            sh = records[tiers + i] if apart else None
            for r in [records[i]] + [sh] * apart:
                need(n <= 16 * r.size, "5.5", f"{n} primitives in {r.size} bytes")
            file.tiers.append(Tier(level, slot, i, n, records[i], sh, (begin, end), start))
    return at


def interval(level, slot, chunk, length):  # 5.4
    if level < 0:
        return 0.0, length
    half = math.ldexp(chunk, level - 1)
    return slot * half, min(slot * half + 2 * half, length)
