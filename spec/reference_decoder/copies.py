# SPDX-License-Identifier: Apache-2.0
"""Clause 3.6: a damaged head, and its copy."""
from fields import RECORD, Refused, checksum, need, record_at
from frames import check_stored, unpack

HEADER = 40
MAGIC = b"\x89STG\r\n\x1a\n"
MAX_SKIPPED = 64


def number(data, at, size):
    return int.from_bytes(data[at:at + size], "little")


def is_valid(header):
    return len(header) == HEADER and header[:8] == MAGIC and number(header, 32, 8) == checksum(header[:32])


def sizes(header):
    """Returns whether the file is growing, file_bytes and head_bytes."""
    return number(header, 12, 4) & 1 == 1, number(header, 16, 8), number(header, 24, 8)


def is_damaged(head):
    """Returns whether a head with a valid header is damaged."""
    try:
        at = HEADER
        while at < len(head):
            _, _, payload, payload_sum = record_at(head, at, len(head))
            need(checksum(payload) == payload_sum, "3.1", "the checksum of a record")
            at += RECORD + len(payload)
        return False
    except Refused:
        return True


def head_in_copy(data, at, limits):
    """Returns the head in the COPY record at `at`, or None if the copy is not usable."""
    try:
        tag, flags, payload, payload_sum = record_at(data, at, len(data))
        need((tag, flags) == (b"COPY", 0) and checksum(payload) == payload_sum, "3.6", "no copy")
        need(len(payload) >= HEADER + 8 and number(payload, len(payload) - 8, 8) == len(payload), "3.6", "its length")
        header, stored = payload[:HEADER], payload[HEADER:-8]
        need(is_valid(header), "3.6", "its header")
        growing, file_bytes, head_bytes = sizes(header)
        need(HEADER <= head_bytes <= len(data), "3.6", "its head")
        if is_valid(data[:HEADER]):
            need(header == data[:HEADER], "3.6", "another header")
        else:
            need(file_bytes == (0 if growing else len(data)), "3.6", "a file of another size")
        end = at + RECORD + len(payload)
        need(at == head_bytes if growing else end == file_bytes, "3.6", "another location")
        need(max(head_bytes, len(payload)) <= limits.max_memory, "conformance 1.5", "a copy of the head")
        check_stored(stored, head_bytes - HEADER)
        head = header + unpack(stored, head_bytes - HEADER)
    except Refused:
        return None
    return None if is_damaged(head) else head


def ending_at(data, end, limits):
    if not HEADER + RECORD + 8 <= end <= len(data):
        return None
    at = end - RECORD - number(data, end - 8, 8)
    return head_in_copy(data, at, limits) if at >= 0 else None


def after_records(data, limits):
    at = HEADER
    try:
        for _ in range(MAX_SKIPPED + 1):
            tag, _, payload, _ = record_at(data, at, len(data))
            if tag == b"COPY":
                return head_in_copy(data, at, limits)
            if tag in (b"SEGM", b"FRAG"):
                return None
            at += RECORD + len(payload)
    except Refused:
        pass
    return None


def repaired_head(data, limits):
    """Returns the head from the copy of a damaged one; None if the head is intact or no copy is
    usable."""
    header = data[:HEADER]
    if len(header) < HEADER:
        return None
    if not is_valid(header):
        return ending_at(data, len(data), limits) or after_records(data, limits)
    growing, file_bytes, head_bytes = sizes(header)
    if head_bytes > len(data) or not is_damaged(data[:head_bytes]):
        return None
    return head_in_copy(data, head_bytes, limits) if growing else ending_at(data, file_bytes, limits)
