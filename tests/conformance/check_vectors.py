#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the conformance vectors, the reference decoder and the project's decoder.

usage: check_vectors.py PROGRAM           PROGRAM is describe_vectors
       check_vectors.py PROGRAM --record  records PROGRAM's issue numbers of refused vectors in the
                                          manifest; review them before committing

The generator must produce the committed bytes. Both decoders must produce the manifest's hash and
refuse the same parts, the reference with the stated clause and PROGRAM with the stated issue number.
"""
import json
import os
import re
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "../../spec/reference_decoder"))
try:
    from container import Limits
    from decode import describe
    from fields import checksum
except ImportError as error:
    print(f"skipped: {error} (tools/setup/packages.txt)")
    sys.exit(77)
from make_vectors import VECTORS, write_all

MANIFEST = os.path.join(HERE, "manifest.json")


def split(lines):
    """Returns the lines of decoded data as text, and (part, message) for each refused part."""
    decoded = "".join(line + "\n" for line in lines if "refused: " not in line)
    refused = [line.split("refused: ", 1) for line in lines if "refused: " in line]
    return decoded, [(part.strip() or "file", message) for part, message in refused]


def program_blocks(program, paths, limits):
    """Returns PROGRAM's lines for each file; the last line lists the validator's errors."""
    arguments = []
    for name, value in limits.items():
        arguments += ["--" + name.replace("_", "-"), str(value)]
    run = subprocess.run([program, *arguments, *paths], capture_output=True, text=True, check=False)
    if run.returncode != 0:
        sys.exit(f"{program} exited with {run.returncode}: {run.stderr.strip()}")
    blocks = {}
    for line in run.stdout.splitlines():
        if line.startswith("  "):
            lines.append(line.strip())
        else:
            lines = blocks[line[:-1]] = []
    return blocks


def check(entry, data, path, program, record):
    """Yields a message for each mismatch."""
    limits = entry.get("limits", {})
    expected = entry.get("refused", [])
    lines, clauses = describe(data, Limits(**limits))
    decoded, refused = split(lines)
    if f"{checksum(decoded.encode()):016x}" != entry["decoded"]:
        yield "the reference decoder decodes other data"
    if [part for part, _ in refused] != expected or set(clauses) - {entry["clause"]}:
        yield f"the reference decoder refuses {refused}"
    lines = program_blocks(program, [path], limits)[path]
    errors = [int(n) for n in lines.pop().split()[1:]]
    other, other_refused = split(lines)
    if other != decoded:
        yield f"the decoders differ:\n{decoded}against\n{other}"
    if [part for part, _ in other_refused] != expected:
        yield f"the decoder refuses {other_refused}, the reference {refused}"
    elif "reported" in entry:
        if errors != entry["reported"]:
            yield f"the validator reports {errors}, not {entry['reported']}"
    elif bool(expected) != bool(errors):
        yield f"the validator reports {errors}"
    elif expected:
        found = re.search(r"issue (\d+)\)$", other_refused[0][1])
        issue = int(found.group(1)) if found else None
        if record:
            entry["issue"] = issue
        if issue is None or issue != entry.get("issue") or issue not in errors:
            yield f"refused with {other_refused[0][1]!r}, validated with {errors}"


def main():
    if len(sys.argv) not in (2, 3) or sys.argv[2:] not in ([], ["--record"]):
        sys.exit(__doc__)
    with open(MANIFEST, encoding="utf-8") as file:
        manifest = json.load(file)
    vectors = manifest["vectors"]
    problems = []
    if [(v.name, v.clause, v.about) for v in VECTORS] != \
            [(entry["name"], entry["clause"], entry["about"]) for entry in vectors]:
        problems.append("generator and manifest state different names, clauses or subjects")
    with tempfile.TemporaryDirectory() as folder:
        write_all(folder)
        generated = sorted(os.listdir(folder))
        names = sorted(entry["name"] + ".stgs" for entry in vectors)
        if generated != names or sorted(os.listdir(os.path.join(HERE, "vectors"))) != names:
            problems.append("generator, folder and manifest do not have the same vectors")
        for entry in vectors:
            path = os.path.join(HERE, "vectors", entry["name"] + ".stgs")
            with open(path, "rb") as file:
                data = file.read()
            with open(os.path.join(folder, entry["name"] + ".stgs"), "rb") as file:
                if file.read() != data or f"{checksum(data):016x}" != entry["file"]:
                    problems.append(f"{entry['name']}: the generator produces other bytes")
            problems += [f"{entry['name']} (clause {entry['clause']}): {problem}" for problem in
                         check(entry, data, path, sys.argv[1], len(sys.argv) == 3)]
    if len(sys.argv) == 3:
        with open(MANIFEST, "w", encoding="utf-8") as file:
            json.dump(manifest, file, indent=1)
            file.write("\n")
    for problem in problems:
        print(problem)
    invalid = sum("refused" in entry or "reported" in entry for entry in vectors)
    print(f"{len(vectors)} vectors, {invalid} invalid, {len(problems)} problems")
    if len(vectors) < 60 or invalid < 30:
        print("fewer than 60 vectors, or fewer than 30 invalid ones")
        sys.exit(1)
    sys.exit(1 if problems else 0)


if __name__ == "__main__":
    main()
