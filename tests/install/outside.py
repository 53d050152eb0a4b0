# SPDX-License-Identifier: Apache-2.0
"""What the tests of installed things share: running programs, pictures, and which header is which
library's."""
import glob
import os
import struct
import subprocess
import zlib


def run(*command, **options):
    result = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert result.returncode == 0, f"{command}:\n{result.stdout}\n{result.stderr}"
    return result.stdout


LIBRARIES = ("stgs", "stgs_encoder")


def headers_of(library, folder):
    """The paths of the C headers that declare a library's functions, in a folder of them all."""
    paths = sorted(glob.glob(os.path.join(folder, "*.h")))
    return [path for path in paths
            if os.path.basename(path).startswith("stgs_encoder") == (library == "stgs_encoder")]


def read_ppm(path):
    with open(path, "rb") as file:
        assert file.readline() == b"P6\n"
        width, height = map(int, file.readline().split())
        assert file.readline() == b"255\n"
        pixels = file.read()
    assert len(pixels) == 3 * width * height
    return width, height, pixels


def write_png(path, width, height, pixels):
    def chunk(tag, body):
        return struct.pack(">I", len(body)) + tag + body + struct.pack(">I", zlib.crc32(tag + body))
    rows = b"".join(b"\0" + pixels[3 * width * y:3 * width * (y + 1)] for y in range(height))
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n"
                   + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
                   + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
