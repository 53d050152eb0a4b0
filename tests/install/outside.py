# SPDX-License-Identifier: Apache-2.0
"""What the tests of installed things share: running programs, pictures, and which header is which
library's."""
import glob
import io
import os
import subprocess


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
    """Width, height, and the bytes of the pixels."""
    with open(path, "rb") as file:
        return pixels_of(file)


def read_png(path):
    """The same of a PNG, by FFmpeg."""
    ppm = subprocess.run(["ffmpeg", "-v", "error", "-i", path, "-pix_fmt", "rgb24",
                          "-f", "image2pipe", "-c:v", "ppm", "-"], capture_output=True, check=True)
    return pixels_of(io.BytesIO(ppm.stdout))


def pixels_of(file):
    assert file.readline() == b"P6\n"
    width, height = map(int, file.readline().split())
    assert file.readline() == b"255\n"
    pixels = file.read()
    assert len(pixels) == 3 * width * height
    return width, height, pixels
