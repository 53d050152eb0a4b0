#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes an SBOM (SPDX 2.3, JSON) of binaries of a build: the libraries that each really contains.

usage: sbom.py BUILD VERSION OUTPUT [BINARY...]

BINARY is a path in BUILD; default: the program, the libraries and the Python module, as far as they
are built. Shared libraries are those that a binary needs at run time (DYNAMIC_LINK). Archives, and
libraries of which only headers were compiled (STATIC_LINK), come from Ninja's record of the inputs of
each object. Versions and licences are those of the installed Debian packages. The same build gives
the same bytes, except for the time, which SOURCE_DATE_EPOCH sets.
"""
import datetime
import functools
import glob
import hashlib
import json
import os
import re
import subprocess
import sys

NAMESPACE = "https://stgs.example.org/spdx"
BINARIES = ("bin/stgs", "bin/stgs_mpi.so", "bin/stgs_opencv.so", "sdk/libstgs.so.[0-9]*.*", "sdk/libstgs_encoder.so.[0-9]*.*",
            "python/stgs*.so")
# Interfaces of the system, of which no code is compiled in.
HEADERS_ONLY = {"linux"}
# Short names of licences in Debian's copyright files, where they differ from SPDX's.
SPDX_NAMES = {"expat": "MIT", "mit": "MIT", "bsd-2-clause": "BSD-2-Clause", "bsd-3-clause": "BSD-3-Clause",
              "apache-2": "Apache-2.0", "apache-2.0": "Apache-2.0", "boost-1.0": "BSL-1.0", "bsl-1.0": "BSL-1.0",
              "zlib": "Zlib", "zlib/libpng": "Zlib", "mpl-2.0": "MPL-2.0", "curl": "curl", "cc0": "CC0-1.0",
              "cc0-1.0": "CC0-1.0", "public-domain": None, "gpl-2": "GPL-2.0-only", "gpl-2.0": "GPL-2.0-only",
              "gpl-2+": "GPL-2.0-or-later", "gpl-2.0+": "GPL-2.0-or-later", "gpl-3": "GPL-3.0-only",
              "gpl-3+": "GPL-3.0-or-later", "lgpl-2.1": "LGPL-2.1-only", "lgpl-2.1+": "LGPL-2.1-or-later",
              "lgpl-3": "LGPL-3.0-only", "lgpl-3+": "LGPL-3.0-or-later", "isc": "ISC"}
# By source package, where Debian's copyright file is not machine-readable or has names of its own.
LICENCES = {"glibc": "LGPL-2.1-or-later", "gcc": "GPL-3.0-or-later WITH GCC-exception-3.1",
            "fmtlib": "MIT", "openexr": "BSD-3-Clause", "imath": "BSD-3-Clause",
            "libstb": "MIT OR Unlicense", "libwebp": "BSD-3-Clause", "libzip": "BSD-3-Clause",
            "openmpi": "BSD-3-Clause"}
CUDA = "/usr/local/cuda"


def output_of(*command, cwd=None):
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=True).stdout


@functools.cache
def owners():
    """The Debian package of each installed file."""
    found = {}
    for path in glob.glob("/var/lib/dpkg/info/*.list"):
        package = os.path.basename(path)[:-len(".list")]
        with open(path, encoding="utf-8") as lines:
            for line in lines:
                found[line.rstrip("\n")] = package
    return found


def owner_of(path):
    """The package of a file: of Debian, or 'cuda' for the CUDA toolkit. None if it is not known."""
    for name in (path, os.path.realpath(path)):
        for candidate in (name, name.removeprefix("/usr")):
            if candidate in owners():
                return owners()[candidate]
    return "cuda" if path.startswith(CUDA) else None


@functools.cache
def debian(package):
    """(version, source package, architecture) of an installed package."""
    text = output_of("dpkg-query", "-W", "-f", "${Version}\t${source:Package}\t${Architecture}", package)
    return tuple(text.split("\t"))


def source_of(package):
    return package if package == "cuda" else debian(package)[1]


def licence_of(package):
    """The licence of most of a package's files, as an SPDX expression, or NOASSERTION."""
    known = LICENCES.get(re.sub(r"-\d+$", "", source_of(package)))
    path = f"/usr/share/doc/{package.split(':')[0]}/copyright"
    if known or not os.path.exists(path):
        return known or "NOASSERTION"
    with open(path, encoding="utf-8", errors="replace") as file:
        paragraphs = re.split(r"\n\s*\n", file.read())
    for paragraph in paragraphs:
        licence = re.search(r"^License:[ \t]*(.+)$", paragraph, re.MULTILINE)
        if licence and re.search(r"^Files:\s*\*\s*$", paragraph, re.MULTILINE):
            words = re.split(r"\s+(or|and)\s+", licence.group(1).strip().lower())
            names = [word.upper() if word in ("or", "and") else SPDX_NAMES.get(word) for word in words]
            return " ".join(names) if all(names) else "NOASSERTION"
    return "NOASSERTION"


