# SPDX-License-Identifier: Apache-2.0
"""Clause 9: the fragments of growing files."""
from dataclasses import dataclass

from fields import RECORD, Fields, Refused, intact_record, need, record_header
from head import HEADER, intact_head
from index import Node, read_links, read_node
from metadata import check_bounds


@dataclass
class Fragment:  # 9.2
    at: int
    end: int
    frames: int
    flags: int
    bounds: list
    total: int
    head: bytes
    earlier: list
    node: Node


def read_fragment(data, at, head=None):
    """Returns the FRAG record at `at`, if it is valid (9.4). `head` is that of the file; None if it is
    damaged (10.2)."""
    tag, flags, payload = intact_record(data, at, len(data))
    need((tag, flags) == (b"FRAG", 1), "9.4", 313, f"no FRAG record at {at}")
    f = Fields(payload, "9.2", 313)
    need(f.u64() == at, "9.4", 313, f"the fragment at {at} states another offset")
    frames, flags, bounds, total = f.u32(), f.u32(), f.f32s(6), f.number()
    copy = f.bytes(f.u32())
    if head is None:
        header, copied = intact_head(copy)
        need(header.growing() and len(copied) == len(copy), "9.4", 313, f"the head in the fragment at {at}")
    need(copy == (copy if head is None else head) and at >= len(copy), "9.4", 313,
         f"the fragment at {at} belongs to another file")
    need(frames > 0, "9.2", 313, "a duration of no frames")
    check_bounds(bounds, "9.2", 313)
    earlier = read_links(f, at, (len(copy), at), True)
    node = read_node(f, at, (len(copy), at), True)
    end = at + RECORD + len(payload)
    need(f.left() >= 8 and payload[-8:] == len(payload).to_bytes(8, "little"), "9.2", 313,
         f"the last bytes of the fragment at {at}")
    return Fragment(at, end, frames, flags, bounds, total, copy, earlier, node)


def last_before(data, end, head, limit):
    """Returns the valid FRAG record that begins last of those before `end`, or None. It reads at most
    `limit` bytes of payloads (conformance.md 1.5)."""
    at = end
    while (at := data.rfind(b"FRAG", HEADER, at)) >= 0:
        try:
            limit -= record_header(data, at, len(data))[2]
            return read_fragment(data, at, head)
        except Refused:
            pass
        if limit < 0:
            break
    return None


def last_fragment(data, head, limit):  # 9.4
    try:
        found = read_fragment(data, len(data) - RECORD - int.from_bytes(data[-8:], "little"), head)
        if found.end == len(data):
            return found
    except Refused:
        pass
    return last_before(data, len(data), head, limit)
