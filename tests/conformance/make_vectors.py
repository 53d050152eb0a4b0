#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Generates the conformance vectors: small files, valid or invalid in one way, the same on every machine.

usage: make_vectors.py DIR            writes DIR/NAME.stgs for each vector
       make_vectors.py --update       writes the vectors of this folder and manifest.json: the subject of each
                                      and the results of the reference decoder
"""
import hashlib
import json
import os
import sys

from expected_floats import expected_floats, is_outside
from vector_list import VECTORS
from vectors_broken_groups import broken_groups
from vectors_broken_head import broken_head
from vectors_broken_index import broken_index
from vectors_broken_records import broken_records
from vectors_broken_streams import broken_streams
from vectors_container import valid_container
from vectors_damage import damage
from vectors_ends import valid_ends, broken_ends
from vectors_growing import damaged_growing, valid_growing
from vectors_index import valid_index
from vectors_mappings import valid_streams
from vectors_order import orders
from vectors_records import valid_records
from vectors_searches import searches

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "../../spec/reference_decoder"))

for make in (valid_container, valid_index, valid_records, valid_streams, valid_growing, damaged_growing, valid_ends, broken_ends,
             searches, damage, broken_head, broken_index, broken_records, broken_groups, broken_streams,
             orders):
    make()


def sha(data):
    return hashlib.sha256(data).hexdigest()


def write_all(folder):
    os.makedirs(folder, exist_ok=True)
    for v in VECTORS:
        with open(os.path.join(folder, v.name + ".stgs"), "wb") as file:
            file.write(v.data)


def entry_of(v, out):
    """Returns the entry of a vector in the manifest; `out` is the reference decoder's Description."""
    entry = {"name": v.name, "clause": v.clause, "about": v.about, "bytes": len(v.data), "file": sha(v.data)}
    if v.limits:
        entry["limits"] = v.limits
    entry["decoded"] = sha(out.text().encode())
    if out.reports:
        entry["reported"] = [error.number for error in out.reports]
    if out.refused:
        entry["refused"] = [[part, error.number] for part, error in out.refused]
    validator = sorted(set(v.validator) | ({504} if is_outside(out) else set()))
    if validator:
        entry["validator"] = validator
    if v.floats:
        entry["floats"] = expected_floats(out)
    return entry


def surprises(v, out):
    """Returns whether the reference decoder finds something else than the vector is to show."""
    found = {error.clause for error in out.reports} | {error.clause for _, error in out.refused}
    return bool(out.refused) != v.fails or bool(out.reports) != v.reports or (found and v.found not in found)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    if sys.argv[1] != "--update":
        write_all(sys.argv[1])
        return
    from container import Limits
    from decode import describe
    folder = os.path.join(HERE, "vectors")
    write_all(folder)
    entries = []
    for v in VECTORS:
        out = describe(v.data, Limits(**v.limits))
        entries.append(entry_of(v, out))
        if surprises(v, out):
            print(f"{v.name}, {v.clause}:", *out.reports, *[f"{part}: {error}" for part, error in out.refused], sep="\n  ")
    names = [v.name + ".stgs" for v in VECTORS]
    if len(set(names)) != len(names):
        print("names that occur twice:", sorted({n for n in names if names.count(n) > 1}))
    for name in set(os.listdir(folder)) - set(names):
        os.remove(os.path.join(folder, name))
    with open(os.path.join(HERE, "manifest.json"), "w", encoding="utf-8") as file:
        lines = ",\n".join(json.dumps(entry, ensure_ascii=False) for entry in entries)
        file.write('{"format": "2.0", "vectors": [\n' + lines + "\n]}\n")
    print(f"{len(entries)} vectors, {sum(v.fails or v.reports for v in VECTORS)} with errors, "
          f"{sum(len(v.data) for v in VECTORS)} bytes")


if __name__ == "__main__":
    main()
