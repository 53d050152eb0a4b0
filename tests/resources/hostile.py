# SPDX-License-Identifier: Apache-2.0
"""Files that make a reader hold or compute as much as possible, by the record that asks for it.

CASES maps a name to a Case. Its function returns a file of about `size` bytes; the other arguments
are those that a search varies within the ranges of the case.
"""
import struct
import sys
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "conformance"))

from vector_file import Meta, header  # noqa: E402
from vector_growing import Fragment, Recording  # noqa: E402
from vector_records import Body, checksum, layouts_payload, number, record, table_bytes, text  # noqa: E402
from vector_scenes import coded_streams, few_planes, float_streams, give_tables  # noqa: E402

CASES = {}
RANS_BLOCK = 8192  # symbols
BYTES_BEYOND = 1 << 40  # stated size of files whose records lie beyond their end


@dataclass
class Case:
    tag: str        # the record type
    make: object    # function of size and the arguments
    ranges: dict    # argument: (least, greatest); searched in powers of 2


def case(tag, **ranges):
    def add(make):
        CASES[make.__name__] = Case(tag, make, ranges)
        return make
    return add


def finished(index, *, meta=None, layouts=None, before=b"", after=b"", body=b"", stated=None, copy=False):
    """A finished file. `index`: payload of INDX, a function of the offset of the body."""
    meta = (meta or Meta()).payload()
    at = 0
    for _ in range(20):
        records = before + record(b"META", meta)
        records += record(b"LAYT", layouts) if layouts is not None else b""
        records += record(b"INDX", index(at)) + after
        if at == 32 + len(records):
            break
        at = 32 + len(records)
    content = body(at) if callable(body) else body
    size = at + len(content) if stated is None else stated
    return header(2, 0, 0, size, at) + records + content


def run(part, offset, entries, *, begin=0.0, end=30.0, chunk=2.0 ** -20):
    times = struct.pack("<5d", begin, end, begin, end, chunk)
    return number(part) + times + number(offset) + number(len(entries)) + b"".join(entries)


def index_of(runs, primitives=0, links=()):
    return (number(primitives) + number(0) + number(len(links)) + b"".join(links) +
            number(len(runs)) + b"".join(runs))


EMPTY = index_of([])
ENTRY = number(1) + number(4) + number(1) + number(1)  # level 0, one tier of one primitive in 1 byte


def nothing(_at):
    return EMPTY


@case("META")
def long_title(size):
    return finished(nothing, meta=Meta(title=b"t" * size))


