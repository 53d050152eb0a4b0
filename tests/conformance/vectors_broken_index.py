# SPDX-License-Identifier: Apache-2.0
"""Nodes and further records that break a rule (5)."""
import struct

from vector_file import File, Link, Meta, Node, Run, Segment, copy_record
from vector_list import flipped, further, must_fail, plain, vector
from vector_records import Body, number, record, text
from vector_scenes import float_streams
from vectors_index import SOUND, run_at, small, tree, with_copies

NAN, INFINITE = float("nan"), float("inf")


def broken_index():
    payloads()
    parts()
    segments()
    orders()
    shapes()
    links()
    broken_pages()
    further_records()
    validated()


def of(segments, **run):
    return File([Run(segments, **run)], Meta(profile=0))


def payloads():
    must_fail("index_empty", "5.1", "INDX of no bytes", plain(index=b""))
    good = plain()
    data = good.bytes()
    size = struct.unpack_from("<Q", data, data.index(b"INDX") + 8)[0]
    index = data[data.index(b"INDX") + 24:][:size]
    for cut in (1, 2, 3, 4, 12, 44, 45, 46, 47, 48, size - 1):
        must_fail(f"index_cut_at_{cut}", "5.1", f"the first {cut} bytes of INDX", plain(index=index[:cut]))
    for name, about, first in (("number_long", "0 in two bytes", b"\x80\x00"), ("number_longer", "1 in three bytes", b"\x81\x80\x00"),
                               ("number_of_65_bits", "2^64", b"\x80" * 9 + b"\x02"),
                               ("number_of_70_bits", "a number of 70 bits", b"\xff" * 9 + b"\x7f"),
                               ("number_of_11_bytes", "0 in eleven bytes", b"\x80" * 10 + b"\x00")):
        must_fail(name, "1.4", about, plain(index=first + index[1:]))
    vector("number_of_64_bits", "1.4", "bytes of an attribute: 2^64 - 1", plain(totals=((1, (1 << 64) - 1),)))
    must_fail("totals_1025", "5.1", "1025 attribute totals", plain(totals=((1, 1),) * 1025))
    must_fail("total_of_attribute_65536", "5.1", "an attribute beyond 16 bits", plain(totals=((65536, 1),)))
    for name, index in (("links", b"\0\0\x64\0"), ("runs", b"\0\0\0\x64")):
        must_fail(f"too_many_{name}", "5.1", f"100 {name} in no bytes", plain(index=index))
    must_fail("too_many_segments", "5.1", "a count of 2^60 segments", of([], raw=number(1 << 60)))


def parts():
    must_fail("part_of_33_bits", "5.3", "part 2^32", of([small()], part=1 << 32))
    for name, about, run in (
            ("inverted", "it ends before it begins", dict(begin=30.0, end=29.0, cut=(29.0, 30.0))),
            ("empty", "it ends when it begins", dict(begin=30.0, cut=(30.0, 30.0))),
            ("displayed_never", "displayed from 20 to 20", dict(cut=(20, 20))),
            ("displayed_backwards", "displayed from 20 to 10", dict(cut=(20, 10))),
            ("displayed_longer", "displayed until a time after its end", dict(cut=(0, 30 + 2.0 ** -20))),
            ("displayed_before_the_timeline", "displayed from a time below 0 on", dict(begin=-2, cut=(-(2.0 ** -20), 30))),
            ("displayed_earlier", "displayed before it begins", dict(begin=2, cut=(2 - 2.0 ** -20, 30))),
            ("begin_fine", "a beginning of 2^-21 ticks", dict(begin=2.0 ** -21, cut=(1, 30))),
            ("end_fine", "an end of 30 + 2^-21 ticks", dict(end=30 + 2.0 ** -21, cut=(0, 30))),
            ("from_fine", "displayed from 2^-21 on", dict(cut=(2.0 ** -21, 30))),
            ("to_fine", "displayed to 29 + 2^-21", dict(cut=(0, 29 + 2.0 ** -21))),
            ("far", "an end beyond 2^32", dict(begin=2.0 ** 31, end=2.0 ** 32 + 1, cut=(2.0 ** 31, 2.0 ** 32))),
            ("far_before", "a beginning before -2^32", dict(begin=-2.0 ** 32 - 1, end=-2.0 ** 31, cut=(0, 1))),
            ("nan", "a beginning that is not a number", dict(begin=NAN, cut=(0, 30))),
            ("infinite_begin", "an infinite beginning", dict(begin=-INFINITE, cut=(0, 30))),
            ("infinite", "an infinite end", dict(end=INFINITE, cut=(0, 30))),
            ("too_long", "a length of 2^32 + 2^-20 ticks", dict(begin=-2.0 ** 31 - 2.0 ** -20, end=2.0 ** 31))):
        must_fail(f"part_{name}", "5.3", about, of([small()], **run))
    for name, chunk in (("0", 0.0), ("below_0", -5.0), ("fine", 5 + 2.0 ** -21), ("of_2_to_minus_21", 2.0 ** -21),
                        ("long", 2.0 ** 32 + 1), ("infinite", INFINITE), ("nan", NAN)):
        must_fail(f"chunk_{name}", "5.3", f"a chunk of {chunk} ticks", of([small()], chunk=chunk))


