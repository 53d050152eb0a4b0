# SPDX-License-Identifier: Apache-2.0
"""Clauses 6.1 to 6.4: layouts and their rows, with the rules of clause 8 for rows."""
from dataclasses import dataclass, field

from fields import Fields, Refused, need
from rans import Table

COMPONENTS = {1: 3, 2: 1, 3: 1, 4: 1, 5: 3, 6: 3, 7: 4, 8: 1, 9: 3, 10: 1, 11: 9, 12: 15, 13: 21}  # 6.3
NAMES = {1: "position", 2: "time", 3: "sigma", 4: "radius", 5: "velocity", 6: "log_scale", 7: "rotation",
         8: "opacity", 9: "sh0", 10: "sh_degree", 11: "sh1", 12: "sh2", 13: "sh3"}
OPTIONAL = 0x8000  # 6.2
SIGMA, RADIUS, LOG_SCALE, SH_DEGREE = 3, 4, 6, 10
SH = (9, 11, 12, 13)
# The attributes of each mapping (8.5).
MAPS = {0: (1, 2, 3, 4, 5, 6, 7, 8) + SH, 1: (1, 6, 8) + SH, 2: (3, 4), 3: (5,), 4: (7,), 5: SH, 6: (7,),
        7: (2,), 8: (10,)}
MORTON, RANS = 3, 1


