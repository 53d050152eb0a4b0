# SPDX-License-Identifier: Apache-2.0
"""Annex A: tables, and groups of planes."""
import struct

from fields import need

TOTAL = 4096     # A.2
LOW = 65536      # A.4
BLOCK = 2048     # A.1


class _Bits:
    """Reads bits, in each byte the lowest first (A.2)."""

    def __init__(self, fields):
        self.fields, self.byte, self.count = fields, 0, 0

    def take(self, bits):
        value = 0
        for i in range(bits):
            if self.count == 0:
                self.byte, self.count = self.fields.u8(), 8
            value |= (self.byte & 1) << i
            self.byte >>= 1
            self.count -= 1
        return value

    def golomb(self, k):  # G(k)
        u = 0
        while self.take(1) == 0:
            u += 1
            need(u <= 12 - k, "A.2", "a number of a table beyond 4095")
        return self.take(k + u) + (1 << (k + u)) - (1 << k)


class Table:
    def __init__(self, fields):  # A.2
        z = fields.u8()
        f = [0] * 256
        bits = _Bits(fields)
        k, s, after = 9, 0, 0
        while s < z:
            f[s] = bits.golomb(k) + after
            if f[s] > 0:
                k, s, after = f[s].bit_length() - 1, s + 1, 0
            else:
                s, after = s + 1 + bits.golomb(0), 1
        need(s == z, "A.2", "a table passes its greatest symbol")
        need(bits.byte == 0, "A.2", "bits after a table that are not 0")
        f[z] = TOTAL - sum(f)
        need(f[z] > 0, "A.2", "a table's frequencies add up to more than 4096")
        self.f = f
        self.only = z if f[z] == TOTAL else None  # a table of one symbol
        self.start = [sum(f[:s]) for s in range(256)]
        self.symbol = [s for s in range(256) for _ in range(f[s])]


def decode_group(data, n, tables):
    """Returns the planes of n primitives, one for each table (A.1, A.3 to A.6)."""
    blocks = [min(BLOCK, n - first) for first in range(0, n, BLOCK)]
    need(len(data) >= 4 * len(blocks), "A.6", "a group without the sizes of its blocks")
    words = struct.unpack_from(f"<{len(blocks)}I", data)
    lanes = [(m + 63) // 64 for m in blocks]
    sizes = [4 * count + 2 * w for count, w in zip(lanes, words)]
    need(4 * len(blocks) + sum(sizes) == len(data), "A.6", "blocks that do not fill their group")
    planes = [bytearray() for _ in tables]
    at = 4 * len(blocks)
    for m, count, w, size in zip(blocks, lanes, words, sizes):
        x = list(struct.unpack_from(f"<{count}I", data, at))
        need(min(x) >= LOW, "A.4", "a state below 65536")
        stored = struct.unpack_from(f"<{w}H", data, at + 4 * count)
        at += size
        next_word = 0
        for table, plane in zip(tables, planes):
            for i in range(m):  # step i // count, lane i % count
                lane = i % count
                q = x[lane] % TOTAL
                s = table.symbol[q]
                x[lane] = table.f[s] * (x[lane] // TOTAL) + q - table.start[s]
                if x[lane] < LOW:
                    need(next_word < w, "A.5", "a block needs more words than it has")
                    x[lane] = LOW * x[lane] + stored[next_word]
                    next_word += 1
                plane.append(s)
        need(next_word == w, "A.5", "a block has words left")
        need(all(state == LOW for state in x), "A.5", "a block ends with a state other than 65536")
    return planes