def inputs_of(build, targets):
    """The inputs of build steps, without those that only order them."""
    found, ordering = set(), False
    for line in output_of("ninja", "-t", "query", *targets, cwd=build).splitlines():
        if line.startswith("  outputs:") or not line.startswith(" "):
            ordering = True
        elif line.startswith("  input:"):
            ordering = False
        elif line.startswith("    ||"):
            continue
        elif not ordering:
            found.add(line.strip().removeprefix("| "))
    return found


def objects_and_archives(build, binary):
    """The objects of a binary, and the archives of others that it links."""
    objects, archives, pending = set(), set(), {binary}
    while pending:
        inputs = inputs_of(build, sorted(pending))
        objects |= {name for name in inputs if name.endswith(".o")}
        linked = {name for name in inputs if name.endswith(".a")}
        archives |= {name for name in linked if name.startswith("/")}
        pending = {name for name in linked if not name.startswith("/")}
    return objects, archives


def headers_of(build, objects):
    """The files outside of the build that objects were compiled from."""
    def listed(targets):
        text = output_of("ninja", "-t", "deps", *sorted(targets), cwd=build)
        return {line.strip() for line in text.splitlines() if line.startswith("    ")}
    files = listed(objects)
    precompiled = {os.path.relpath(os.path.join(build, name), build)
                   for name in files if name.endswith(".gch")}
    files |= listed(precompiled) if precompiled else set()
    return {name for name in files if name.startswith("/usr/")}


def shared_libraries(path):
    """The files of the shared libraries that a binary names as needed."""
    needed = re.findall(r"NEEDED.*\[(.+)\]", output_of("readelf", "-d", path))
    places = dict(re.findall(r"^\s*(\S+) => (/\S+)", output_of("ldd", path), re.MULTILINE))
    loader = {os.path.basename(name): name for name in re.findall(r"(/\S*ld-linux\S*)", output_of("ldd", path))}
    return {name: places.get(name) or loader.get(name) for name in needed}


def libraries_of(build, binary):
    """Names of packages, and how the binary links them. Libraries of this build are left out."""
    links = {}
    for name, path in shared_libraries(os.path.join(build, binary)).items():
        if path is None:
            sys.exit(f"sbom.py: {binary}: {name} is not installed")
        if os.path.realpath(path).startswith(os.path.realpath(build) + os.sep):
            continue
        package = owner_of(path)
        if package is None:
            sys.exit(f"sbom.py: {binary}: no package owns {path}")
        links[package] = "DYNAMIC_LINK"
    shared = {source_of(package) for package in links} | HEADERS_ONLY
    objects, archives = objects_and_archives(build, binary)
    for path in sorted(archives | headers_of(build, objects)):
        package = owner_of(path)
        if package is None:
            sys.exit(f"sbom.py: {binary}: no package owns {path}")
        if source_of(package) not in shared:
            links.setdefault(package, "STATIC_LINK")
    return links


