# SPDX-License-Identifier: Apache-2.0
"""Files with several errors: which one counts (conformance.md 1.5, 1.8). Nodes that overlap."""
import struct

from vector_file import File, Link, Meta, Node, PageCopy, Run, Segment, copy_record
from vector_list import flipped, further, must_fail, must_report, plain, private, replaced, separate_sh, vector
from vector_records import RANS, Body, Stream, bits_of, record
from vector_scenes import coded_streams, float_streams, own_body
from vectors_broken_records import with_segment
from vectors_index import tree, with_copies

ORDER = "conformance 1.8"
LIMIT = "conformance 1.5"


def orders():
    headers()
    records()
    streams()
    limits()
    links()
    overlapping()


def headers():
    for name, about, clause, more in (
            ("version_and_flags", "version 3, and an unknown flag", "2.2", dict(major=3, flags=4)),
            ("version_and_sizes", "version 3, and head_bytes too large", "2.2", dict(major=3, head_bytes=1 << 20)),
            ("flags_and_sizes", "an unknown flag, and head_bytes too large", "2.2", dict(flags=4, head_bytes=1 << 20))):
        must_fail(f"order_{name}", ORDER, about, plain(**more), clause_of=clause)
    must_fail("order_checksum_and_version", ORDER, "version 3, and a wrong checksum of the header", flipped(
        plain(major=3).bytes(), 13), clause_of="2.1")
    must_fail("order_damage_and_tag", ORDER, "an unknown critical record before META, which is damaged", flipped(plain(
        first_records=record(b"NEWS", bytes(9))).bytes(), 32 + 33 + 30), clause_of="3.1")
    must_fail("order_damaged_aside", ORDER, "a record that is not critical is damaged, META is too short: the file is refused, "
              "and nothing is reported", flipped(plain(first_records=record(b"NOTE", b"hello", 0), meta=Short(
                  profile=0)).bytes(), 32 + 24), clause_of="4.2")


class Short(Meta):
    def payload(self):
        return super().payload()[:-1]


def records():
    """A SEGM record with two errors."""
    for name, about, clause, more, at in (
            ("tag_and_flags", "another tag, and flags 0", "5.3", dict(tag=b"SEGN", flags=0), None),
            ("tag_and_payload", "another tag, and a damaged payload", "5.3", dict(tag=b"SEGN"), 50),
            ("flags_0_and_payload", "flags 0, and a damaged payload", "3.3", dict(flags=0), 50),
            ("flags_3_and_payload", "flags 3, and a damaged payload", "3.4", dict(flags=3), 50),
            ("level_and_payload", "another level, and a damaged payload", "3.1", dict(stated=(0, 0)), 50),
            ("tag_and_header", "another tag, and a damaged header", "3.1", dict(tag=b"SEGN"), 9),
            ("longer_and_tag", "a byte more than the index lists, and another tag", "3.2", dict(more=-1, tag=b"SEGN"), None),
            ("longer_and_header", "a byte more than the index lists, and a damaged header", "3.1", dict(more=-1), 9)):
        data = with_segment(**more).bytes()
        if at is not None:
            data = flipped(data, data.index(more.get("tag", b"SEGM")) + at)
        must_fail(f"order_{name}", ORDER, about, data, clause_of=clause)
    short = with_segment(more=1, flags=0)
    short.tail = b"\0"
    must_fail("order_shorter_and_flags", ORDER, "a byte less than the index lists, and flags 0", short, clause_of="5.3")
    for name, about, more, at in (("tag", "another tag", dict(tag=b"SEGN"), None), ("header", "a damaged header", {}, 9)):
        data = with_segment(**more).bytes()
        if at is not None:
            data = flipped(data, data.index(b"SEGM") + at)
        must_fail(f"order_cut_and_{name}", ORDER, f"the file ends a byte before the record, which has {about}", data[:-1],
                  reports=True, clause_of="2.4")
    cut = with_segment(more=1)
    cut.file_bytes = 1
    must_fail("order_cut_after_the_record", ORDER, "the file ends a byte before what the index lists, but with the record", cut,
              reports=True, clause_of="2.4")
    for name, about, make, at, clause in (
            ("flags", "flags 0, and a damaged payload", lambda p: record(b"PAGE", p, 0), 40, "5.2"),
            ("tag", "another tag, and a damaged payload", lambda p: record(b"PAGS", p), 40, "5.2"),
            ("header", "another tag, and a damaged header", lambda p: record(b"PAGS", p), 9, "3.1")):
        root, nodes = tree()
        nodes[2].record = make
        data = File(root, Meta(profile=0)).bytes()
        tag = make(b"")[:4]
        must_fail(f"order_page_{name}", ORDER, f"a PAGE record with {about}", flipped(data, data.rindex(tag) + at),
                  clause_of=clause)
    root, nodes = tree()
    nodes[2].runs = []
    nodes[2].record = lambda p: record(b"PAGS", p)
    must_fail("order_page_cut_and_tag", ORDER, "the file ends within a PAGE record of another tag", File(
        root, Meta(profile=0)).bytes()[:-1], reports=True, clause_of="2.4")


