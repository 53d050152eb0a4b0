# SPDX-License-Identifier: Apache-2.0
"""Ends of primitives (5.9)."""
import struct

from vector_file import File, Meta, Run, Segment
from vector_growing import Fragment, growing
from vector_list import flipped, must_report, plain, vector
from vector_records import Body, number
from vector_scenes import coded_streams, float_streams, own_body

LAYER = 3 << 8
FLAG = 2
LAST = 2.0 ** 32


def numbers(*values):
    return b"".join(number(v) for v in values)


def one_list(part, place, tier, time, *skipped):
    return numbers(part, place, tier, time, len(skipped), *skipped)


def payload(*lists, level=-1, layer=LAYER, slot=0, count=None, after=b""):
    head = struct.pack("<hHI", level, layer, slot) + number(len(lists) if count is None else count)
    return head + b"".join(lists) + after


def ends_run(content, begin=10.0, part=1, end=LAST, layer=LAYER, **more):
    return Run([Segment(-1, 0, [], further=[(layer, content)], **more)], begin, end, part=part)


def primitives_run(n=6, tiers=1):
    bodies = [Body(float_streams(n, 0, 40 + i), n) for i in range(tiers)]
    return Run([Segment(-1, 0, bodies)])


def with_ends(*contents, flags=FLAG, runs=None, **more):
    """Returns a finished file with these records of ends, each in a part of its own."""
    runs = [primitives_run()] if runs is None else runs
    ends = [ends_run(c, part=1 + i, **more) for i, c in enumerate(contents)]
    return File([*runs, *ends], Meta(profile=0), flags=flags)


SOME = one_list(0, 0, 0, 3, 0, 1)  # primitives 0 and 2


def valid_ends():
    vector("ends", "5.9", "two primitives of a persistent segment end at tick 13", with_ends(payload(SOME)))
    vector("ends_flag", "2.1", "a file whose flag states ends and which has none", plain(flags=FLAG))
    vector("ends_growing", "5.9", "a later fragment ends primitives of the first one, another one ends more of them", growing(
        [Fragment([primitives_run()], frames=10), Fragment([ends_run(payload(SOME))], frames=20),
         Fragment([ends_run(payload(one_list(0, 0, 0, 0, 2, 0)), 7.0, 2)], frames=30)], flags=1 | FLAG))
    vector("ends_earliest", "5.9", "of several ends of a primitive the earliest counts, whatever the order", with_ends(
        payload(one_list(0, 0, 0, 3, 0, 0), one_list(0, 0, 0, 5, 1, 0)), payload(one_list(0, 0, 0, 1, 2))))
    quantised = Run([Segment(2, 1, [own_body(coded_streams(5, 0, 2), 5)])], 1.0, 31.0)
    vector("ends_level", "5.9", "primitives of a segment of level 2 and slot 1 in a part that begins at tick 1", File(
        [quantised, ends_run(payload(one_list(0, 32 + 3, 0, 9, 3)))], Meta(), flags=FLAG))
    vector("ends_tiers", "5.9", "primitives of two tiers", with_ends(
        payload(one_list(0, 0, 0, 0, 1), one_list(0, 0, 1, 0, 0, 3)), runs=[primitives_run(tiers=2)]))
    vector("ends_additions", "5.9", "additions after the lists", with_ends(payload(SOME, after=b"later")))
    vector("ends_part_fraction", "5.9", "the part of the ends begins between ticks", with_ends(payload(SOME), begin=10.5))
    vector("ends_unknown_primitive", "5.9", "ends of primitives that do not exist have no effect", with_ends(
        payload(one_list(0, 0, 0, 3, 5, 0))), validator=[319])
    vector("ends_unknown_tier", "5.9", "ends of a tier that does not exist have no effect", with_ends(
        payload(SOME, one_list(0, 0, 1, 3, 0))), validator=[319])
    vector("ends_unknown_part", "5.9", "ends of a part that does not exist have no effect", with_ends(
        payload(SOME, one_list(7, 0, 0, 3, 0))), validator=[319])
    greatest = one_list((1 << 32) - 1, (1 << 37) - 1, 255, (1 << 32) - 1, (1 << 32) - 1)
    vector("ends_greatest", "5.9", "the greatest numbers of a list", with_ends(payload(SOME, greatest)), validator=[319])
    vector("ends_last_layer", "5.9", "layer 1023 is one of content 3", with_ends(
        payload(SOME, layer=LAYER + 255), layer=LAYER + 255))
    vector("ends_too_short", "5.9", "the part of the ends ends before the scene", with_ends(payload(SOME), end=20.0),
           validator=[319])


def broken_ends():
    for name, about, content in (
            ("none", "no lists", payload()),
            ("empty_list", "a list of no primitives", payload(one_list(0, 0, 0, 3))),
            ("order", "lists out of order", payload(one_list(0, 0, 0, 4, 0), SOME)),
            ("twice", "two lists of one record and time", payload(SOME, one_list(0, 0, 0, 3, 4))),
            ("cut", "a list that is cut off", payload(SOME)[:-1]),
            ("count", "more lists than there are", payload(SOME, count=2)),
            ("cut_head", "a payload that ends within its first fields", payload(SOME)[:7]),
            ("many", "more primitives than bytes", payload(numbers(0, 0, 0, 3, 1 << 20) + bytes(8))),
            ("too_many", "2^20 + 1 ends", payload(numbers(0, 0, 0, 3, (1 << 20) + 1) + bytes(8))),
            ("part", "part 2^32", payload(one_list(1 << 32, 0, 0, 3, 0))),
            ("place", "slot 2^32", payload(one_list(0, 1 << 37, 0, 3, 0))),
            ("tier", "tier 256", payload(one_list(0, 0, 256, 3, 0))),
            ("time", "time 2^32", payload(one_list(0, 0, 0, 1 << 32, 0))),
            ("primitive", "primitive 2^32", payload(one_list(0, 0, 0, 3, 0, (1 << 32) - 1))),
            ("long_number", "a number of more bytes than it needs", payload(numbers(0, 0, 0, 3, 1) + b"\x80\0")),
            ("other_level", "another level", payload(SOME, level=0)), ("other_layer", "another layer", payload(SOME, layer=LAYER + 1)),
            ("other_slot", "another slot", payload(SOME, slot=1))):
        clause = "6.5" if name.startswith("other") or name == "cut_head" else "1.4" if name == "long_number" else "5.9"
        must_report(f"ends_{name}", "5.9", f"ends with {about}: primitives are displayed longer", with_ends(content),
                    clause_of=clause)
    must_report("ends_without_flag", "5.9", "ends in a file without the flag", with_ends(payload(SOME), flags=0))
    must_report("ends_tag", "5.9", "a record of ends with another tag", with_ends(payload(SOME), tag=b"PAGE"), clause_of="5.3")
    critical = Run([Segment(-1, 0, [], further=[(LAYER, payload(SOME))], flags=3)], 10.0, LAST, part=1)
    must_report("ends_flags", "5.9", "a record of ends with flags 3", File([primitives_run(), critical], Meta(profile=0),
                                                                          flags=FLAG), clause_of="3.4")
    data = with_ends(payload(SOME)).bytes()
    must_report("ends_damaged", "10.1", "a damaged record of ends", flipped(data, data.index(SOME)), clause_of="3.1")
    must_report("ends_truncated", "2.4", "a file that is truncated within a record of ends", data[:data.index(SOME)])
