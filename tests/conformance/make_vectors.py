#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Generates the conformance vectors: small files, valid or invalid in one way, the same on every
machine.

usage: make_vectors.py DIR            writes DIR/NAME.stgs for each vector
       make_vectors.py --update       writes the vectors of this folder and manifest.json: the
                                      subject of each and the results of the reference decoder
"""
import json
import os
import sys

from vector_file import VERSION, checksum
from vector_list import VECTORS
from vectors_broken_container import broken_header, broken_head, broken_index, broken_rules
from vectors_broken_records import broken_rans, broken_segment, broken_sh, broken_streams
from vectors_container import valid_container
from vectors_copies import broken_copies, damaged_heads, valid_copies
from vectors_growing import broken_growing, valid_growing
from vectors_records import valid_coded, valid_lossless

HERE = os.path.dirname(os.path.abspath(__file__))


for make in (valid_lossless, valid_coded, valid_container, valid_growing, broken_growing, broken_rules,
             broken_header, broken_head, broken_index, valid_copies, damaged_heads, broken_copies,
             broken_segment, broken_sh, broken_streams, broken_rans):
    make()


def write_all(folder):
    os.makedirs(folder, exist_ok=True)
    for v in VECTORS:
        with open(os.path.join(folder, v.name + ".stgs"), "wb") as file:
            file.write(v.data)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    if sys.argv[1] != "--update":
        write_all(sys.argv[1])
        return
    sys.path.insert(0, os.path.join(HERE, "../../spec/reference_decoder"))
    from container import Limits
    from decode import describe
    write_all(os.path.join(HERE, "vectors"))
    entries = []
    for v in VECTORS:
        lines, refused = describe(v.data, Limits(**v.limits))
        entry = {"name": v.name, "clause": v.clause, "about": v.about, "bytes": len(v.data),
                 "file": f"{checksum(v.data):016x}"}
        if v.reported:
            entry["reported"] = v.reported
        if v.may:
            entry["readers"] = "may decode it"
        if v.limits:
            entry["limits"] = v.limits
        decoded = "".join(line + "\n" for line in lines if "refused" not in line)
        entry["decoded"] = f"{checksum(decoded.encode()):016x}"
        if v.fails:
            entry["refused"] = [line.split("refused")[0].strip() or "file" for line in lines
                                if "refused" in line]
        if set(refused) != ({v.clause} if v.fails else set()):
            print(f"{v.name}, {v.clause}: {lines}")
        entries.append(entry)
    with open(os.path.join(HERE, "manifest.json"), "w", encoding="utf-8") as file:
        json.dump({"format": "1.1", "vectors": entries}, file, indent=1)
        file.write("\n")
    print(f"{len(entries)} vectors, {sum(v.fails for v in VECTORS)} invalid, "
          f"{sum(len(v.data) for v in VECTORS)} bytes")


if __name__ == "__main__":
    main()
