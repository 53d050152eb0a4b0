# SPDX-License-Identifier: Apache-2.0
"""Clause 9: the fragments of growing files."""
from dataclasses import dataclass

from fields import LIMIT, RECORD, Fields, Refused, check_payload, need, need_memory, record_header
from head import HEADER, intact_head
from index import Entries, Node, read_links, read_node
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


class Fragments:
    """The FRAG records of a growing file. `head` is that of the file; None if it is damaged (10.2)."""

    def __init__(self, data, head, memory):
        self.data, self.head, self.memory = data, head, memory
        self.first = HEADER if head is None else len(head)  # of the body
        self.is_located = False  # a damaged record, by the last 8 bytes (9.4)
        self.in_vain = {}  # bytes of the payloads of records that searches have examined in vain, by offset

    def read(self, at, stated=None):
        """Returns the FRAG record at `at`, of `stated` bytes of payload, if it is valid (9.4)."""
        need(at >= self.first, "9.4", 313, f"no FRAG record at {at}")
        tag, flags, length, _ = record_header(self.data, at, len(self.data))
        need(tag == b"FRAG" and stated in (None, length), "9.4", 313, f"no FRAG record of {stated} bytes at {at}")
        need_memory(length, self.memory, f"a FRAG record of {length} bytes")
        need(flags == 1, "9.4", 313, f"flags {flags} of the FRAG record at {at}")
        payload = check_payload(self.data, at)
        f = Fields(payload, "9.2", 313)
        need(f.u64() == at, "9.4", 313, f"the fragment at {at} states another offset")
        frames, flags, bounds, total = f.u32(), f.u32(), f.f32s(6), f.number()
        copy = f.bytes(f.u32())
        if self.head is None:
            header, copied = intact_head(copy, self.memory)
            need(header.growing() and len(copied) == len(copy), "9.4", 313, f"the head in the fragment at {at}")
        need(copy == (copy if self.head is None else self.head) and at >= len(copy), "9.4", 313,
             f"the fragment at {at} belongs to another file")
        need(frames > 0, "9.2", 313, "a duration of no frames")
        check_bounds(bounds, "9.2", 313)
        earlier = read_links(f, at, (len(copy), at), Entries(self.memory), True)
        node = read_node(f, at, (len(copy), at), self.memory, True)
        end = at + RECORD + len(payload)
        need(f.left() >= 8 and payload[-8:] == len(payload).to_bytes(8, "little"), "9.2", 313,
             f"the last bytes of the fragment at {at}")
        return Fragment(at, end, frames, flags, bounds, total, copy, earlier, node)

    def last_before(self, end):
        """Returns the valid FRAG record that begins last of those before `end`, or None."""
        at = end
        while self.may_examine() and (at := self.data.rfind(b"FRAG", self.first, at)) >= 0:
            try:
                length = record_header(self.data, at, len(self.data))[2]
            except Refused:
                continue
            try:
                return self.read(at)
            except Refused as error:
                if error.number == LIMIT:
                    raise
                self.in_vain[at] = length
        return None

    def may_examine(self):  # conformance.md 1.5
        return sum(self.in_vain.values()) <= len(self.data)

    def last(self):  # 9.4
        size = int.from_bytes(self.data[-8:], "little")
        at = len(self.data) - RECORD - size
        try:
            found = self.read(at)
            if found.end == len(self.data):
                return found
        except Refused as error:
            if error.number == LIMIT:
                raise
            stated = self.data[at + RECORD:at + RECORD + 8]
            self.is_located = size >= 40 and at >= self.first and stated == at.to_bytes(8, "little")
        return self.last_before(len(self.data))

    def damaged(self):
        """Returns whether a FRAG record after the last fragment, which last() has looked for, is damaged (9.4)."""
        return self.is_located or any(map(self.is_own, self.in_vain))

    def is_own(self, at):
        """Returns whether a record is not intact or states its own offset; others are of another file."""
        try:
            return check_payload(self.data, at)[:8] == at.to_bytes(8, "little")
        except Refused:
            return True
