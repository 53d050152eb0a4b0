# SPDX-License-Identifier: Apache-2.0
"""Clause 7: tables, and groups of planes."""
import struct
from itertools import accumulate

from fields import need

TOTAL = 4096
LOW = 65536
BLOCK = 8192


class _Bits:
    """Reads bits, in each byte the lowest first (7.2)."""

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
            need(u <= 12 - k, "7.2", 409, "a number of a table beyond its greatest")
        return self.take(k + u) + (1 << (k + u)) - (1 << k)


class Table:  # 7.2
    def __init__(self, fields):
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
        need(s == z, "7.2", 409, "a table passes its greatest symbol")
        need(bits.byte == 0, "7.2", 409, "bits after a table that are not 0")
        f[z] = TOTAL - sum(f)
        need(f[z] > 0, "7.2", 409, "frequencies that add up to 4096 or more before the last")
        self.f = f
        self.only = z if f[z] == TOTAL else None  # a table of one symbol
        self.start = [0, *accumulate(f)]
        self.symbol = [s for s in range(256) for _ in range(f[s])]


def lanes_of(m):  # 7.1
    lanes = 1
    while 256 * lanes < m:
        lanes *= 2
    return lanes


def block_sizes(data, n):
    """Returns the symbols, lanes and words of each block of a group of n symbols a plane, after the
    checks of 7.3."""
    symbols = [min(BLOCK, n - first) for first in range(0, n, BLOCK)]
    lanes = [lanes_of(m) for m in symbols]
    stated = 4 * (len(symbols) - 1)
    need(len(data) >= stated, "7.3", 405, "a group without the words of its blocks")
    words = list(struct.unpack_from(f"<{len(symbols) - 1}I", data))
    left = len(data) - stated - 4 * sum(lanes) - 2 * sum(words)
    need(left >= 0 and left % 2 == 0, "7.3", 405, "blocks that do not fit their group")
    return list(zip(symbols, lanes, words + [left // 2])), stated


def decode_group(data, n, tables):
    """Returns the planes of n symbols, one for each table, each of more than one symbol."""
    if n == 0 or not tables:  # 7.1
        need(len(data) == 0, "7.1", 405, "a group of no symbols that has bytes")
        return [b""] * len(tables)
    blocks, at = block_sizes(data, n)
    planes = [bytearray() for _ in tables]
    for m, lanes, count, in blocks:
        x = list(struct.unpack_from(f"<{lanes}I", data, at))
        words = struct.unpack_from(f"<{count}H", data, at + 4 * lanes)
        at += 4 * lanes + 2 * count
        need(min(x) >= LOW, "7.3", 405, "a state below 65536")
        decode_block(x, words, m, tables, planes)
    return planes


def decode_block(x, words, m, tables, planes):  # 7.4
    taken = 0
    for table, plane in zip(tables, planes):
        for i in range(m):  # step i // len(x), lane i % len(x)
            lane = i % len(x)
            q = x[lane] % TOTAL
            s = table.symbol[q]
            x[lane] = table.f[s] * (x[lane] // TOTAL) + q - table.start[s]
            if x[lane] < LOW:
                need(taken < len(words), "7.4", 405, "a block needs more words than it has")
                x[lane] = LOW * x[lane] + words[taken]
                taken += 1
            plane.append(s)
    need(taken == len(words), "7.4", 405, "words of a block that are not read")
    need(all(state == LOW for state in x), "7.4", 405, "a block ends with a state other than 65536")