def streams():
    """Contents of a SEGM record with two errors."""
    wide, nan = [[0, 1 << 24, 0]], bits_of(float("nan"))
    for name, about, clause, edit in (
            ("unit_and_integer", "an integer of 25 bits, then a unit of another size", "6.4",
             lambda s: (put(s, 7, mapping=1, e=-24, v=wide), put(s, 8, stored=b"?"))),
            ("value_and_integer", "a value that is not a number, then an integer of 25 bits", "8.5",
             lambda s: (first_value(s, 5, nan), put(s, 7, mapping=1, e=-24, v=wide))),
            ("sigma_and_value", "sigma is 0, then a value is not a number", "6.3",
             lambda s: (first_value(s, 2, 0), first_value(s, 8, nan))),
            ("row_and_attributes", "no position; the row of opacity has e = 21", "8.5",
             lambda s: (s.pop(0), put(s, 6, e=21))),
            ("attributes_and_profile", "no position; opacity has a mapping", "6.3",
             lambda s: (s.pop(0), put(s, 6, mapping=1, e=-1))),
            ("profile_and_units", "opacity has a mapping; a unit is longer than the record", "11.1",
             lambda s: put(s, 7, mapping=1, e=-1, stored=bytes(4000)))):
        made = float_streams(3, 0, 1)
        edit(made)
        body = Body(made, 3, sizes={7: 1 << 20} if name == "profile_and_units" else {})
        meta = Meta(profile=0 if "profile" in name else 1)
        must_fail(f"order_{name}", ORDER, about, plain(body=body, meta=meta), clause_of=clause)
    for name, about, clause, m, first in (
            ("row_and_table", "a row with m = 2, and a table that no plane uses", "8.5", 2, 0),
            ("table_and_attributes", "a table that no plane uses, and no position", "6.1", 1, 1)):
        made = float_streams(3, 0, 1)
        made[7] = Stream(8, 1, 0, [[0, 1, 2]], 0, RANS, (2,), m=m)
        must_fail(f"order_{name}", ORDER, about, plain(body=own_body(made[first:], 3, more_tables=1), meta=Meta()),
                  clause_of=clause)
    exact_integers()


def exact_integers():
    exact = Stream(8, 1, -24, [[0, 0x01010101, 0]], m=255)
    must_fail("multiplied_modulo", "8.5", "255 * 16843009 = 2^32 - 1: the product is exact, not modulo 2^32", replaced(exact))
    must_fail("first_key_wraps", "8.4", "a first key of 2^32 - 5 and a difference of 5", replaced(
        Stream(1, 1, 0, [[5, 0, 1]], 3, bits=(8, 8, 8, 8)), first_key=(1 << 32) - 5))
    for name, about, origin in (("minus_0", "0, -0 and 0", (0.0, -0.0, 0.0)), ("one_0", "0 alone", (0.0,)),
                                ("one_minus_0", "-0 alone", (-0.0,))):
        scale = Stream(6, 1, -3, [[1, 2, 3]] * 3, origin=origin)
        vector(f"shaped_with_origin_{name}", "8.8", f"mapping 6 with log-scales of an origin of {about}",
               replaced(Stream(7, 6, -9, [[1, 2, 3]] * 3), scale))
    joined = coded_streams(6, 0, 7)
    joined.insert(2, Stream(0x8001, 0, 0, [[]], stored=b"any", joins=1))
    vector("optional_joins", "6.2", "a row of an optional attribute whose joins is 1: a unit of its own",
           plain(body=AsIs(own_body(joined, 6)), meta=Meta()))


