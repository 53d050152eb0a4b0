# SPDX-License-Identifier: Apache-2.0
"""Shared by all clauses: reading fields, checksums, and refusing a file."""
import struct

import xxhash

RECORD = 32  # bytes of a record header (3.1)


class Refused(Exception):
    """A "must" of the text that the file does not satisfy. `unsupported`: the file may be valid, but
    uses features that this version does not know, or exceeds the limits."""

    def __init__(self, clause, reason, unsupported=False):
        super().__init__(f"clause {clause}: {reason}")
        self.clause, self.reason, self.unsupported = clause, reason, unsupported


def need(holds, clause, reason, unsupported=False):
    if not holds:
        raise Refused(clause, reason, unsupported)


def checksum(data):  # 1.5
    return xxhash.xxh3_64_intdigest(bytes(data))


class Fields:
    """Reads one field after the other (1.3); refuses with `clause` if the bytes end too soon."""

    def __init__(self, data, clause):
        self.data, self.at, self.clause = data, 0, clause

    def left(self):
        return len(self.data) - self.at

    def bytes(self, count):
        need(count <= self.left(), self.clause, f"needs {count} bytes at {self.at}, has {self.left()}")
        self.at += count
        return self.data[self.at - count:self.at]

    def _one(self, form):
        return struct.unpack("<" + form, self.bytes(struct.calcsize("<" + form)))[0]

    def u8(self):  # 1.2
        return self._one("B")

    def i8(self):
        return self._one("b")

    def u16(self):
        return self._one("H")

    def i16(self):
        return self._one("h")

    def u32(self):
        return self._one("I")

    def u64(self):
        return self._one("Q")

    def f32(self):
        return self._one("f")

    def f64(self):
        return self._one("d")

    def text(self):  # 1.4, 4.3
        try:
            return self.bytes(self.u32()).decode("utf-8")
        except UnicodeDecodeError:
            raise Refused("4.3", "a text that is not UTF-8") from None

    def number(self):  # 1.8
        value, shift = 0, 0
        while True:
            byte = self.u8()
            value |= (byte & 127) << shift
            need(value < 1 << 64 and shift <= 63, "1.8", "a number beyond 64 bits")
            if byte < 128:
                need(byte > 0 or shift == 0, "1.8", "a number of more bytes than it needs")
                return value
            shift += 7


def record_at(data, at, end):
    """Returns tag, flags, payload and stated payload checksum of the record at `at` (3.1, 3.3)."""
    need(end - at >= RECORD, "3.3", f"a record header is truncated at {at}")
    head = data[at:at + RECORD]
    fields = Fields(head, "3.1")
    tag, flags, length = fields.bytes(4), fields.u32(), fields.u64()
    payload_sum = fields.u64()
    need(fields.u64() == checksum(head[:24]), "3.1", f"the checksum of the record header at {at}")
    need(length <= end - at - RECORD, "3.3", f"record {tag} extends past the end of its area")
    return tag, flags, data[at + RECORD:at + RECORD + length], payload_sum