def identifier(name):
    return "SPDXRef-" + re.sub(r"[^A-Za-z0-9.-]", "-", name)


def cuda_version():
    with open(f"{CUDA}/include/cuda_runtime_api.h", encoding="utf-8") as file:
        number = int(re.search(r"#define CUDART_VERSION +(\d+)", file.read()).group(1))
    return f"{number // 1000}.{number % 1000 // 10}"


def package_of(name):
    licence = licence_of(name)
    entry = {"SPDXID": identifier(name), "name": name.split(":")[0], "filesAnalyzed": False,
             "downloadLocation": "NOASSERTION", "copyrightText": "NOASSERTION",
             "licenseConcluded": "NOASSERTION", "licenseDeclared": licence}
    if name == "cuda":
        return {**entry, "name": "CUDA Toolkit", "versionInfo": cuda_version(),
                "supplier": "Organization: NVIDIA"}
    version, _, architecture = debian(name)
    purl = f"pkg:deb/debian/{name.split(':')[0]}@{version.replace('+', '%2B')}?arch={architecture}"
    return {**entry, "versionInfo": version, "supplier": "Organization: Debian",
            "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl",
                              "referenceLocator": purl}]}


def document(build, version, binaries):
    packages, relations, used = [], [], {}
    for binary in binaries:
        with open(os.path.join(build, binary), "rb") as file:
            digest = hashlib.sha256(file.read()).hexdigest()
        own = identifier("stgs-" + os.path.basename(binary))
        packages.append({"SPDXID": own, "name": os.path.basename(binary), "versionInfo": version,
                         "filesAnalyzed": False, "downloadLocation": "NOASSERTION",
                         "copyrightText": "NOASSERTION", "licenseConcluded": "Apache-2.0",
                         "licenseDeclared": "Apache-2.0", "supplier": "Organization: STGS",
                         "checksums": [{"algorithm": "SHA256", "checksumValue": digest}]})
        relations.append(("SPDXRef-DOCUMENT", "DESCRIBES", own))
        for name, link in sorted(libraries_of(build, binary).items()):
            used.setdefault(name, package_of(name))
            relations.append((own, link, identifier(name)))
    packages += [used[name] for name in sorted(used)]
    content = json.dumps([packages, relations], sort_keys=True).encode()
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH") or datetime.datetime.now().timestamp())
    created = datetime.datetime.fromtimestamp(seconds, datetime.timezone.utc)
    return {"spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT",
            "name": f"stgs-{version}",
            "documentNamespace": f"{NAMESPACE}/stgs-{version}-{hashlib.sha256(content).hexdigest()}",
            "creationInfo": {"created": created.strftime("%Y-%m-%dT%H:%M:%SZ"),
                             "creators": ["Tool: sbom.py"]},
            "packages": packages,
            "relationships": [{"spdxElementId": a, "relationshipType": kind, "relatedSpdxElement": b}
                              for a, kind, b in relations]}


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    build, version, output, *binaries = sys.argv[1:]
    if not os.path.exists(os.path.join(build, "build.ninja")):
        sys.exit(f"sbom.py: {build}: not a build folder of Ninja")
    if not binaries:
        found = [path for pattern in BINARIES for path in sorted(glob.glob(os.path.join(build, pattern)))]
        binaries = [os.path.relpath(path, build) for path in found if not os.path.islink(path)]
    if not binaries:
        sys.exit(f"sbom.py: {build}: nothing is built")
    sbom = document(build, version, binaries)
    with open(output, "w", encoding="utf-8") as file:
        json.dump(sbom, file, indent=1)
        file.write("\n")
    print(f"{output}: {len(binaries)} binaries, {len(sbom['packages']) - len(binaries)} libraries")


if __name__ == "__main__":
    main()