class AsIs(Body):
    """A body whose rows of bytes are units of their own, whatever their joins."""

    def __init__(self, body):
        super().__init__(**vars(body))

    def units(self):
        return [self.unit([s]) for s in self.streams]


def put(streams, i, **fields):
    for name, value in fields.items():
        setattr(streams[i], name, value)


def first_value(streams, i, bits):
    streams[i].v[0][0] = bits


def limits():
    """Errors of a part that exceeds a limit."""
    good = plain().bytes()
    size = 24 + len(plain().root[0].segments[0].payloads()[0])
    damaged = flipped(good, good.index(b"SEGM") + 9)
    for name, about, data, more in (("header", "a damaged header", damaged, {}), ("end", "a record that is cut off", good[:-1],
                                                                                 dict(reports=True))):
        must_fail(f"order_limit_and_{name}", ORDER, f"a tier of more floats and bytes than the limit, and {about}", data,
                  {"max_memory": 240 + size - 1}, clause_of=LIMIT if name == "header" else "2.4", **more)
    must_fail("order_end_and_floats", ORDER, "a record that is cut off, of more floats than the limit", plain(90).bytes()[:-1],
              {"max_memory": 7199}, clause_of="2.4", reports=True)
    must_fail("order_header_and_planes", ORDER, "a damaged header; the floats and bytes of the tier are at the limit", damaged,
              {"max_memory": 240 + size}, clause_of="3.1")
    rest = File([Run([separate_sh(9)])], Meta(profile=0, degree=1)).bytes()
    sizes = [24 + struct.unpack_from("<Q", rest, i + 8)[0] for i in range(len(rest)) if rest.startswith(b"SEGM", i)]
    must_fail("order_limit_and_sh", ORDER, "a record of content 1 with a damaged header exceeds the limit", flipped(
        rest, rest.rindex(b"SEGM") + 9), {"max_memory": 9 * (4 * 29 + 80) + sum(sizes) - 1}, clause_of=LIMIT)
    must_fail("order_sh_cut", ORDER, "a record of content 1 that is cut off exceeds the limit", rest[:-1],
              {"max_memory": 9 * (4 * 29 + 80) + sum(sizes) - 1}, clause_of="2.4", reports=True)
    streams = float_streams(3, 0, 1)
    streams[7].stored = bytes(11)
    made = plain(body=Body(streams, 3))
    planes = 240 + 24 + len(made.root[0].segments[0].payloads()[0]) + 240
    must_fail("order_planes_and_unit", ORDER, "more planes than the limit, a unit of another size", made,
              {"max_memory": planes - 1}, clause_of=LIMIT)
    made = plain(body=Body(streams, 3, sizes={8: 1 << 20}))
    must_fail("order_units_and_planes", ORDER, "a unit is longer than the record, more planes than the limit", made,
              {"max_memory": planes - 1}, clause_of="6.5")
    entries()
    further_and_importance()
    long_note = record(b"NOTE", bytes(600), 0)
    copied = plain(n=1, copy=copy_record, last_records=long_note).bytes()
    head = struct.unpack_from("<I", copied, 24)[0]
    for name, about, data in (("head_and_damage", "a head with a damaged record, without a copy", flipped(
            plain(n=1, last_records=long_note).bytes(), 60)), ("copy_and_damage", "a damaged head, whose copy is damaged", flipped(
                flipped(copied, 3), copied.index(b"COPY") + 40))):
        must_fail(f"order_limit_of_{name}", ORDER, f"{about}, more than the limit", data, {"max_memory": head - 1},
                  clause_of=LIMIT)
    must_fail("order_head_missing", ORDER, "a head that is cut off, and more than the limit", copied[:head - 1],
              {"max_memory": head - 1}, clause_of="2.4")
    must_fail("order_total_and_node", ORDER, "INDX states more primitives than the limit, and ends too soon",
              plain(index=b"\x04\0\0"), {"max_primitives": 3}, clause_of=LIMIT)


