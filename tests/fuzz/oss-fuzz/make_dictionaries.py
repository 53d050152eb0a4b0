#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the dictionaries of the fuzz targets: tags, magic numbers and names that readers compare with. They
come from the sources of the readers, where these have a regular form, and from the lists below.

usage: make_dictionaries.py [--check]     --check: writes nothing; exit code 1 if a dictionary is out of date
"""
import os
import re
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(HERE)))
TAG = r'\btag(?:_of)?\("(\w{4})"\)'
JSON_KEY = r'\bmember\([^"]*, "(\w+)"\)'
NAME = r'"([a-z][a-z0-9_]*)"'  # names of properties, types and elements
TEXT = r'\[\] = "([\w-]+)"|= "([\w-]+)"'

# Name: files and the form of their entries, and further entries, Latin-1.
DICTIONARIES = {
    "stgs": ([("format/src/container/container.h", TAG)],
             ["\x89STG\r\n\x1a\n", "\x01\x00\x00\x00", "\x02\x00\x00\x00", "\x80\x00\x00\x00", "\x00\x00\x00\x80",
              "\xff\xff", "\xff\xff\xff\xff", "\x00\x00\x00\x00\x00\x00\xf0?", "DRACO"]),
    "stgs1": ([("format/src/interchange/stgs1/file.h", TAG), ("format/src/interchange/stgs1/head.cpp", TAG),
               ("format/src/interchange/stgs1/extras.cpp", TAG), ("format/src/interchange/stgs1/stgs1.cpp", TAG),
               ("format/src/interchange/stgs1/fragments.cpp", TAG), ("format/src/interchange/stgs1/index.cpp", TAG),
               ("format/src/interchange/stgs1/head_copy.cpp", TAG)],
              ["\x89STG\r\n\x1a\n", "\x28\xb5\x2f\xfd", "\x01\x00\x00\x00", "\xff\xff\xff\xff"]),
    "ply": ([("format/src/core/ply_header.cpp", NAME), ("format/src/interchange/ply_packed.cpp", NAME),
             ("format/src/interchange/ply_read.cpp", NAME), ("format/src/interchange/ftgs_ply.cpp", NAME)],
            ["ply\n", "ply\r\n", "format ascii 1.0", "format binary_little_endian 1.0",
             "format binary_big_endian 1.0", "property list uchar int ", "element vertex ", "end_header\n",
             "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0", "f_rest_8", "f_rest_44", "f_rest_71", "scale_0", "scale_1",
             "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "nan", "inf", "-inf", "1e39", "1e-50"]),
    "spz": ([], ["NGSP", "\x1f\x8b\x08\x00", "\x28\xb5\x2f\xfd", "\x03\x00\xbe\xad", "\x02\x00\x00\x00",
                 "\x03\x00\x00\x00", "\x04\x00\x00\x00"]),
    "sog": ([("format/src/interchange/sog.cpp", JSON_KEY), ("format/src/interchange/sog_layout.cpp", JSON_KEY),
             ("format/src/interchange/sogst.cpp", JSON_KEY), ("format/src/interchange/tsog.cpp", JSON_KEY)],
            ["PK\x03\x04", "PK\x01\x02", "PK\x05\x06", "RIFF", "WEBPVP8L", "WEBPVP8X", "meta.json", "webp",
             "org.opsiclear.tsog-playback", "sogst", "null", "[]", "{}", "1e308", "-1", "4294967295"]),
    "splatv": ([("format/src/interchange/splatv.cpp", JSON_KEY)],
               ["\x4b\x67\x00\x00", "splat", "cameras", "size", "texwidth", "texheight", "type", "position",
                "rotation", "fx", "fy", "width", "height", "null", "[]", "{}", "1e308", "-1", "4294967295"]),
    "fourdgs": ([("format/src/interchange/fourdgs_format.h", TEXT)],
                ["\x894DGS1\r\n", "linear-rec709-display", "color_space", "coordinate_system", "title",
                 "stgs_frame_seconds", "y-up", "z-up", "left-handed", "zstd", "deflate", "\x28\xb5\x2f\xfd",
                 "\x78\x9c", "1/30", "\x05\x00\x00\x00", "\x07\x00\x00\x00"]),
    "camera_json": ([("encoder/src/camera_json.cpp", r'"([a-z]{2,11})"')],
                    ["1e308", "-0", "32769", "null", "true", "false", "[1,0,0,0,1,0,0,0,1]"]),
}
# Targets of several formats: their dictionary joins these.
JOINED = {"import": ("ply", "spz", "sog", "splatv", "fourdgs", "stgs1")}


def quoted(entry):
    """Returns an entry in the notation of libFuzzer and AFL."""
    out = ""
    for byte in entry.encode("latin-1"):
        plain = 0x20 <= byte < 0x7F and byte not in b'"\\'
        out += chr(byte) if plain else f"\\x{byte:02x}"
    return f'"{out}"'


def entries_of(name):
    sources, further = DICTIONARIES[name]
    found = set()
    for path, form in sources:
        with open(os.path.join(ROOT, path), encoding="utf-8") as file:
            for match in re.finditer(form, re.sub(r"(?m)^#include.*$|//.*$", "", file.read())):
                found.add(next(group for group in match.groups() if group))
    return sorted(found) + [entry for entry in further if entry not in found]


def texts():
    """Returns the text of each dictionary by its file name."""
    entries = {name: entries_of(name) for name in DICTIONARIES}
    for name, parts in JOINED.items():
        entries[name] = list(dict.fromkeys(entry for part in parts for entry in entries[part]))
    head = "# SPDX-License-Identifier: Apache-2.0\n# Written by make_dictionaries.py.\n"
    return {f"{name}.dict": head + "".join(quoted(e) + "\n" for e in entries[name]) for name in entries}


def main():
    if sys.argv[1:] not in ([], ["--check"]):
        sys.exit(__doc__)
    outdated = []
    for name, text in texts().items():
        path = os.path.join(HERE, name)
        present = open(path, encoding="ascii").read() if os.path.exists(path) else ""
        if present == text:
            continue
        outdated.append(name)
        if not sys.argv[1:]:
            with open(path, "w", encoding="ascii") as file:
                file.write(text)
    if sys.argv[1:] and outdated:
        sys.exit(f"out of date: {', '.join(outdated)}; run tests/fuzz/oss-fuzz/make_dictionaries.py")


if __name__ == "__main__":
    main()
