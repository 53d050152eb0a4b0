#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the wheel of the Python module, with its dependencies and their licences.

usage: wheel.py MODULE BUILD VERSION FOLDER

MODULE is the extension of the target stgs_wheel_module in the folder BUILD. The wheel,
FOLDER/stgs-VERSION-*.whl, contains the shared libraries that the module needs, except glibc, the C++
runtime and GPU drivers. It requires the version of Python that runs this script, and a Linux system
at least as new as this one. The same files give the same bytes.
"""
import base64
import hashlib
import os
import pathlib
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zipfile

import sbom

SOURCE = pathlib.Path(__file__).resolve().parents[2]
METADATA = """Metadata-Version: 2.1
Name: stgs
Version: {version}
Summary: Plays streaming 4D Gaussian videos (.stgs) and renders them into numpy arrays
License: Apache-2.0; libraries in stgs.libs: see the folder licenses
Requires-Python: =={python}.*
Requires-Dist: numpy
"""
WHEEL = """Wheel-Version: 1.0
Generator: stgs {version}
Root-Is-Purelib: false
Tag: {tag}
"""
EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time that a zip file can store


def wheel_tag():
    """Returns for example cp311-cp311-linux_x86_64."""
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    return f"{python}-{python}-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"


def libraries_of(module, build):
    """Returns the contents of the shared libraries that the module needs, by name."""
    with tempfile.TemporaryDirectory() as folder:
        copy = shutil.copy(module, folder)  # without libraries beside it
        libraries = pathlib.Path(folder, "stgs.libs")
        subprocess.run(["cmake", f"-DPROGRAM={copy}", "-DKIND=MODULES", f"-DFOLDER={libraries}",
                        f"-DOWN={build}/sdk", "-P", SOURCE / "cmake/bundle_runtime.cmake"], check=True)
        # A library is looked up by the name of the link to it, if there is one.
        targets = {path.resolve() for path in libraries.iterdir() if path.is_symlink()}
        return {path.name: path.read_bytes() for path in libraries.iterdir() if path not in targets}


def licences_of(libraries):
    """Returns the licences of the Debian packages of the libraries, by package."""
    packages = {os.path.basename(path): package for path, package in sbom.owners().items()}
    unknown = [name for name in libraries if name not in packages]
    if unknown:
        sys.exit(f"wheel.py: the licence of {unknown[0]} is unknown: no Debian package contains it")
    names = {packages[name].split(":")[0] for name in libraries}
    return {name: pathlib.Path(f"/usr/share/doc/{name}/copyright").read_bytes() for name in names}


def wheel_files(module, build, version):
    """Returns the contents of the wheel by name, except its record."""
    info = f"stgs-{version}.dist-info"
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    libraries = libraries_of(module, build)
    stubs = SOURCE / "sdk/bindings/python/stgs-stubs"
    return {module.name: module.read_bytes(),
            f"{info}/METADATA": METADATA.format(version=version, python=python).encode(),
            f"{info}/WHEEL": WHEEL.format(version=version, tag=wheel_tag()).encode(),
            f"{info}/licenses/LICENSE": (SOURCE / "LICENSE").read_bytes(),
            **{f"{info}/licenses/{name}": text for name, text in licences_of(libraries).items()},
            **{f"stgs.libs/{name}": data for name, data in libraries.items()},
            **{f"{stubs.name}/{stub.name}": stub.read_bytes() for stub in stubs.iterdir()}}


def record_of(files, name):
    """Returns the RECORD of a wheel: name, SHA-256 and size of each file."""
    lines = []
    for path, data in sorted(files.items()):
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        lines.append(f"{path},sha256={digest},{len(data)}")
    return "\n".join([*lines, f"{name},,"]) + "\n"


def main():
    if len(sys.argv) != 5:
        sys.exit(__doc__.split("\n\n")[1])
    module, build, folder = (pathlib.Path(sys.argv[i]) for i in (1, 2, 4))
    version = sys.argv[3]
    files = wheel_files(module, build, version)
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
