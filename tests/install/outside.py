# SPDX-License-Identifier: Apache-2.0
"""Shared by the installation tests: running programs, reading images, and the headers of each
library."""
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
    """Returns the paths of the C headers in `folder` that declare a library's functions."""
    paths = sorted(glob.glob(os.path.join(folder, "*.h")))
    return [path for path in paths
            if os.path.basename(path).startswith("stgs_encoder") == (library == "stgs_encoder")]


def read_ppm(path):
    """Returns the width, the height and the bytes of the pixels."""
    with open(path, "rb") as file:
        return read_pixels(file)


def read_png(path):
    """Returns the same as read_ppm() for a PNG, using FFmpeg."""
    ppm = subprocess.run(["ffmpeg", "-v", "error", "-i", path, "-pix_fmt", "rgb24",
                          "-f", "image2pipe", "-c:v", "ppm", "-"], capture_output=True, check=True)
    return read_pixels(io.BytesIO(ppm.stdout))


def read_pixels(file):
    assert file.readline() == b"P6\n"
    width, height = map(int, file.readline().split())
    assert file.readline() == b"255\n"
    pixels = file.read()
    assert len(pixels) == 3 * width * height
    return width, height, pixels
