#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares `stgs convert` with an independent program, PlayCanvas's splat-transform.

Each program opens the files of the other, and both must read the same from one file.
splat-transform uses the SPZ format's own library. Exit code 77: it is not installed; install it with
`npm install -g @playcanvas/splat-transform`, or set STGS_SPLAT_TRANSFORM=COMMAND.

usage: peer_splat_transform.py --stgs PROGRAM
"""
import argparse
import json
import math
import os
import random
import shlex
import shutil
import struct
import subprocess
import sys
import tempfile

SKIPPED = 77
SPLATS = 600


def fail(message):
    sys.exit(f"peer_splat_transform.py: {message}")


class Programs:
    def __init__(self, stgs, peer, folder):
        self.stgs, self.peer, self.folder = stgs, peer, folder

    def run(self, command):
        result = subprocess.run(command, cwd=self.folder, capture_output=True, text=True,
                                timeout=300, check=False)
        if result.returncode != 0:
            fail(f"{shlex.join(command)}: {result.stdout}{result.stderr}")
        return result.stdout

    def convert(self, source, target):
        return json.loads(self.run([self.stgs, "convert", source, target, "--format", "json"]))

    def transform(self, source, target, *options):
        self.run([*self.peer, "-q", "-w", "-g", "cpu", *options, source, target])

    def reads_sog(self, path):
        """Returns whether this version and build of stgs reads SOG (exit codes 5 and 6: it does not)."""
        if "SOG" not in self.run([self.stgs, "convert", "--help"]):
            return False
        result = subprocess.run([self.stgs, "convert", path, "sog.ply"], cwd=self.folder,
                                capture_output=True, timeout=300, check=False)
        return result.returncode not in (5, 6)

    def path(self, name):
        return os.path.join(self.folder, name)


def write_random_ply(path, degree, seed):
    """Writes SPLATS primitives in a box of 4 units, all opaque enough to be rendered."""
    source = random.Random(seed)
    rest = 3 * ((degree + 1) ** 2 - 1)
    names = (["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"] +
             [f"f_rest_{k}" for k in range(rest)] +
             ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"])
    rows = bytearray()
    for _ in range(SPLATS):
        quaternion = [source.gauss(0, 1) for _ in range(4)]
        length = math.hypot(*quaternion)
        row = ([source.uniform(-2, 2) for _ in range(3)] + [0, 0, 0] +
               [source.uniform(-2.5, 2.5) for _ in range(3)] +
               [source.uniform(-.9, .9) for _ in range(rest)] +
               [source.uniform(-4, 6)] + [source.uniform(-7, -2) for _ in range(3)] +
               [q / length for q in quaternion])
        rows += struct.pack(f"<{len(row)}f", *row)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {SPLATS}\n"
    header += "".join(f"property float {name}\n" for name in names)
    with open(path, "wb") as file:
        file.write((header + "end_header\n").encode() + rows)


def read_ply(path):
    """Returns the vertices of a PLY of floats as {property: values}."""
    with open(path, "rb") as file:
        header, body = file.read().split(b"end_header\n", 1)
    lines = header.decode().splitlines()
    names = [line.split()[2] for line in lines if line.startswith("property")]
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    rows = struct.iter_unpack(f"<{len(names)}f", body[:4 * len(names) * count])
    return dict(zip(names, zip(*rows)))


def opacity(logit):
    return 1 / (1 + math.exp(-logit)) if logit > -700 else 0.0


def quaternions(values):
    return [values[f"rot_{c}"] for c in range(4)]


def angle(a, b):
    dot = abs(sum(x * y for x, y in zip(a, b))) / (math.hypot(*a) * math.hypot(*b))
    return math.degrees(2 * math.acos(min(1.0, dot)))


def compare(label, expected, actual, tolerance):
    """Compares splats in the same order; `tolerance` by kind: position, scale, opacity, rotation
    (degrees), sh."""
    if len(expected["x"]) != len(actual["x"]):
        fail(f"{label}: {len(actual['x'])} splats instead of {len(expected['x'])}")
    missing = {name for name in expected if name not in ("nx", "ny", "nz")} - set(actual)
    if missing:
        fail(f"{label}: missing {sorted(missing)}")
    largest = dict.fromkeys(tolerance, 0.0)
    for name in expected:
        if name in ("nx", "ny", "nz") or name.startswith("rot_"):
            continue
        kind = ("position" if name in "xyz" else "opacity" if name == "opacity"
                else "scale" if name.startswith("scale") else "sh")
        change = opacity if kind == "opacity" else float
        largest[kind] = max(largest[kind], max(abs(change(a) - change(b))
                                               for a, b in zip(expected[name], actual[name])))
    largest["rotation"] = max(angle(a, b) for a, b in zip(zip(*quaternions(expected)),
                                                         zip(*quaternions(actual))))
    summary = ", ".join(f"{kind} {value:.3g}" for kind, value in largest.items())
    print(f"{label}: {len(expected['x'])} splats; largest differences: {summary}")
    for kind, value in largest.items():
        if not value <= tolerance[kind]:
            fail(f"{label}: {kind} differs by {value}, more than {tolerance[kind]}")


EXACT = {"position": 0, "scale": 0, "opacity": 0, "rotation": .05, "sh": 0}
# Two programs that unpack the same bytes differ by rounding and in the opacities 0 and 1.
SAME = {"position": 1e-5, "scale": 1e-5, "opacity": 1.1e-3, "rotation": .05, "sh": 2e-5}
# Quantisation of SPZ for positions within 2 units, with SH in steps of 1/16 and 1/8.
PACKED = {"position": 1.3e-4, "scale": .0313, "opacity": .002, "rotation": .25, "sh": .0626}


def read_glb(path):
    """Returns the splat attributes of a .glb as {name: tuples}."""
    with open(path, "rb") as file:
        data = file.read()
    length = struct.unpack("<I", data[12:16])[0]
    text, body = json.loads(data[20:20 + length]), data[28 + length:]
    primitive = text["meshes"][0]["primitives"][0]
    out = {"extension": primitive["extensions"]["KHR_gaussian_splatting"], "mode": primitive["mode"],
           "used": text["extensionsUsed"]}
    for name, index in primitive["attributes"].items():
        accessor = text["accessors"][index]
        view = text["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        letter = {5126: "f", 5121: "B"}[accessor["componentType"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        size = accessor["count"] * width * (4 if letter == "f" else 1)
        out[name] = list(struct.iter_unpack(f"<{width}{letter}", body[start:start + size]))
    return out


def covariances(glb):
    """Yields the covariance of each splat, divided by the square of its largest scale. Rotations
    cannot be compared: half turns about the splat's own axes are equivalent."""
    for (x, y, z, w), scale in zip(glb["KHR_gaussian_splatting:ROTATION"],
                                   glb["KHR_gaussian_splatting:SCALE"]):
        rotation = ((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
                    (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
                    (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))
        squares = [(s / max(scale)) ** 2 for s in scale]
        yield [sum(a[k] * b[k] * squares[k] for k in range(3)) for a in rotation for b in rotation]


def compare_glb(label, ours, theirs):
    if set(ours) != set(theirs) or ours["mode"] != theirs["mode"]:
        fail(f"{label}: contains {sorted(ours)}, the peer's file {sorted(theirs)}")
    for key in ("kernel", "colorSpace"):
        if ours["extension"][key] != theirs["extension"][key]:
            fail(f"{label}: {key} is {ours['extension'][key]}")
    pairs = {name: (ours[name], theirs[name]) for name in ours
             if name not in ("extension", "mode", "used")}
    pairs["covariance"] = list(covariances(ours)), list(covariances(theirs))
    del pairs["KHR_gaussian_splatting:ROTATION"]
    largest = {}
    for name, (a, b) in pairs.items():
        if len(a) != len(b):
            fail(f"{label}: {len(a)} of {name}, the peer has {len(b)}")
        kind = name.replace("KHR_gaussian_splatting:", "").split("_")[0].lower()
        worst = max(abs(x - y) for u, v in zip(a, b) for x, y in zip(u, v))
        largest[kind] = max(largest.get(kind, 0), worst)
        if worst > (1 if name == "COLOR_0" else 2e-5):  # COLOR_0 is 0 to 255
            fail(f"{label}: {name} differs by {worst}")
    summary = ", ".join(f"{kind} {value:.3g}" for kind, value in largest.items())
    print(f"{label}: {len(ours['POSITION'])} splats; largest differences: {summary}")


def check_degree(run, degree):
    named = lambda name: f"{degree}_{name}"
    ply = lambda name: read_ply(run.path(named(name)))
    write_random_ply(run.path(named("source.ply")), degree, degree)
    label = f"degree {degree}:"
    # PLY in both directions.
    run.convert(named("source.ply"), named("ours.ply"))
    compare(f"{label} our PLY", ply("source.ply"), ply("ours.ply"), EXACT)
    run.transform(named("ours.ply"), named("theirs.ply"))
    compare(f"{label} our PLY, opened by the peer", ply("source.ply"), ply("theirs.ply"), EXACT)
    # SPZ: each program reads its own file and the other's.
    run.convert(named("source.ply"), named("ours.spz"))
    run.transform(named("ours.spz"), named("ours_by_peer.ply"))
    run.convert(named("ours.spz"), named("ours_by_us.ply"))
    compare(f"{label} our SPZ 4, opened by the peer", ply("source.ply"), ply("ours_by_peer.ply"),
            PACKED)
    compare(f"{label} our SPZ 4, opened by both", ply("ours_by_peer.ply"), ply("ours_by_us.ply"),
            SAME)
    for version in ("3", "4"):
        spz = named(f"theirs{version}.spz")
        run.transform(named("source.ply"), spz, "--spz-version", version)
        run.transform(spz, named("theirs_by_peer.ply"))
        run.convert(spz, named("theirs_by_us.ply"))
        compare(f"{label} the peer's SPZ {version}, opened by both", ply("theirs_by_peer.ply"),
                ply("theirs_by_us.ply"), SAME)
    # Packed PLY, which the peer sorts.
    run.transform(named("source.ply"), named("packed.compressed.ply"))
    run.transform(named("packed.compressed.ply"), named("packed_by_peer.ply"))
    run.convert(named("packed.compressed.ply"), named("packed_by_us.ply"))
    compare(f"{label} the peer's packed PLY, opened by both", ply("packed_by_peer.ply"),
            ply("packed_by_us.ply"), SAME)
    # glTF, which the peer only writes.
    run.convert(named("source.ply"), named("ours.glb"))
    run.transform(named("source.ply"), named("theirs.glb"))
    compare_glb(f"{label} our glTF and the peer's", read_glb(run.path(named("ours.glb"))),
                read_glb(run.path(named("theirs.glb"))))
    # SOG, which the peer sorts too.
    run.transform(named("source.ply"), named("theirs.sog"))
    if run.reads_sog(named("theirs.sog")):
        run.transform(named("theirs.sog"), named("sog_by_peer.ply"))
        run.convert(named("theirs.sog"), named("sog_by_us.ply"))
        compare(f"{label} the peer's SOG, opened by both", ply("sog_by_peer.ply"),
                ply("sog_by_us.ply"), SAME)
    else:
        print(f"{label} this build does not read SOG")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--stgs", required=True)
    args = parser.parse_args()
    command = os.environ.get("STGS_SPLAT_TRANSFORM")
    peer = shlex.split(command) if command else [shutil.which("splat-transform")]
    if not peer or peer[0] is None or shutil.which(peer[0]) is None:
        print("skipped: splat-transform is not installed (or set STGS_SPLAT_TRANSFORM=COMMAND)")
        sys.exit(SKIPPED)
    with tempfile.TemporaryDirectory(prefix="stgs-peer-") as folder:
        run = Programs(os.path.abspath(args.stgs), peer, folder)
        version = subprocess.run([*peer, "--version"], capture_output=True, text=True, check=True)
        print((version.stdout + version.stderr).strip())
        for degree in range(4):
            check_degree(run, degree)


if __name__ == "__main__":
    main()