def entries():
    """PAGE records that are cut off after entries that take memory."""
    run = Run([Segment(level, 0, [Body(float_streams(1, 0, 1), 1)], further=[(512 + j, b"") for j in range(count)])
               for level, count in ((-1, 560), (0, 562))])
    for kind, about, node, beyond in (
            ("links", "1,100 links", Node([], [Link(Node(), (0.0, 1.0), offset=2000, bytes=0, to=Node())] * 1100), 76),
            ("segments", "2 segments, 2 tiers and 1,121 further records", Node([run]), 101)):
        node.record = lambda payload: record(b"PAGE", payload[:-1])
        data = File(Node([], [Link(node, (0.0, 1.0))]), Meta(profile=0), total=0).bytes()
        for name, limit, clause in (("_kept", 512 * beyond, "5.2"), ("", 512 * beyond - 1, LIMIT)):
            must_fail(f"order_of_{kind}{name}", ORDER, f"a PAGE record is cut off after {about}, limit {limit}", data,
                      {"max_memory": limit}, clause_of=clause)


def further_and_importance():
    layer, sound = 200 << 8, private((2, 200, "org.example.sound"))

    def of(flip):
        held = Segment(-1, 0, [Body(float_streams(1, 0, 3), 1)], further=[further(layer, 0, 30, data=bytes(2000))])
        data = File([Run([held])], Meta(profile=0), last_records=sound).bytes()
        return (flipped(data, data.rindex(b"SEGM") + 9) if flip else data), len(held.further[0][1])

    data, size = of(False)
    vector("limit_of_further_kept", LIMIT, "a further record, at the limit", data, {"max_memory": size})
    must_fail("limit_of_further", LIMIT, "a further record, more than the limit", data, {"max_memory": size - 1})
    must_fail("order_limit_and_further", ORDER, "a further record with a damaged header, more than the limit", of(True)[0],
              {"max_memory": size - 1}, clause_of=LIMIT)
    must_fail("order_further_cut", ORDER, "a further record that is cut off, more than the limit", data[:-1],
              {"max_memory": size - 1}, clause_of="2.4", reports=True)
    ones = record(b"IMPO", struct.pack("<100f", *[1] * 100), 0)
    made = plain(100, tail=ones).bytes()
    for name, about, data, limit, clause in (
            ("limit_of_importance_kept", "IMPO, at the limit", made, 400, LIMIT),
            ("limit_of_importance", "IMPO, more than the limit", made, 399, LIMIT),
            ("order_limit_and_importance", "IMPO with a damaged payload, more than the limit", flipped(made, len(made) - 1), 399,
             LIMIT),
            ("order_importance_cut", "IMPO that is cut off, of more bytes than the limit", made[:-1], 399, "2.4"),
            ("order_importance_header", "IMPO with a damaged header, more than the limit", flipped(made, len(made) - 415), 799,
             "3.1")):
        must_fail(name, LIMIT if name.startswith("limit") else ORDER, f"{about}; the tier exceeds it", data,
                  {"max_memory": limit}, clause_of=clause, reports=clause == "2.4")


def links():
    root, nodes = tree(True)
    items = [PageCopy(node) for node in nodes] + [i for i in with_copies(root, nodes) if not isinstance(i, PageCopy)]
    data = File(root, Meta(profile=0), body=items).bytes()
    pages = [i for i in range(len(data)) if data.startswith(b"PAGE", i)]
    vector("page_copies_first", "5.2", "copies of pages before the pages that link to them", data)
    must_report("page_copies_first_used", "5.2", "a damaged page, whose copy is before the page that links to it",
                flipped(data, pages[4] + 40))
    must_report("page_copies_used", "5.2", "two damaged pages: each is reported", flipped(flipped(data, pages[4] + 40),
                                                                                      pages[5] + 40))
    for name, about, at in (("past_the_end", "would end a byte after the file", lambda size, page: size - 23 - page),
                            ("header_past_the_end", "has a header that would end a byte after the file", lambda size, _: size - 23),
                            ("at_the_end", "would begin at the end of the file", lambda size, _: size)):
        root, nodes = tree()
        size = len(File(tree()[0], Meta(profile=0)).bytes())
        link = root.links[1]
        for _ in range(3):  # the number of the offset becomes longer
            link.copy = at(size, len(nodes[2].payload({})))
            size = len(File(root, Meta(profile=0)).bytes())
        must_fail(f"link_copy_{name}", "5.2", f"a copy that {about}", File(root, Meta(profile=0)))


