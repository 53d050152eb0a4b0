# SPDX-License-Identifier: Apache-2.0
"""Clause 5.9: primitives that end before their lifespan does. Times are integers in units of 2^-20 ticks."""
from dataclasses import dataclass

from fields import Fields, Refused, check_available, need
from segment import open_record

MAX_ENDS = 1 << 20  # ends of a record
ISSUE = 319  # of whatever is wrong with a record of ends (conformance.md 2)


@dataclass
class List:  # 5.9
    part: int
    place: int
    tier: int
    time: int        # ticks from the beginning of the part of the ends
    primitives: list

    def key(self):
        return self.part, self.place, self.tier, self.time

    def numbers(self):
        return [*self.key(), len(self.primitives), *self.primitives]


@dataclass
class Ends:  # a record of content 3
    begin: int       # of its part
    lists: list


def is_ends(record):
    return record.layer // 256 == 3


def read_ends(file, run, segment, record):
    """Returns the Ends of a record."""
    try:
        need(file.flags & 2 == 2, "5.9", ISSUE, "ends in a file without flag 1")
        check_available(file.data, record.offset, record.bytes)
        f = open_record(file, segment, record)
        f.clause, f.issue = "5.9", ISSUE
        return Ends(run.begin, read_lists(f))
    except Refused as error:
        raise Refused(error.clause, ISSUE, str(error)) from None


def read_lists(f):
    count = f.number()
    need(count >= 1, "5.9", ISSUE, "no lists")
    lists, total = [], 0
    for _ in range(count):
        part, place, tier, time, n = [f.number() for _ in range(5)]
        need(part < 1 << 32 and place < 1 << 37 and tier < 256 and time < 1 << 32, "5.9", ISSUE, "a number out of range")
        total += n
        need(n >= 1 and total <= MAX_ENDS, "5.9", ISSUE, f"{n} ends")
        need(n <= f.left(), "5.9", ISSUE, f"{n} ends do not fit")
        primitives, after = [], -1
        for _ in range(n):
            after += f.number() + 1
            primitives.append(after)
        need(after < 1 << 32, "5.9", ISSUE, f"primitive {after}")
        lists.append(List(part, place, tier, time, primitives))
        need(len(lists) == 1 or lists[-2].key() < lists[-1].key(), "5.9", ISSUE, "lists out of order")
    return lists


def ends_of(file, run, segment, tier):
    """Returns {primitive: the earliest of its ends} of a record of content 0; times count from the
    beginning of the part."""
    key = run.part, 32 * segment.slot + segment.level + 1, tier
    out = {}
    for ends in file.ends:
        for one in ends.lists:
            if one.key()[:3] != key:
                continue
            time = ends.begin + (one.time << 20) - run.begin
            for primitive in one.primitives:
                if primitive < segment.tiers[tier].n:
                    out[primitive] = min(time, out.get(primitive, time))
    return out