@dataclass
class Row:  # 6.2
    attribute: int
    mapping: int
    prediction: int
    coder: int
    joins: int = 0
    e: int = 0
    m: int = 1
    low: int = 0
    bits: list = field(default_factory=list)
    origin: list = field(default_factory=list)
    tables: list = field(default_factory=list)

    def optional(self):
        return self.attribute >= OPTIONAL

    def known(self):  # coder 2, Draco, is unknown to this decoder
        return self.attribute in COMPONENTS and self.mapping <= 8 and self.prediction <= 3 and self.coder <= RANS

    def components(self):  # 8.1
        """Returns the bits of each digit of each component."""
        if self.prediction == MORTON:
            low = [8] * (self.low // 8) + [self.low % 8] * (self.low % 8 > 0)  # 8.4
            return [self.bits] + [low] * 3
        return [self.bits] * (3 if self.mapping in (4, 6) else COMPONENTS[self.attribute])

    def planes(self):
        return sum(len(bits) for bits in self.components())


@dataclass
class Layouts:
    tables: list = field(default_factory=list)
    layouts: list = field(default_factory=list)  # lists of rows; Refused: of the records that name it


def read_shared(payload, memory):  # 6.1, conformance.md 1.5
    fields = Fields(payload, "6.1", 409)
    tables = read_tables(fields, 1024, memory)
    count = fields.u16()
    need(count <= 65534, "6.1", 409, f"{count} layouts")
    out, total = Layouts(tables), 0
    for _ in range(count):
        rows = [fields.bytes(fields.u16()) for _ in range(fields.u8())]
        total += 1 + len(rows)
        need(128 * (total - 1024) <= memory, "conformance 1.5", 308, f"{total} layouts and rows")
        try:
            out.layouts.append(read_layout(rows, tables))
        except Refused as error:
            out.layouts.append(error)
    return out


def read_own(fields, memory):
    """Returns the own layout of a record and its tables (6.1)."""
    tables = read_tables(fields, 256, memory)
    need(fields.u16() == 1, "6.1", 409, "more or less than one own layout")
    rows = [fields.bytes(fields.u16()) for _ in range(fields.u8())]
    layout = read_layout(rows, tables)
    need({t for row in layout for t in row.tables} == set(range(len(tables))), "6.1", 409,
         "a table that no plane uses")
    return layout, tables


def read_tables(fields, limit, memory):
    count = fields.u16()
    need(count <= limit, "6.1", 409, f"{count} tables")
    need(16384 * count <= memory, "conformance 1.5", 308, f"{count} tables")
    return [Table(fields) for _ in range(count)]


def read_layout(rows, tables):
    layout, before, after_sh = [], None, False
    for data in rows:
        row = read_row(Fields(data, "6.2", 409), len(tables))
        if not row.optional():
            need(row.known(), "6.2", 403, f"attribute {row.attribute}, mapping {row.mapping}, "
                 f"prediction {row.prediction}, coder {row.coder}")
            after_sh = after_sh or row.attribute in SH[1:]
            follows = before is not None and before.coder == RANS and not after_sh
            need(row.joins == 0 or (row.coder == RANS and follows), "6.5", 404, "joins no group")
        layout.append(row)
        before = row
    required = [row for row in layout if not row.optional()]
    float_bytes = sum(4 * COMPONENTS[row.attribute] for row in required)
    need(sum(row.planes() for row in required) <= float_bytes, "8.1", 404, "more planes than bytes of floats")
    check_shaped(required)
    return layout


def read_row(f, tables):  # 6.2
    row = Row(f.u16(), f.u8(), f.u8(), f.u8())
    need(not row.optional() or row.coder != RANS, "6.2", 404, "an optional stream with coder 1")
    if not row.known():  # as are all optional ones
        return row
    row.joins, row.e, row.m, row.low = f.u8(), f.i8(), f.u8(), f.u8()
    d, o = f.u8(), f.u8()
    need(1 <= d <= 8, "6.2", 404, f"{d} digits")
    need(o <= 3, "6.2", 404, f"an origin of {o} numbers")
    row.bits = [f.u8() for _ in range(d)]
    row.origin = f.f32s(o) + [0.0] * (3 - o)
    need(row.joins <= 1, "6.2", 404, f"joins is {row.joins}")
    need(all(1 <= b <= 8 for b in row.bits) and sum(row.bits) <= 32, "6.2", 404, f"digits of {row.bits} bits")
    check_mapping(row)
    if row.coder == RANS:
        row.tables = [f.u16() for _ in range(row.planes())]
        need(all(t < tables for t in row.tables), "6.2", 409, "a table that does not exist")
    else:
        need(all(b == 8 for bits in row.components() for b in bits), "8.1", 404, "digits of less than 8 bits")
    return row


def check_mapping(row):  # 8.4, 8.5
    need(row.attribute in MAPS[row.mapping], "8.5", 404, f"mapping {row.mapping} of {NAMES[row.attribute]}")
    need(all(v == 0 or 2.0 ** -100 <= abs(v) <= 2.0 ** 100 for v in row.origin), "8.5", 404,
         f"an origin of {row.origin}")
    if row.prediction == MORTON:
        need(row.attribute == 1, "8.3", 404, "prediction 3 of another attribute")  # mapping 0 has no prediction
        need(row.low <= 14, "8.4", 404, f"{row.low} low bits")
    else:
        need(row.low == 0, "6.2", 404, "low bits without prediction 3")
    if row.mapping in (0, 8):
        greatest = 20 if row.mapping == 0 else 0
        need(row.prediction == 0 and row.m == 1 and 0 <= row.e <= greatest, "8.5", 404,
             f"mapping {row.mapping} with prediction {row.prediction}, m = {row.m}, e = {row.e}")
        return
    least, greatest = {2: (0, 23), 4: (-14, -1), 6: (-14, -1)}.get(row.mapping, (-100, 100))
    need(row.m % 2 == 1, "8.5", 404, f"a multiplier of {row.m}")
    need(least <= row.e <= greatest, "8.5", 404, f"an exponent of {row.e}")
    need(row.mapping != 2 or row.origin[0] > 0, "8.5", 404, "a truncated origin of 0 or less")


def check_shaped(rows):  # 8.8
    if any(row.mapping == 6 for row in rows):
        for row in rows:
            need(row.attribute != LOG_SCALE or (row.mapping == 1 and len(set(row.origin)) == 1), "8.8", 404,
                 "mapping 6 with such log-scales")


def check_attributes(layout, content, apart, degree):  # 5.5, 6.3
    above = list(range(10, 11 + degree)) if degree > 0 else []
    wanted = above if content == 1 else list(range(1, 10)) + (above if not apart else [])
    have = [row.attribute for row in layout if not row.optional()]
    need(have == wanted, "6.3", 402, f"attributes {have}")


def check_profile(layout, profile):  # 11.1
    if profile == 0:
        need(all(row.optional() or (row.mapping in (0, 8) and row.e == 0) for row in layout), "11.1", 410,
             "a mapping in a lossless file")
