#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes spec/examples.md: two vectors, byte by byte.

usage: make_examples.py [--check]        --check: compares with the committed file
"""
import contextlib
import io
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "../../spec/reference_decoder"))
from annotate import annotate

EXAMPLES = os.path.join(HERE, "../../spec/examples.md")
VECTORS = (
    ("coded", "A quantised file of five primitives, whose streams are coded with rANS by a layout of their own."),
    ("growing", "A live file: each segment has a layout of its own, and each fragment an index and a copy of the head."),
)
HEAD = """<!-- SPDX-License-Identifier: Apache-2.0 -->
# Examples of .stgs files

Two of the vectors in `tests/conformance/vectors`, byte by byte: offset, bytes, and the field of `stgs-format.md` that they are, with its value. `reference_decoder/annotate.py` prints any
valid file in this form, and `reference_decoder/decode.py` what it decodes to.
"""


def examples():
    out = HEAD
    for name, about in VECTORS:
        text = io.StringIO()
        with contextlib.redirect_stdout(text), open(os.path.join(HERE, "vectors", name + ".stgs"), "rb") as file:
            annotate(file.read())
        out += f"\n## {name}.stgs\n\n{about}\n\n```\n{text.getvalue()}```\n"
    return out


if __name__ == "__main__":
    if sys.argv[1:] == ["--check"]:
        sys.exit(0 if open(EXAMPLES).read() == examples() else "spec/examples.md: run make_examples.py")
    open(EXAMPLES, "w").write(examples())
