# SPDX-License-Identifier: Apache-2.0
"""Tables and groups that break a rule (7)."""
import struct

from vector_file import Meta
from vector_list import flipped, must_fail, plain, vector
from vector_records import RANS, Body, Patched, Stream, encode_block, group, table_bytes
from vector_scenes import few_planes, float_streams, own_body


def broken_groups():
    tables()
    groups()


def sum_of_4096():
    """Returns a table whose frequencies before the last add up to 4096."""
    return flipped(table_bytes({0: 2048, 1: 2047, 2: 1}), 0, 0)[:1] + table_with({0: 2048, 1: 2048}, 2)


def table_with(f, z):
    """Returns the bits of a table of the frequencies f up to z - 1, which the encoder takes as those of z."""
    whole = dict(f)
    whole[z] = 1
    return table_bytes(whole)[1:]


def tables():
    streams = float_streams(3, 0, 1)
    streams[7] = Stream(8, 1, 0, [[0, 1, 2]], 0, RANS, (2,))
    good = own_body(streams, 3)
    table = table_bytes(good.tables[0])
    for name, about, new in (("sum", "frequencies that add up to more than 4096", bytes([2]) + b"\xff" * 6),
                             ("sum_of_4096", "frequencies before the last that add up to 4096", sum_of_4096()),
                             ("padding", "a bit after a table", flipped(table, len(table) - 1, 128)),
                             ("golomb", "more than 3 zeros with k = 9", bytes([2, 0xF0, 0xFF, 0xFF, 0xFF])),
                             ("zeros", "a number that does not end", bytes([2]) + bytes(6)),
                             ("passes", "a run of zeros that passes the greatest symbol", passes())):
        must_fail(f"table_{name}", "7.2", about, plain(body=Patched(good, table, new)))
    must_fail("table_cut", "7.2", "a record that ends within its table", plain(body=CutTable(good, 19)), clause_of="6.5")
    row = good.streams[7].row()
    must_fail("table_1_of_1", "6.2", "table 1 of 1", plain(body=Patched(good, row, row[:-2] + b"\1\0")))
    must_fail("table_missing", "6.2", "a row that ends before the number of its table", plain(
        body=Patched(good, row, struct.pack("<H", len(row) - 3) + row[2:-1])))
    optional = float_streams(3, 0, 1) + [Stream(0x8001, 0, 0, [[0, 0, 0]], 0, RANS, (8,))]
    must_fail("optional_rans", "6.2", "an optional stream with coder 1", plain(body=own_body(optional, 3)))


class CutTable(Body):
    def __init__(self, body, size):
        super().__init__(**vars(body))
        self.size = size

    def payload(self, level, layer, slot):
        return super().payload(level, layer, slot)[:self.size]


def passes():
    """Returns a table with z = 2: f[0] = 4096 - 512, then a run of zeros to symbol 3."""
    return bytes([2]) + table_bytes({0: 3000, 4: 1096})[1:]


def with_tables(opacity, table, n):
    """Returns a record with this opacity, whose plane has this table."""
    streams = float_streams(n, 0, 1)
    streams[7] = opacity
    opacity.tables = [0]
    return plain(body=Body(streams, n, tables=[table]), meta=Meta())


def groups():
    def opacity(unit=None, n=3):
        streams = float_streams(n, 0, 1)
        streams[7] = Stream(8, 1, 0, [[i % 3 for i in range(n)]], 0, RANS, (2,), stored=unit)
        return plain(body=own_body(streams, n))

    f = own_body([Stream(8, 1, 0, [[0, 1, 2]], 0, RANS, (2,))], 3).tables[0]
    valid = group([bytes([0, 1, 2])], [f], 3)
    state = struct.unpack_from("<I", valid)[0]
    must_fail("group_empty", "7.3", "no bytes", opacity(b""))
    must_fail("group_of_3_bytes", "7.3", "three bytes", opacity(valid[:3]))
    must_fail("group_odd", "7.3", "an odd number of bytes", opacity(valid + b"\0"))
    must_fail("state_65535", "7.3", "a state of 65535", opacity(struct.pack("<I", 65535) + valid[4:]))
    low = Stream(8, 1, 0, [[0]], 0, RANS, (2,), stored=struct.pack("<IH", 1, 0))
    must_fail("state_1", "7.3", "a state of 1 that leads to 65536 with one word", with_tables(low, {0: 2048, 1: 2048}, 1))
    least = Stream(8, 1, 0, [[0, 1]], 0, RANS, (2,))
    vector("state_65536", "7.3", "a group that begins with the least state", with_tables(least, {0: 1, 1: 256, 2: 3839}, 2))
    must_fail("word_left", "7.4", "one word more than is read", opacity(valid + b"\0\0"))
    must_fail("last_state", "7.4", "a block that ends with another state", opacity(struct.pack("<I", state + 4096) + valid[4:]))
    symbols = bytes(i * i % 7 for i in range(300))
    f7 = {0: 600, 1: 1200, 2: 1000, 4: 1296}
    streams = few_planes(300)
    second = bytes(5 if i % 10 == 3 else 0 for i in range(300))
    whole = group([symbols, second], [f7, {0: 3686, 5: 410}], 300)

    def example(unit):
        made = [s for s in streams]
        made[7] = Stream(8, 1, -4, [[a + 256 * b for a, b in zip(symbols, second)]], 0, RANS, (8, 8), stored=unit)
        body = own_body(made, 300)
        for number, table in zip(made[7].tables, (f7, {0: 3686, 5: 410})):
            body.tables[number] = table
        return plain(body=body)

    vector("group_example", "7.5", "the group of the example", example(whole))
    x, words = encode_block([symbols, second], [f7, {0: 3686, 5: 410}], 2, 1)
    must_fail("state_of_lane_1", "7.3", "the second of two states is below 65536, and leads to the same symbols", example(
        struct.pack(f"<2I{len(words)}H", *x, *words)))
    must_fail("group_cut", "7.4", "the last word is missing", example(whole[:-2]))
    must_fail("group_word_flipped", "7.4", "a flipped bit of the last word", example(flipped(whole, len(whole) - 1)))
    x, words = encode_block([symbols, second], [f7, {0: 3686, 5: 410}], 2)
    must_fail("group_lanes_swapped", "7.4", "the states of two lanes are exchanged", example(
        struct.pack(f"<2I{len(words)}H", x[1], x[0], *words)))
    blocks = bytes(i * i % 3 for i in range(8200))
    table = {0: 2048, 1: 2048}
    unit = group([blocks], [table], 8200)
    big = few_planes(8200)

    def two_blocks(unit):
        made = [s for s in big]
        made[7] = Stream(8, 1, -4, [list(blocks)], 0, RANS, (8,), stored=unit)
        body = own_body(made, 8200)
        body.tables[made[7].tables[0]] = table
        return plain(body=body)

    count = struct.unpack_from("<I", unit)[0]
    for name, about, wrong in (("fewer_words", "the first block states a word less", struct.pack("<I", count - 1) + unit[4:]),
                               ("more_words", "the first block states a word more", struct.pack("<I", count + 1) + unit[4:]),
                               ("far_more_words", "the first block states 2^32 - 1 words", struct.pack("<I", (1 << 32) - 1) + unit[4:]),
                               ("no_counts", "three bytes", unit[:3]), ("no_last_block", "the last block is missing", unit[:4 + 4 * 32 + 2 * count])):
        must_fail(f"blocks_{name}", "7.4" if name in ("fewer_words",) else "7.3", about, two_blocks(wrong))
