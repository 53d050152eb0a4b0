# SPDX-License-Identifier: Apache-2.0
"""Clauses 2 and 3: the header and the records of the head; 10.2: a damaged head."""
from dataclasses import dataclass

from fields import (LIMIT, RECORD, Fields, Refused, check_payload, checksum, intact_record, need, need_memory,
                    record_header)

HEADER = 32
MAGIC = b"\x89STG\r\n\x1a\n"
HEAD_CRITICAL = (b"META", b"LAYT", b"INDX")
BODY_CRITICAL = (b"PAGE", b"FRAG", b"SEGM")
ASIDE = (b"WNDW", b"PRIV", b"STEP", b"ERRB")  # not critical, in the head (3.3)


@dataclass
class Header:  # 2.1
    major: int
    minor: int
    flags: int
    file_bytes: int
    head_bytes: int

    def growing(self):
        return self.flags & 1 == 1


def read_header(data):
    need(len(data) >= HEADER, "2.1", 101, "shorter than a header")
    need(data[:8] == MAGIC, "2.1", 102, "another magic")
    fields = Fields(data[8:HEADER], "2.1", 101)
    header = Header(fields.u16(), fields.u16(), fields.u32(), fields.u64(), fields.u32())
    need(fields.u32() == checksum(data[:28]), "2.1", 103, "checksum of the header")
    return header


def check_header(header):
    """Refuses what no copy of the head can repair."""
    need(header.major == 2, "2.2", 104, f"version {header.major}.{header.minor}")
    need(header.flags & 0xFFFC == 0, "2.2", 105, f"flags {header.flags:#x}")
    need(not header.growing() or header.file_bytes == 0, "2.1", 107, "a growing file states its size")
    need(header.head_bytes >= HEADER, "2.1", 107, f"a head of {header.head_bytes} bytes")
    need(header.growing() or header.head_bytes <= header.file_bytes, "2.1", 107,
         f"a head of {header.head_bytes} bytes in a file of {header.file_bytes}")


def check_records(head):
    """Refuses a head with a record that is not intact (10.2). Returns the error of a record's
    payload that does not make the file unusable (3.4), or None."""
    at, tolerable = HEADER, None
    while at < len(head):
        _, flags, length, _ = record_header(head, at, len(head))
        try:
            intact_record(head, at, len(head))
        except Refused as error:
            if flags & 1 == 1:
                raise
            tolerable = error
        at += RECORD + length
    return tolerable


def intact_head(data, memory):
    """Returns the header and the bytes of an undamaged head that `data` begins with (10.2)."""
    header = read_header(data)
    need(header.head_bytes <= len(data), "2.4", 106, "the file ends within its head")
    need_memory(header.head_bytes, memory, f"a head of {header.head_bytes} bytes")
    head = data[:header.head_bytes]
    error = check_records(head)
    if error:
        raise error
    return header, head


def head_in_copy(data, memory):
    """Returns the header and the head in the COPY record that ends the file (10.2, step 2)."""
    length = int.from_bytes(data[-8:], "little")
    need(length <= len(data) - RECORD, "10.2", 119, "no COPY record")
    at = len(data) - RECORD - length
    tag, flags, found, _ = record_header(data, at, len(data))
    need((tag, flags, found) == (b"COPY", 0, length), "10.2", 119, "no COPY record")
    need_memory(length - 8, memory, f"a copy of {length - 8} bytes")
    payload = check_payload(data, at)
    header, head = intact_head(payload[:-8], memory)
    need(len(head) == len(payload) - 8, "10.2", 119, "a copy of another length")
    need(header.file_bytes == len(data), "10.2", 119, "a copy of another file")  # 0 in a growing one
    return header, head


def open_head(data, memory, fragment_head, reports):
    """Returns the header and the head to be used (10.2). fragment_head() returns the head in the last
    fragment; none: no bytes."""
    try:
        check_header(read_header(data))
        return intact_head(data, memory)
    except Refused as error:
        if error.number in (104, 105, 107, LIMIT):
            raise
        damage = error
    for find in (lambda: head_in_copy(data, memory), lambda: intact_head(fragment_head(), memory)):
        try:
            header, head = find()
        except Refused as error:
            if error.number == LIMIT:
                raise
            continue
        check_header(header)
        reports.append(Refused("10.2", 118, f"the head is damaged and was read from a copy: {damage}"))
        return header, head
    header = read_header(data)  # step 4
    need(header.head_bytes <= len(data), "2.4", 106, "the file ends within its head")
    head = data[:header.head_bytes]
    check_records(head)
    return header, head


def head_records(head, growing, reports):
    """Returns the payloads of the records of a head by tag (2.3, 3.3, 3.4)."""
    have = {}
    at = HEADER
    while at < len(head):
        tag, flags, length, _ = record_header(head, at, len(head))
        try:
            read_head_record(head, at, tag, flags, growing, have)
        except Refused as error:
            if flags & 1 == 1 or tag in HEAD_CRITICAL + BODY_CRITICAL:
                raise
            reports.append(error)
        at += RECORD + length
    need(b"META" in have and (growing or b"INDX" in have), "2.3", 115, "no META or INDX")
    return have


def read_head_record(head, at, tag, flags, growing, have):
    if tag in HEAD_CRITICAL + BODY_CRITICAL:
        need(flags & 1 == 1, "3.3", 116, f"{tag} is not marked critical")
    if flags & 1 == 1:
        known = tag in HEAD_CRITICAL and not (growing and tag == b"INDX")
        need(flags == 1 and known, "3.4", 113, f"critical record {tag}, flags {flags:#x}, in the head")
    payload = intact_record(head, at, len(head))[2]
    if flags == 1 or (flags == 0 and tag in ASIDE):
        need(tag not in have, "2.3", 114, f"a second {tag}")
        need(tag != b"INDX" or b"META" in have, "2.3", 115, "INDX before META")
        have[tag] = payload