def shared_record(more):
    """Returns a file of two parts whose segments are one record. Its payload, counted twice, has as many bytes as the
    file, or one more than it if `more` is -1."""
    runs = [Run([Segment(-1, 0, [Body(float_streams(40, 0, 3), 40)])], part=part) for part in range(2)]
    pad = at = 0
    for _ in range(4):
        runs[1].shift = at
        data = File(Node(runs), Meta(profile=0), body=[runs[0], record(b"NOTE", bytes(pad), 0)], total=80).bytes()
        at = data.index(b"SEGM")
        size = struct.unpack_from("<Q", data, at + 8)[0]
        pad += 2 * size + more - len(data)
    return data


def shared_copy(more):
    """Returns a truncated file whose four links lead to PAGE records that are not completely there. They have one copy, and
    four times its payload are as many bytes as are there, or one more than these if `more` is -1."""
    page = record(b"PAGE", b"\0\0" + bytes(600))
    size, pad, head = len(page) - 24, 0, 0
    end = 0
    for _ in range(5):
        links = [Link(Node(), (0.0, 1.0), offset=max(0, end - len(page) + 1) + i, copy=head, bytes=size) for i in range(4)]
        data = File(Node([], links), Meta(profile=0), body=[page, record(b"NOTE", bytes(pad), 0)], file_bytes=1000).bytes()
        head, end = struct.unpack_from("<I", data, 24)[0], len(data)
        pad += 4 * size + more - len(data)
    return data


def overlapping():
    """PAGE records within one another (1.5)."""
    inner = record(b"PAGE", b"\0\0" + bytes(600))
    middle = record(b"PAGE", b"\0\0" + inner)
    outer = record(b"PAGE", b"\0\0" + middle)
    sizes = [len(r) - 24 for r in (outer, middle, inner)]

    def of(pad):
        body = record(b"NOTE", bytes(pad), 0) + outer
        head = 0
        for _ in range(3):
            root = Node([], [Link(Node(), (0.0, 1.0), offset=head + 24 + pad + 26 * i, bytes=size) for i, size in enumerate(sizes)])
            data = File(root, Meta(profile=0), body=[body]).bytes()
            head = struct.unpack_from("<I", data, 24)[0]
        return data

    pad = 0
    for _ in range(3):
        pad += sum(sizes) - len(of(pad))
    vector("overlapping_pages_kept", LIMIT, "three PAGE records within one another of as many bytes as the file has", of(pad))
    must_fail("overlapping_pages", LIMIT, "three PAGE records within one another of a byte more than the file has", of(pad - 1))
    must_fail("overlapping_pages_cut", "2.4", "three PAGE records within one another that are cut off", of(pad - 1)[:-1],
              reports=True)
    for name, more in (("_kept", 0), ("", -1)):
        (must_fail if more else vector)(f"overlapping_records{name}", LIMIT, "two parts share a record: the listed bytes are "
                                        f"those of the file{' and one more' * -more}", shared_record(more),
                                        **({} if more else {"validator": [318]}))
    data = shared_record(0)
    end = data.index(b"SEGM") + 24 + struct.unpack_from("<Q", data, data.index(b"SEGM") + 8)[0]
    must_fail("overlapping_records_end", LIMIT, "two parts share a record, with which the bytes that are there end", data[:end])
    must_fail("overlapping_records_cut", "2.4", "two parts share a record that is cut off", data[:end - 1], reports=True)
    must_fail("copies_beyond_the_end_kept", LIMIT, "four links beyond the end share a copy: four times its bytes are those of "
              "the file", shared_copy(0), reports=True)
    must_fail("copies_beyond_the_end", LIMIT, "four links beyond the end share a copy: four times its bytes are those of the "
              "file and one more", shared_copy(-1))
    data = File(tree(extra=bytes(1500))[0], Meta(profile=0)).bytes()
    must_fail("truncated_before_pages", "2.4", "the file ends with its head; its pages have more bytes", data[:struct.unpack_from(
        "<I", data, 24)[0]], reports=True)
