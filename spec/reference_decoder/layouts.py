# SPDX-License-Identifier: Apache-2.0
"""Clauses 6.2 to 6.5 and the limits of 7.3 to 7.5: layouts and their streams."""
from dataclasses import dataclass, field

import rans
from fields import Fields, Refused, need

COMPONENTS = {1: 3, 2: 1, 3: 1, 4: 1, 5: 3, 6: 3, 7: 4, 8: 1, 9: 3, 10: 9, 11: 15, 12: 21}  # 6.4
NAMES = {1: "position", 2: "time", 3: "sigma", 4: "radius", 5: "velocity", 6: "log_scale",
         7: "rotation", 8: "opacity", 9: "sh0", 10: "sh1", 11: "sh2", 12: "sh3"}
OPTIONAL = 0x8000  # 6.5
SH = (9, 10, 11, 12)
# The attributes that each mapping may have (7.5.1 to 7.5.8).
MAPS = {0: tuple(COMPONENTS), 1: (1, 2, 6, 8) + SH, 2: (3, 4), 3: (5,), 4: (7,), 5: SH, 6: (7,),
        7: (2,)}
MORTON, RANS, DRACO = 3, 1, 2


@dataclass
class Stream:  # 6.3
    attribute: int
    components: int
    mapping: int
    prediction: int
    coder: int
    e: int = 0
    m: int = 1
    bits: list = field(default_factory=list)
    origin: list = field(default_factory=list)
    tables: list = field(default_factory=list)

    def optional(self):
        return self.attribute >= OPTIONAL

    def known(self):
        return self.attribute in COMPONENTS and self.mapping <= 7 and self.prediction <= 3 and \
            self.coder <= DRACO

    def planes(self):
        return self.components * len(self.bits)


@dataclass
class Layouts:
    tables: list = field(default_factory=list)
    layouts: list = field(default_factory=list)


def read_layouts(fields, memory, max_tables=1024):  # 6.2; memory: limit for tables and rows
    out = Layouts()
    count = fields.u16()
    need(count <= max_tables, "6.2" if max_tables == 1024 else "6.1", f"{count} tables")
    need(16384 * count <= memory, "conformance 1.5", f"{count} tables", unsupported=True)
    out.tables = [rans.Table(fields) for _ in range(count)]
    count = fields.u16()
    need(count <= 65534, "6.2", f"{count} layouts")
    total = 0
    for _ in range(count):
        rows = [fields.bytes(fields.u16()) for _ in range(fields.u8())]
        total += len(rows)
        need(128 * (total - 1024) <= memory, "conformance 1.5", f"{total} rows", unsupported=True)
        try:
            out.layouts.append(read_layout(rows, out.tables))
        except Refused as error:  # raised for the records that name the layout
            out.layouts.append(error)
    return out


def read_layout(rows, tables):  # 6.3
    layout = [read_stream(Fields(row, "6.3"), len(tables)) for row in rows]
    group = sum(1 for s in layout for t in s.tables if tables[t].only is None)
    planes = sum(s.planes() for s in layout)
    float_bytes = sum(4 * COMPONENTS[s.attribute] for s in layout if s.known())
    need(planes <= float_bytes, "7.3", f"{planes} planes for {float_bytes} bytes of floats")
    need(group <= 256, "A.1", f"a group of {group} planes")
    return layout


def read_stream(row, tables):  # 6.3
    s = Stream(row.u16(), row.u8(), row.u8(), row.u8(), row.u8())
    need(not s.optional() or s.coder != RANS, "6.5", "an optional stream that is rANS")
    if s.known():
        read_known(s, row, tables)
    return s


def read_known(s, row, tables):
    s.e, s.m, digits, origin = row.i8(), row.u8(), row.u8(), row.u8()
    need(1 <= digits <= 16, "6.3", f"{digits} digits")
    need(origin <= 3, "6.3", f"an origin of {origin} numbers")
    s.bits = [row.u8() for _ in range(digits)]
    s.origin = [row.f32() for _ in range(origin)] + [0.0] * (3 - origin)
    if s.coder == RANS:
        s.tables = [row.u16() for _ in range(s.planes())]
        need(all(t < tables for t in s.tables), "6.3", "a table that does not exist")
    need(all(1 <= b <= 8 for b in s.bits), "7.3", f"digits of {s.bits} bits")
    need(s.coder == RANS or all(b == 8 for b in s.bits), "7.2", "digits of less than 8 bits")
    need(s.coder != DRACO or (s.attribute, s.mapping, s.prediction, len(s.bits)) == (1, 1, 0, 3),
         "7.2.1", "not a stream that Draco can code")
    need(sum(s.bits) <= (64 if s.prediction == MORTON else 32), "7.3", f"{sum(s.bits)} bits")
    need(s.attribute in MAPS[s.mapping], "7.5", f"mapping {s.mapping} of {NAMES[s.attribute]}")
    need(s.mapping != 0 or (s.prediction, s.e, s.m) == (0, 0, 1), "7.5.1",
         "not a stream of the float mapping")
    need(s.m % 2 == 1, "7.5", f"a multiplier of {s.m}")
    need(-100 <= s.e <= 100, "7.5", f"e = {s.e}")
    need(all(v == 0 or 2.0 ** -100 <= abs(v) <= 2.0 ** 100 for v in s.origin), "7.5",
         f"an origin of {s.origin}")
    need(s.prediction != MORTON or (s.attribute == 1 and s.mapping == 1), "7.4", "prediction 3")
    need(s.mapping != 2 or (0 <= s.e <= 23 and s.origin[0] >= 2.0 ** -100), "7.5.3",
         f"e = {s.e}, an origin of {s.origin}")
    need(s.mapping not in (4, 6) or -14 <= s.e <= -1, "7.5.5", f"e = {s.e}")
    components = 1 if s.prediction == MORTON else 3 if s.mapping in (4, 6) else \
        COMPONENTS[s.attribute]
    need(s.components == components, "7.5", f"{s.components} components")


def check_attributes(layout, content, degree):
    """Checks that a layout has the attributes of a record's content (5.7, 6.4). Returns True if it
    omits SH above degree 0."""
    for s in layout:
        need(s.known() or s.optional(), "6.3", f"attribute {s.attribute}, mapping {s.mapping}, "
             f"prediction {s.prediction}, coder {s.coder}", unsupported=True)
    have = [s.attribute for s in layout if not s.optional()]
    base, rest = list(range(1, 10)), list(range(10, 10 + degree))
    if content == 1:
        need(have == rest, "6.4", f"attributes {have}")
        return False
    need(have in (base, base + rest), "6.4", f"attributes {have}")
    return have == base
