#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the wheel of the Python module, with the libraries that it needs.

usage: wheel.py MODULE LIBRARIES STUBS LICENCE VERSION FOLDER

MODULE is the extension, which finds its libraries in stgs.libs/ beside it. LIBRARIES is the folder
with their copies, STUBS the stub-only package. The wheel, FOLDER/stgs-VERSION-...whl, fits the
Python that runs this script and machines with the C library of this one or a later one. The same
files give the same bytes.
"""
import base64
import hashlib
import os
import pathlib
import sys
import sysconfig
import tempfile
import zipfile

METADATA = """Metadata-Version: 2.1
Name: stgs
Version: {version}
Summary: Plays streaming 4D Gaussian videos (.stgs) and renders them into numpy arrays
License: Apache-2.0
License-File: LICENSE
Requires-Python: =={python}.*
Requires-Dist: numpy
"""
WHEEL = """Wheel-Version: 1.0
Generator: stgs {version}
Root-Is-Purelib: false
Tag: {tag}
"""
EPOCH = (1980, 1, 1, 0, 0, 0)  # the first time that a zip file can state


def wheel_tag():
    """Returns for example cp311-cp311-linux_x86_64."""
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    return f"{python}-{python}-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"


def wheel_files(module, libraries, stubs, licence, version):
    """Returns the content of the wheel by name, without its record."""
    info = f"stgs-{version}.dist-info"
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    files = {module.name: module.read_bytes(),
             f"{info}/METADATA": METADATA.format(version=version, python=python).encode(),
             f"{info}/WHEEL": WHEEL.format(version=version, tag=wheel_tag()).encode(),
             f"{info}/LICENSE": licence.read_bytes()}
    # Each library once, by the name that the others ask for.
    for library in libraries.iterdir():
        if not any(other.is_symlink() and other.resolve() == library.resolve()
                   for other in libraries.iterdir()) or library.is_symlink():
            files[f"stgs.libs/{library.name}"] = library.read_bytes()
    for stub in stubs.iterdir():
        files[f"{stubs.name}/{stub.name}"] = stub.read_bytes()
    return files


def record_of(files, name):
    """Returns the RECORD of a wheel: name, SHA-256 and size of each file."""
    lines = []
    for path, data in sorted(files.items()):
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        lines.append(f"{path},sha256={digest},{len(data)}")
    return "\n".join([*lines, f"{name},,"]) + "\n"


def main():
    if len(sys.argv) != 7:
        sys.exit(__doc__.split("\n\n")[1])
    module, libraries, stubs, licence = map(pathlib.Path, sys.argv[1:5])
    version, folder = sys.argv[5], pathlib.Path(sys.argv[6])
    files = wheel_files(module, libraries, stubs, licence, version)
    record = f"stgs-{version}.dist-info/RECORD"
    files[record] = record_of(files, record).encode()
    wheel = folder / f"stgs-{version}-{wheel_tag()}.whl"
    with tempfile.NamedTemporaryFile(dir=folder, delete=False) as temporary:
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            for path, data in sorted(files.items()):
                entry = zipfile.ZipInfo(path, EPOCH)
                entry.external_attr = (0o755 if ".so" in path else 0o644) << 16
                archive.writestr(entry, data, zipfile.ZIP_DEFLATED)
    os.chmod(temporary.name, 0o644)
    os.replace(temporary.name, wheel)
    print(wheel)


if __name__ == "__main__":
    main()