def segments():
    must_fail("run_of_nothing", "5.3", "a run of no segments", of([]))
    must_fail("run_in_the_head", "5.3", "a run before the body", of([small()], shift=-1))
    good = of([small()])
    size = len(good.bytes())
    must_fail("run_beyond_the_end", "5.3", "a run that ends a byte after the file", of([small()], shift=1))
    must_fail("run_far_away", "5.3", "a run at 2^63", of([small()], shift=(1 << 63) - size))
    must_fail("slot_of_33_bits", "5.3", "slot 2^32", of([small(0, 0, raw_place=32 * (1 << 32) + 1)], end=2.0 ** 31,
                                                       chunk=2.0 ** -17))
    must_fail("slot_of_33_bits_after", "5.3", "slot 2^32 of the second segment", of(
        [small(0, (1 << 32) - 1), small(0, 1 << 32, stated=(0, 0))], end=2.0 ** 31, chunk=2.0 ** -17))
    must_fail("persistent_slot_1", "5.3", "slot 1 of level -1", of([small(-1, 0, raw_place=32)]))
    must_fail("persistent_twice", "5.3", "two persistent segments in a run", of([small(), small(-1, 1)]))
    must_fail("segment_after_its_part", "5.4", "it begins at the end of its part", of([small(0, 12)]))
    must_fail("segment_after_a_short_part", "5.4", "it begins after the end of its part", of([small(0, 8)], begin=10.0))
    must_fail("no_primitives", "5.3", "a tier of 0 primitives", of([small(counts=[0])]))
    payload = len(small().payloads()[0])
    must_fail("too_many_primitives", "5.5", "one more primitive than bytes", of([small(counts=[payload + 1])]))
    must_fail("other_primitives", "6.5", "the index lists as many primitives as bytes, the record fewer",
              of([small(counts=[payload])]))


def orders():
    for name, about, pair in (
            ("later_first", "a later segment first", [small(0, 2), small(1, 0)]),
            ("shorter_first", "of two that begin together, the lower level first", [small(0, 0), small(1, 0)]),
            ("level_before_persistent", "level 30 before the persistent one", [small(30, 0), small()]),
            ("level_0_before_persistent", "level 0 before the persistent one", [small(0, 0), small()])):
        must_fail(f"order_{name}", "5.6", about, of(pair))


def shapes():
    for name, about, segment in (
            ("of_nothing", "no tiers and no further records", b"\0\0"), ("sh_of_nothing", "no tiers, SH apart", b"\0\1"),
            ("sh_and_further", "no tiers, SH apart, a further record", b"\0\3\1" + number(512) + b"\0"),
            ("no_further_records", "a count of 0 further records", b"\0\2\0"),
            ("no_further_records_of_tiers", "a tier, a count of 0 further records", b"\0\6\1\x64\0"),
            ("tiers_257", "257 tiers", b"\0\x84\x08" + b"\1\1" * 257),
            ("tiers_257_and_further", "257 tiers, a further record", b"\0\x86\x08" + b"\1\1" * 257 + b"\1\x80\4\0")):
        run = Run([], raw=number(1) + segment)
        must_fail(f"shape_{name}", "5.3", about, File([run], Meta(profile=0), body=[run], file_bytes=100000), reports=False)
    for name, n in (("of_32_bits", (1 << 32) - 1), ("of_33_bits_in_bytes", 1 << 32)):
        run = Run([], raw=number(1) + b"\0\4" + number(n) + number(1 << 32))
        must_fail(f"primitives_{name}", "5.3", f"a tier of {n} primitives and 2^32 bytes in a truncated file", File(
            [run], Meta(profile=0), body=[run], file_bytes=1 << 33, total=0), {"max_primitives": 1 << 40, "max_memory": 1 << 50},
            reports=n < 1 << 32, clause_of="2.4" if n < 1 << 32 else "")


