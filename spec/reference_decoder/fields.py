# SPDX-License-Identifier: Apache-2.0
"""Clauses 1 and 3: fields, checksums, records, and refusing a file or a part of it."""
import struct
import zlib

RECORD = 24  # bytes of a record header (3.1)


class Refused(Exception):
    """A rule of the text that the file contradicts: its clause, and the number of the issue in
    conformance.md 2."""

    def __init__(self, clause, number, reason):
        super().__init__(f"clause {clause}: {reason} (issue {number})")
        self.clause, self.number = clause, number


LIMIT = 308  # more memory than the limit (conformance.md 1.5)


def need(holds, clause, number, reason):
    if not holds:
        raise Refused(clause, number, reason)


def need_memory(bytes_, memory, reason):  # conformance.md 1.5
    need(bytes_ <= memory, "conformance 1.5", LIMIT, reason)


def checksum(data):  # 1.5
    return zlib.crc32(data)


class Fields:
    """Reads one field after the other (1.3); if the bytes end too soon, it refuses them with `clause`
    and `number`."""

    def __init__(self, data, clause, number):
        self.data, self.at, self.clause, self.issue = data, 0, clause, number

    def left(self):
        return len(self.data) - self.at

    def bytes(self, count):
        need(count <= self.left(), self.clause, self.issue,
             f"needs {count} bytes at {self.at}, has {self.left()}")
        self.at += count
        return self.data[self.at - count:self.at]

    def _one(self, form):
        return struct.unpack("<" + form, self.bytes(struct.calcsize("<" + form)))[0]

    def u8(self):  # 1.4
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

    def f32s(self, count):
        return [self.f32() for _ in range(count)]

    def text(self, number=None):  # 1.4
        """Returns the bytes of a text; `number` is the issue of one that is not UTF-8."""
        data = self.bytes(self.u32())
        try:
            data.decode("utf-8")
        except UnicodeDecodeError:
            raise Refused("1.4", number or self.issue, "a text that is not UTF-8") from None
        return data

    def number(self):  # 1.4
        value, shift = 0, 0
        while True:
            byte = self.u8()
            value |= (byte & 127) << shift
            need(value < 1 << 64, "1.4", self.issue, "a number beyond 64 bits")
            if byte < 128:
                need(byte > 0 or shift == 0, "1.4", self.issue, "a number of more bytes than it needs")
                return value
            shift += 7


def record_header(data, at, end):
    """Returns tag, flags, length of the payload and its stated checksum of the record at `at` in an
    area that ends at `end` (3.1, 3.2). `data` may be truncated (2.4)."""
    need(end - at >= RECORD, "3.2", 110, f"a record header is cut off at {at}")
    need(at + RECORD <= len(data), "2.4", 106, f"the record at {at} is missing")
    head = Fields(data[at:at + RECORD], "3.1", 110)
    tag, flags, length, payload_sum = head.bytes(4), head.u32(), head.u64(), head.u32()
    need(head.u32() == checksum(data[at:at + 20]), "3.1", 110, f"checksum of the record header at {at}")
    need(length <= end - at - RECORD, "3.2", 111, f"the record at {at} extends past its area")
    return tag, flags, length, payload_sum


def check_available(data, at, length):
    """Checks that a truncated file contains the record at `at`, of `length` bytes of payload (2.4)."""
    need(at + RECORD + length <= len(data), "2.4", 106, f"the record at {at} is missing or cut off")


def check_payload(data, at):
    """Returns the payload of the record at `at`, whose header has been checked and which is there (3.1)."""
    length, payload_sum = struct.unpack_from("<QI", data, at + 8)
    payload = data[at + RECORD:at + RECORD + length]
    need(checksum(payload) == payload_sum, "3.1", 112, f"checksum of the payload at {at}")
    return payload


def intact_record(data, at, end):
    """Returns tag, flags and payload of the record at `at`, if it is intact (3.2)."""
    tag, flags, _, _ = record_header(data, at, end)
    return tag, flags, check_payload(data, at)
