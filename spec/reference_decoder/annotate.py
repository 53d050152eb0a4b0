#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints every byte of a valid .stgs file with its offset, the field that it belongs to, and its value.

usage: annotate.py FILE
"""
import sys

from fields import RECORD, Fields
from head import HEADER
from layouts import NAMES, RANS
from rans import Table

WIDTH = 16  # bytes in a line


class Annotated(Fields):
    """Fields that are printed as they are read. `base` is the offset of the bytes in the file."""

    def __init__(self, data, base):
        super().__init__(data, "", 0)
        self.base = base

    def show(self, begin, name, value=""):
        data = self.data[begin:self.at]
        for first in range(0, max(1, len(data)), WIDTH):
            part = data[first:first + WIDTH].hex(" ")
            text = f"{name}{': ' if value != '' else ''}{value}" if first == 0 else ""
            print(f"{self.base + begin + first:04x}  {part:<{3 * WIDTH - 1}}  {text}".rstrip())

    def field(self, name, kind, *more):
        begin = self.at
        value = getattr(self, kind)(*more)
        shown = value.decode() if isinstance(value, bytes) and kind == "text" else value
        self.show(begin, name, "" if isinstance(shown, bytes) else shown)
        return value

    def rest(self, name):
        if self.left() > 0:
            self.field(name, "bytes", self.left())


def show_header(f):
    f.field("magic", "bytes", 8)
    for name, kind in (("major version", "u16"), ("minor version", "u16"), ("flags", "u32"),
                       ("file_bytes", "u64"), ("head_bytes", "u32"), ("checksum", "u32")):
        f.field(name, kind)


def show_meta(f):  # 4.2
    f.field("time base, numerator", "u32"), f.field("denominator", "u32"), f.field("frames", "u32")
    for name in ("kernel", "axes", "SH", "SH degree"):
        f.field(name, "u8")
    f.field("profile", "u16"), f.field("primaries", "u8"), f.field("transfer function", "u8")
    for name, count in (("background", 3), ("minimum of the positions", 3), ("maximum", 3), ("near plane", 1)):
        f.field(name, "f32s", count)
    f.field("start camera, width", "u32"), f.field("height", "u32")
    for name, count in (("rotation", 9), ("translation", 3), ("fx, fy, cx, cy", 4)):
        f.field(name, "f32s", count)
    f.field("generator", "text"), f.field("title", "text"), f.field("metres per unit", "f32")
    f.field("up", "f32s", 3), f.field("floor", "f32s", 3), f.field("audio", "text")
    f.field("audio begins", "f64")


def show_table(f, number):  # 7.2
    begin = f.at
    table = Table(f)
    frequencies = {s: table.symbol.count(s) for s in sorted(set(table.symbol))}
    f.show(begin, f"table {number}, frequencies", frequencies)
    return table


def show_layouts(f):  # 6.1, 6.2
    tables = [show_table(f, t) for t in range(f.field("tables", "u16"))]
    layouts = []
    for number in range(f.field("layouts", "u16")):
        layouts.append([show_row(f) for _ in range(f.field(f"layout {number}, streams", "u8"))])
    return tables, layouts


def show_row(f):
    end = f.field("row, bytes", "u16") + f.at
    attribute = f.u16()
    f.at -= 2
    f.field(f"attribute ({NAMES.get(attribute, 'optional')})", "u16")
    row = {name: f.field(name, kind) for name, kind in (
        ("mapping", "u8"), ("prediction", "u8"), ("coder", "u8"), ("joins", "u8"), ("exponent", "i8"),
        ("multiplier", "u8"), ("low", "u8"), ("digits", "u8"), ("numbers of the origin", "u8"))}
    f.field("bits of each digit", "bytes", row["digits"])
    if row["numbers of the origin"] > 0:
        f.field("origin", "f32s", row["numbers of the origin"])
    if end > f.at:
        f.field("tables of the planes", "bytes", end - f.at)
    return {**row, "attribute": attribute}


def show_node(f):  # 5.2, 5.3
    show_links(f, "links")
    for _ in range(f.field("runs", "number")):
        f.field("part", "number")
        for name in ("begin", "end", "from", "to", "C"):
            f.field(name, "f64")
        f.field("offset of the first record", "number")
        for _ in range(f.field("segments", "number")):
            show_segment_entry(f)


def show_links(f, name):
    for _ in range(f.field(name, "number")):
        f.field("from", "f64"), f.field("to", "f64")
        f.field("offset", "number"), f.field("copy", "number"), f.field("bytes", "number")


def show_segment_entry(f):
    f.field("place", "number")
    shape = f.field("shape", "number")
    for _ in range(shape // 4):
        f.field("primitives", "number"), f.field("bytes", "number")
    for _ in range(shape // 4 * (shape % 2)):
        f.field("bytes of the SH", "number")
    for _ in range(f.field("further records", "number") if shape // 2 % 2 else 0):
        f.field("layer", "number"), f.field("bytes", "number")


def show_index(f):  # 5.1
    f.field("primitives", "number")
    for _ in range(f.field("attribute totals", "number")):
        f.field("attribute", "number"), f.field("bytes", "number")
    show_node(f)


def show_segment(f, degree, shared):  # 6.5
    f.field("level", "i16")
    layer = f.field("layer", "u16")
    f.field("slot", "u32")
    if layer >= 512:
        return
    f.field("primitives", "u32")
    number = f.field("layout", "u16")
    layout = show_layouts(f)[1][0] if number == 65535 else shared[number]
    rows = [row["attribute"] for row in layout]
    for k in range(degree if 10 in rows else 0):
        f.field(f"primitives of degree {k + 1} or more", "u32")
    if any(row["prediction"] == 3 for row in layout):
        f.field("first key", "u32")
    units = [[NAMES.get(row["attribute"])] for row in layout if not row["joins"]]
    at = -1
    for row in layout:
        at += not row["joins"]
        if row["joins"]:
            units[at].append(NAMES[row["attribute"]])
    sizes = [f.field(f"bytes of unit {u}", "u32") for u in range(len(units))]
    for names, size in zip(units, sizes):
        if size > 0:
            coded = "group" if any(r["coder"] == RANS and NAMES.get(r["attribute"]) == names[0] for r in layout) else "planes"
            f.field(f"{coded} of {', '.join(map(str, names))}", "bytes", size)


def show_fragment(f):  # 9.2
    f.field("own offset", "u64"), f.field("frames", "u32"), f.field("flags", "u32")
    f.field("bounds", "f32s", 6), f.field("primitives so far", "number")
    f.field("copy of the head", "bytes", f.field("head_bytes", "u32"))
    show_links(f, "earlier links")
    show_node(f)
    f.field("bytes of this payload", "u64")


def show_copy(f):  # 10.2
    f.field("the head", "bytes", f.left() - 8)
    f.field("bytes of this payload", "u64")


def annotate(data):
    show_header(Annotated(data[:HEADER], 0))
    at, degree, layouts = HEADER, 0, []
    while at < len(data):
        f = Annotated(data[at:at + RECORD], at)
        tag = f.bytes(4)
        print(f"\n{tag.decode()}")
        f.show(0, "tag")
        f.field("flags", "u32")
        length = f.field("length", "u64")
        f.field("checksum of the payload", "u32"), f.field("checksum of the header", "u32")
        body = Annotated(data[at + RECORD:at + RECORD + length], at + RECORD)
        if tag == b"META":
            degree = body.data[15]
        if tag == b"LAYT":
            layouts = show_layouts(body)[1]
        elif tag == b"SEGM":
            show_segment(body, degree, layouts)
        elif tag in SHOW:
            SHOW[tag](body)
        body.rest("other bytes")
        at += RECORD + length


SHOW = {b"META": show_meta, b"INDX": show_index, b"PAGE": show_node, b"FRAG": show_fragment, b"COPY": show_copy}

if __name__ == "__main__":
    annotate(open(sys.argv[1], "rb").read())