def links():
    for name, about, times in (("nan", "from is not a number", (NAN, 30.0)), ("nan_to", "to is not a number", (0.0, NAN)),
                               ("infinite", "from is infinite", (-INFINITE, 30.0)),
                               ("infinite_to", "to is infinite", (0.0, INFINITE)), ("backwards", "from is after to", (2.0, 1.0))):
        root, _ = tree()
        root.links[1].times = times
        must_fail(f"link_{name}", "5.2", about, File(root, Meta(profile=0)))
    for name, about, more in (("to_the_head", "an offset in the head", dict(offset=56)), ("beyond", "an offset after the file",
                              dict(offset=1 << 20)), ("far", "an offset of 2^64 - 1", dict(offset=(1 << 64) - 1)),
                              ("bytes", "more bytes than the file has", dict(bytes=1 << 20)),
                              ("copy_in_the_head", "a copy in the head", dict(copy=56)),
                              ("copy_beyond", "a copy after the file", dict(copy=1 << 20))):
        root, _ = tree()
        link = root.links[1]
        for key, value in more.items():
            setattr(link, key, value)
        must_fail(f"link_{name}", "5.2", about, File(root, Meta(profile=0)))
    good = File(tree()[0], Meta(profile=0)).bytes()
    root, _ = tree()
    root.links[1].offset = struct.unpack_from("<I", good, 24)[0] - 1
    must_fail("link_to_the_last_of_the_head", "5.2", "a link to the last byte of the head", File(root, Meta(profile=0)))
    root, _ = tree()
    root.links[1].bytes = len(good) - 23 - good.rindex(b"PAGE")
    must_fail("link_past_the_end", "5.2", "a link to a record that would end a byte after the file", File(root, Meta(profile=0)))


def broken_pages():
    for name, about, change in (
            ("back", "a page links to the one that links to it", lambda root, nodes: Link(Node(), (0, 30), bytes=70, to=nodes[0])),
            ("itself", "a page links to itself", lambda root, nodes: Link(Node(), (0, 30), bytes=70, to=nodes[1]))):
        root, nodes = tree()
        nodes[1].links.append(change(root, nodes))
        must_fail(f"page_links_{name}", "5.2", about, File(root, Meta(profile=0)))
    for name, about, make, clause in (
            ("tag", "a record PAGS", lambda p: record(b"PAGS", p), "5.2"), ("segment", "a SEGM record", lambda p: record(b"SEGM", p), "5.2"),
            ("flags_0", "flags 0", lambda p: record(b"PAGE", p, 0), "5.2"), ("flags_3", "flags 3", lambda p: record(b"PAGE", p, 3), "5.2"),
            ("long", "a byte more than the link states", lambda p: record(b"PAGE", p + b"\0"), "5.2")):
        root, nodes = tree()
        nodes[2].record = make
        if name == "long":
            root.links[1].shift = -1
        must_fail(f"page_{name}", clause, f"a link leads to {about}", File(root, Meta(profile=0)))
    root, nodes = tree()
    nodes[2].runs[0].part = 1 << 32
    must_fail("page_part", "5.3", "part 2^32 in a PAGE record: the others are read", File(root, Meta(profile=0)))
    root, nodes = tree()
    nodes[0].runs[0].cut = (5, 5)
    must_fail("page_of_pages", "5.3", "an error in a PAGE record that links to another: both are lost", File(root, Meta(profile=0)))
    root, nodes = tree()
    nodes[2].record = lambda p: record(b"PAGE", p[:-1])
    must_fail("page_cut", "5.2", "a PAGE record that ends too soon", File(root, Meta(profile=0)))
    # Copies of pages that differ in one thing from a usable one.
    for name, about, make in (("flags", "is not critical", lambda p: record(b"PAGE", p, 0)),
                              ("long", "has another byte", lambda p: record(b"PAGE", p + b"\0")),
                              ("tag", "has another tag", lambda p: record(b"PAGS", p))):
        root, nodes = tree(True)
        items = with_copies(root, nodes)
        items[-1].make = make
        data = File(root, Meta(profile=0), body=items, copy=copy_record).bytes()
        third = [i for i in range(len(data)) if data.startswith(b"PAGE", i)][2]
        must_fail(f"page_copy_{name}", "10.1", f"a page is damaged, and its copy {about}", flipped(data, third + 30),
                  clause_of="3.1")