@case("LAYT", symbols=(2, 32))
def tables(size, symbols):
    table = table_bytes({s: 4096 // symbols for s in range(symbols)})
    count = min(1024, size // len(table))
    return finished(nothing, layouts=layouts_payload([table] * count, []))


def row(extra):
    return struct.pack("<HH", 5 + extra, 0xFFFF) + bytes(3 + extra)


@case("LAYT", rows=(1, 255), extra=(0, 64))
def layouts(size, rows, extra):
    layout = bytes([rows]) + row(extra) * rows
    count = min(65534, size // len(layout))
    return finished(nothing, layouts=struct.pack("<HH", 0, count) + layout * count)


@case("LAYT")
def empty_layouts(size):
    count = min(65534, size)
    return finished(nothing, layouts=struct.pack("<HH", 0, count) + bytes(count))


@case("PRIV", length=(1, 256), rows=(1, 255))
def private_names(size, length, rows):
    count = min(65535, size // 2 // (5 + length))
    names = b"".join(struct.pack("<HH", 0, i & 0x3FFF) + text(b"a" * length) for i in range(count))
    layout = bytes([rows]) + row(0) * rows
    many = min(65534, size // 2 // len(layout))
    return finished(nothing, layouts=struct.pack("<HH", 0, many) + layout * many,
                    after=record(b"PRIV", struct.pack("<H", count) + names, 0))


@case("ERRB")
def error_bounds(size):
    return finished(nothing, after=record(b"ERRB", bytes([1]) + bytes(size), 0))


@case("other", payload=(0, 64), damaged=(0, 1))
def unknown_in_head(size, payload, damaged):
    one = record(b"abcd", bytes(payload), 0)
    if damaged:
        one = one[:16] + bytes([one[16] ^ 1]) + one[17:] if payload else one
    return finished(nothing, after=one * (size // len(one)))


@case("other", payload=(0, 64))
def unknown_in_body(size, payload):
    one = record(b"abcd", bytes(payload), 0)
    return finished(nothing, body=one * (size // len(one)))


@case("SEGM", payload=(4, 64))
def unlisted_segments(size, payload):
    one = record(b"SEGM", bytes(payload))
    return finished(nothing, body=one * (size // len(one)))


@case("INDX", copies=(0, 1))
def links(size, copies):
    """Links to pages beyond the end."""
    count = size // 23
    def index(at):
        beyond = at + size
        return index_of([], links=[struct.pack("<dd", 0, 30) + number(beyond + 64 * i) +
                                   number(beyond * copies) + number(40) for i in range(count)])
    return finished(index, stated=BYTES_BEYOND)


@case("INDX", segments=(1, 65536), tiers=(1, 255), long=(0, 1))
def entries(size, segments, tiers, long=0):
    """Entries of records beyond the end. `long`: with numbers of two bytes."""
    entry = number(1) + number(4 * tiers) + 2 * number(200 if long else 1) * tiers
    runs = max(1, size // (47 + segments * len(entry)))
    return finished(lambda at: index_of([run(p, at, [entry] * segments) for p in range(runs)]), stated=BYTES_BEYOND)


@case("INDX", records=(1, 57000))
def further_entries(size, records):
    entry = number(1) + number(2) + number(records) + b"".join(number(0x2000 + i) + number(1) for i in range(records))
    def index(at):
        return index_of([run(0, at, [entry] * max(1, size // len(entry)))])
    return finished(index, stated=BYTES_BEYOND)


@case("INDX", kept=(0, 1))
def segments_in_order(size, kept):
    """Entries of a clip of many segments, with or without their records."""
    count = size // (4 + 25 * kept)
    body = record(b"SEGM", b"\0") * count if kept else b""
    def index(at):
        return index_of([run(0, at, [ENTRY] * count)])
    return finished(index, body=body, stated=None if kept else BYTES_BEYOND)


@case("INDX", segments=(1, 4096), tiers=(1, 255))
def runs_backwards(size, segments, tiers):
    """Runs of parts whose records lie in the opposite order, so that they have to be sorted."""
    entry = number(1) + number(4 * tiers) + (number(1) + number(1)) * tiers
    count = max(1, size // (52 + segments * len(entry)))
    step = segments * tiers * 32
    def index(at):
        return index_of([run(p, at + step * (count - p), [entry] * segments) for p in range(count)])
    return finished(index, stated=BYTES_BEYOND)


@case("INDX")
def alternating_levels(size):
    """Segments whose places are not in their order: long and short ones take turns."""
    three = [number(2) + ENTRY[1:], ENTRY, ENTRY]
    def index(at):
        return index_of([run(0, at, three * (size // len(b"".join(three))))])
    return finished(index, stated=BYTES_BEYOND)


def chained(size, build):
    """A finished file of pages that link to the next one. `build`: makes the payload of a page."""
    def body(at):
        out = b""
        while len(out) < size:
            out += record(b"PAGE", build(at + len(out)))
        return out
    return body


@case("PAGE", entries_each=(0, 256), damaged=(0, 1), copied=(0, 1))
def pages(size, entries_each, damaged, copied=0):
    """Pages with few entries, one link each. `copied`: the links share one copy, which is intact."""
    runs = [run(0, 1 << 30, [ENTRY] * entries_each)] if entries_each else []
    page = bytearray(record(b"PAGE", number(0) + number(len(runs)) + b"".join(runs)))
    copy = bytes(page) * copied
    page[-1] ^= damaged
    count = size // (len(page) + 24 + 4 * copied)
    def index(at):
        return index_of([], links=[struct.pack("<dd", i, i + 1) + number(at + i * len(page)) +
                                   number((at + count * len(page)) * copied) +
                                   number(len(page) - 24) for i in range(count)])
    return finished(index, body=bytes(page) * count + copy, stated=BYTES_BEYOND)


@case("PAGE", links_each=(1, 4096))
def linked_pages(size, links_each):
    """One page whose links share a copy."""
    page = record(b"PAGE", number(0) + number(0) + bytes(size // 2))
    count = links_each
    def index(at):
        return index_of([], links=[struct.pack("<dd", 0, 30) + number(at) + number(at + 1 + i) +
                                   number(len(page) - 24) for i in range(count)])
    pad = record(b"abcd", bytes(len(page) + count + 100), 0)
    return finished(index, body=page + pad)


def minimal_fragments(size, layouts_count, damaged, title=b""):
    streams = few_planes(1)
    tables_of = []
    give_tables([streams], tables_of)
    body = Body(streams, 1, layout=0, tables=tables_of)
    many = tables_of + [{0: 2048, 1: 2048}] * (layouts_count - len(tables_of))
    recording = Recording(meta=Meta(profile=1, frames=1, title=title),
                          last_records=record(b"LAYT", layouts_payload(many, [streams])))
    del body
    made = []
    while len(recording.out) < size:
        fragment = Fragment([])
        made.append(recording.add(fragment))
    data = bytearray(recording.out)
    if damaged:
        for written in made[:-1:damaged]:
            data[written.at + 24 + 20] ^= 255
    return bytes(data)


@case("FRAG", tables_each=(1, 1024), damaged=(0, 2))
def fragments(size, tables_each, damaged):
    return minimal_fragments(size, tables_each, damaged)


@case("FRAG", payload=(0, 4096))
def false_fragments(size, payload):
    """A recording without a valid fragment; its search examines all records."""
    head = header(2, 0, 1, 0, 0)
    records = record(b"META", Meta(profile=0, frames=1).payload())
    head = header(2, 0, 1, 0, 32 + len(records)) + records
    one = record(b"FRAG", bytes(payload))
    return head + one * (size // len(one))


@case("FRAG")
def bare_tags(size):
    """A recording of tags of FRAG records without their headers."""
    records = record(b"META", Meta(profile=0, frames=1).payload())
    return header(2, 0, 1, 0, 32 + len(records)) + records + b"FRAG" * (size // 4)


@case("FRAG", title=(1, 65536))
def false_fragments_with_heads(size, title):
    """FRAG records that contain a head of a long title but state another offset."""
    records = record(b"META", Meta(profile=0, frames=1, title=b"t" * title).payload())
    head = header(2, 0, 1, 0, 32 + len(records)) + records
    payload = struct.pack("<QII6f", 1, 1, 0, *([0.0] * 6)) + number(0) + struct.pack("<I", len(head)) + head
    payload += number(0) + number(0) + number(0)
    payload += struct.pack("<Q", len(payload) + 8)
    one = record(b"FRAG", payload)
    return head + one * max(1, (size - len(head)) // len(one))


def one_segment(payload, n, *, count=1, degree=0, layouts=None):
    """A file of `count` segments of the same record."""
    one = record(b"SEGM", payload)
    def index(at):
        runs = [run(p, at + p * len(one), [number(0) + number(4) + number(n) + number(len(payload))], chunk=30.0)
                for p in range(count)]
        return index_of(runs, primitives=n * count)
    return finished(index, meta=Meta(profile=1, degree=degree), layouts=layouts, body=one * count)


@case("SEGM", n=(1, 1 << 20), degree=(0, 3))
def primitives(size, n, degree):
    """Primitives of one byte each: all planes have a table of one symbol."""
    n = min(n, size)
    streams = few_planes(1) if degree == 0 else constant_streams(1, degree)
    tables_of = []
    give_tables([streams], tables_of)
    # Their units are empty, for any n.
    payload = Body(streams, n, layout=0, tables=tables_of, degrees=[n] * degree).payload(-1, 0, 0)
    return one_segment(payload, n, count=max(1, size // (len(payload) + 80)), degree=degree,
                       layouts=layouts_payload(tables_of, [streams]))


@case("SEGM", blocks=(1, 128), degree=(0, 3), joined=(0, 1))
def frequent_symbols(size, blocks, degree, joined):
    """Primitives of about one byte: each plane has the same symbol, of a table with a second one."""
    streams, tables = constant_streams(RANS_BLOCK, degree, joined), [{0: 4095, 1: 1}, {degree: 4096}]
    for stream in streams:
        sh_degree = stream.attribute == 10
        stream.v = [[degree if sh_degree else 0] * RANS_BLOCK for _ in stream.v]
        stream.tables = [1 if sh_degree else 0] * len(stream.planes())
    repeated = []
    for unit in Body(streams, RANS_BLOCK, layout=0, tables=tables).units():  # one block
        words = max(0, len(unit) - 4 * 32) // 2
        repeated.append(unit and struct.pack("<I", words) * (blocks - 1) + unit * blocks)
    n = RANS_BLOCK * blocks
    payload = struct.pack(f"<hHIIH{degree}II", -1, 0, 0, n, 0, *[n] * degree, 0)  # 0: first key
    payload += struct.pack(f"<{len(repeated)}I", *map(len, repeated)) + b"".join(repeated)
    payload, count = payload.ljust(n, b"\0"), max(1, size // (max(n, len(payload)) + 80))
    return one_segment(payload, n, count=count, degree=degree, layouts=layouts_payload(tables, [streams]))


def constant_streams(n, degree, joined=False):
    streams = coded_streams(n, degree, 1, joined=bool(joined))
    for stream in streams:
        stream.v = [[row[0]] * n for row in stream.v]
    return streams


@case("SEGM", count=(1, 65534), rows=(0, 255))
def own_layouts(size, count, rows):
    layout = bytes([rows]) + row(0) * rows
    count = max(1, min(count, size // len(layout)))
    payload = struct.pack("<hHIIH", -1, 0, 0, 1, 65535) + struct.pack("<HH", 0, count) + layout * count
    return one_segment(payload, 1, count=max(1, size // (len(payload) + 80)))


@case("SEGM", count=(1, 256))
def own_tables(size, count):
    table = table_bytes({0: 2048, 1: 2048})
    payload = (struct.pack("<hHIIH", -1, 0, 0, 1, 65535) + struct.pack("<H", count) + table * count +
               struct.pack("<H", 1) + b"\0")
    return one_segment(payload, 1, count=max(1, size // (len(payload) + 80)))


@case("SEGM", n=(1, 1 << 16))
def float_primitives(size, n):
    payload = Body(float_streams(n, 0, 1), n).payload(-1, 0, 0)
    return one_segment(payload, n, count=max(1, size // (len(payload) + 80)))


@case("COPY", count=(1, 4096))
def head_copies(size, count):
    """COPY records of a long head."""
    head = finished(nothing, meta=Meta(title=b"t" * (size // count)))
    one = record(b"COPY", head + struct.pack("<Q", len(head) + 8), 0)
    return finished(nothing, meta=Meta(title=b"t" * (size // count)), body=one * count)


@case("COPY")
def used_copy(size):
    """A damaged head, which is read from its copy."""
    meta = Meta(title=b"t" * (size // 2))
    records = record(b"META", meta.payload()) + record(b"INDX", EMPTY)
    at = 32 + len(records)
    copy_bytes = 24 + at + 8
    head = header(2, 0, 0, at + copy_bytes, at) + records
    copy = record(b"COPY", head + struct.pack("<Q", len(head) + 8), 0)
    return head[:100] + bytes([head[100] ^ 1]) + head[101:] + copy


@case("IMPO")
def importance(size):
    values = struct.pack("<I", 0x3F800000) * (size // 4)
    return finished(nothing, body=record(b"IMPO", values, 0))


@case("WNDW", count=(1, 65536))
def windows(size, count):
    return finished(nothing, after=record(b"WNDW", bytes(24), 0) * min(count, size // 48))


@case("STEP", count=(1, 65536))
def steps(size, count):
    payload = bytes(max(1, size // count))
    return finished(nothing, after=record(b"STEP", payload, 0) * count)


def check():
    """Every case can be made."""
    for name, made in CASES.items():
        data = made.make(20000, **{k: low for k, (low, _) in made.ranges.items()})
        assert checksum(data[:28]) == struct.unpack("<I", data[28:32])[0], name


if __name__ == "__main__":
    check()