def further_records():
    layer = 200 << 8
    for name, first, last in (("early", 5 - 2.0 ** -40, 9), ("late", 5, 10 + 2.0 ** -40), ("backwards", 8, 7), ("nan", NAN, 7),
                              ("nan_end", 6, NAN)):
        wrong = Segment(0, 2, [], further=[further(layer, first, last, level=0, slot=2)])
        must_fail(f"further_{name}", "5.7", f"times {first} to {last} in [5, 10]", File(
            [Run([wrong])], Meta(profile=0), last_records=SOUND))
    for name, about, layers in (("backwards", "layers 51201 and 51200", (layer + 1, layer)), ("twice", "layer 51200 twice",
                                (layer, layer))):
        wrong = small(further=[further(v, 0, 30) for v in layers])
        must_fail(f"further_layers_{name}", "5.6", about, File([Run([wrong])], Meta(profile=0), last_records=SOUND))
    for value in (0, 256, 511, 65536):
        wrong = small(further=[(value, b"")], layers=[value])
        must_fail(f"further_layer_{value}", "5.6", f"layer {value} among the further records", of([wrong]))
    for name, about, more in (("level", "another level", dict(level=1, slot=2)), ("slot", "another slot", dict(level=0, slot=1))):
        wrong = Segment(0, 2, [], further=[further(layer, 5, 9, **more)])
        must_fail(f"further_states_another_{name}", "6.5", about, File([Run([wrong])], Meta(profile=0), last_records=SOUND))
    wrong = Segment(-1, 0, [], further=[further(layer + 1, 5, 9)], layers=[layer])
    must_fail("further_states_another_layer", "6.5", "another layer", File([Run([wrong])], Meta(profile=0), last_records=SOUND))
    whole = further(layer, 5, 9)[1]
    for name, size in (("header", 7), ("times", 20), ("type", 25), ("type_text", 30)):
        wrong = Segment(-1, 0, [], further=[(layer, whole[:size])])
        must_fail(f"further_cut_in_{name}", "6.5" if size < 8 else "5.7", f"{size} bytes", File(
            [Run([wrong])], Meta(profile=0), last_records=SOUND))
    wrong = Segment(-1, 0, [], further=[(layer, whole[:24] + text(b"\xff"))])
    must_fail("further_type_not_utf8", "1.4", "a type of \\xff", File([Run([wrong])], Meta(profile=0), last_records=SOUND))
    for name, flags, clause in (("not_critical", 0, "3.3"), ("flags", 3, "3.4")):
        wrong = Segment(-1, 0, [], further=[further(layer, 5, 9)], flags=flags)
        must_fail(f"further_{name}", clause, f"a record with flags {flags}", File([Run([wrong])], Meta(profile=0), last_records=SOUND))
    must_fail("sh_of_degree_0", "5.5", "SH apart in a file of degree 0: the tier alone is refused", of(
        [Segment(-1, 0, [Body(float_streams(1, 0, 3), 1)], [Body([], 1)]), small(0, 0, span=5.0)]))


def validated():
    """Rules that a validator alone checks."""
    vector("place_twice", "5.3", "two runs have segments of one place", File(
        [run_at(0), run_at(0, seed=4)], Meta(profile=0)), validator=[318])
    runs = [run_at(0), run_at(0, part=1)]
    vector("records_overlap", "5.3", "two segments share a record", File(Node(runs), Meta(profile=0), body=[runs[0], runs[1]]))
    vector("part_of_two_forms", "5.3", "two runs of one part state different ends", File(
        [run_at(0), Run([small(0, 0, span=5.0)], 0, 20)], Meta(profile=0)), validator=[311])
    root, _ = tree()
    root.links[1].times = (0.0, 1.0)
    vector("link_too_short", "5.2", "a link does not contain the times of its node", File(root, Meta(profile=0)), validator=[316])
    for tag in (b"NEWS", b"FRAG", b"IMPO", b"PAGE", b"META"):
        vector(f"critical_{tag.decode().lower()}_in_the_body", "3.4", "a critical record after the segments",
               plain(tail=record(tag, bytes(12))), validator=[] if tag == b"PAGE" else [113])
    names = Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)], further=[further(200 << 8, 0, 30)])
    vector("private_content_unnamed", "3.5", "content 200 without PRIV", File([Run([names])], Meta(profile=0)), validator=[117])
    vector("private_profile_unnamed", "3.5", "profile 0xC001 without PRIV", plain(meta=Meta(profile=0xC001)), validator=[117])
    vector("private_record_unnamed", "3.5", "a private record without a name",
           plain(last_records=record(b"liGT", b"\0\0\0\0", 0)), validator=[117])
    vector("near_lossless_without_bounds", "11.1", "profile 3 without ERRB", plain(meta=Meta(profile=3)), validator=[207])
    late = float_streams(1, 0, 3, 20, 5)
    vector("visible_outside_its_segment", "5.8", "a primitive of time 22.5 in [0, 5)", of([Segment(0, 0, [Body(late, 1)])]),
           validator=[504])
