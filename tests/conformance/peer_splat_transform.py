#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Holds the bridges against an independent program, PlayCanvas's splat-transform.

It opens what stgs writes, stgs opens what it writes, and where both read one file they must read
the same. Its SPZ is the format's own library. Skipped (exit code 77) where it is not installed:
`npm install -g @playcanvas/splat-transform`, or STGS_SPLAT_TRANSFORM=COMMAND.

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
        """Whether this version and build does; what it cannot do it answers with 5 or 6."""
        if "SOG" not in self.run([self.stgs, "convert", "--help"]):
            return False
        result = subprocess.run([self.stgs, "convert", path, "sog.ply"], cwd=self.folder,
                                capture_output=True, timeout=300, check=False)
        return result.returncode not in (5, 6)

    def path(self, name):
        return os.path.join(self.folder, name)


def write_random_ply(path, degree, seed):
    """SPLATS primitives in a box of 4 units, all of them opaque enough to be drawn."""
    draw = random.Random(seed)
    rest = 3 * ((degree + 1) ** 2 - 1)
    names = (["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"] +
             [f"f_rest_{k}" for k in range(rest)] +
             ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"])
    rows = bytearray()
    for _ in range(SPLATS):
        quaternion = [draw.gauss(0, 1) for _ in range(4)]
        length = math.hypot(*quaternion)
        row = ([draw.uniform(-2, 2) for _ in range(3)] + [0, 0, 0] +
               [draw.uniform(-2.5, 2.5) for _ in range(3)] + [draw.uniform(-.9, .9) for _ in range(rest)] +
               [draw.uniform(-4, 6)] + [draw.uniform(-7, -2) for _ in range(3)] +
               [q / length for q in quaternion])
        rows += struct.pack(f"<{len(row)}f", *row)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {SPLATS}\n"
    header += "".join(f"property float {name}\n" for name in names)
    with open(path, "wb") as file:
        file.write((header + "end_header\n").encode() + rows)


def read_ply(path):
    """The vertices as {property: values}, of a PLY of floats."""
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


def compare(what, meant, got, tolerance):
    """Both in one order; `tolerance` by kind: position, scale, opacity, rotation (degrees), sh."""
    if len(meant["x"]) != len(got["x"]):
        fail(f"{what}: {len(got['x'])} splats for {len(meant['x'])}")
    missing = {name for name in meant if name not in ("nx", "ny", "nz")} - set(got)
    if missing:
        fail(f"{what}: lacks {sorted(missing)}")
    largest = dict.fromkeys(tolerance, 0.0)
    for name in meant:
        if name in ("nx", "ny", "nz") or name.startswith("rot_"):
            continue
        kind = ("position" if name in "xyz" else "opacity" if name == "opacity"
                else "scale" if name.startswith("scale") else "sh")
        change = opacity if kind == "opacity" else float
        largest[kind] = max(largest[kind], max(abs(change(a) - change(b))
                                               for a, b in zip(meant[name], got[name])))
    largest["rotation"] = max(angle(a, b) for a, b in zip(zip(*quaternions(meant)),
                                                         zip(*quaternions(got))))
    shown = ", ".join(f"{kind} {value:.3g}" for kind, value in largest.items())
    print(f"{what}: {len(meant['x'])} splats; largest differences: {shown}")
    for kind, value in largest.items():
        if not value <= tolerance[kind]:
            fail(f"{what}: {kind} differs by {value}, more than {tolerance[kind]}")


EXACT = {"position": 0, "scale": 0, "opacity": 0, "rotation": .05, "sh": 0}
# Two programs that unpack the same bytes: rounding, and bytes that stand for opacities 0 and 1.
SAME = {"position": 1e-5, "scale": 1e-5, "opacity": 1.1e-3, "rotation": .05, "sh": 2e-5}
# What SPZ may lose of positions within 2 units, with harmonics in steps of 1/16 and 1/8.
PACKED = {"position": 1.3e-4, "scale": .0313, "opacity": .002, "rotation": .25, "sh": .0626}


def read_glb(path):
    """The splat attributes of a .glb as {name: tuples}."""
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
    """Of each splat, over the square of its largest scale; a rotation is only known up to half
    turns about the splat's own axes."""
    for (x, y, z, w), scale in zip(glb["KHR_gaussian_splatting:ROTATION"],
                                   glb["KHR_gaussian_splatting:SCALE"]):
        rotation = ((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
                    (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
                    (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))
        squares = [(s / max(scale)) ** 2 for s in scale]
        yield [sum(a[k] * b[k] * squares[k] for k in range(3)) for a in rotation for b in rotation]


def compare_glb(what, ours, theirs):
    if set(ours) != set(theirs) or ours["mode"] != theirs["mode"]:
        fail(f"{what}: holds {sorted(ours)}, the peer's {sorted(theirs)}")
    for key in ("kernel", "colorSpace"):
        if ours["extension"][key] != theirs["extension"][key]:
            fail(f"{what}: {key} is {ours['extension'][key]}")
    pairs = {name: (ours[name], theirs[name]) for name in ours
             if name not in ("extension", "mode", "used")}
    pairs["covariance"] = list(covariances(ours)), list(covariances(theirs))
    del pairs["KHR_gaussian_splatting:ROTATION"]
    largest = {}
    for name, (a, b) in pairs.items():
        if len(a) != len(b):
            fail(f"{what}: {len(a)} of {name}, the peer has {len(b)}")
        kind = name.replace("KHR_gaussian_splatting:", "").split("_")[0].lower()
        worst = max(abs(x - y) for u, v in zip(a, b) for x, y in zip(u, v))
        largest[kind] = max(largest.get(kind, 0), worst)
        if worst > (1 if name == "COLOR_0" else 2e-5):  # COLOR_0: of 255
            fail(f"{what}: {name} differs by {worst}")
    shown = ", ".join(f"{kind} {value:.3g}" for kind, value in largest.items())
    print(f"{what}: {len(ours['POSITION'])} splats; largest differences: {shown}")


def check_degree(run, degree):
    here = lambda name: f"{degree}_{name}"
    ply = lambda name: read_ply(run.path(here(name)))
    write_random_ply(run.path(here("source.ply")), degree, degree)
    label = f"degree {degree}:"
    # PLY, both ways.
    run.convert(here("source.ply"), here("ours.ply"))
    compare(f"{label} our PLY of theirs", ply("source.ply"), ply("ours.ply"), EXACT)
    run.transform(here("ours.ply"), here("theirs.ply"))
    compare(f"{label} our PLY, opened by the peer", ply("source.ply"), ply("theirs.ply"), EXACT)
    # SPZ: each reads its own and the other's.
    run.convert(here("source.ply"), here("ours.spz"))
    run.transform(here("ours.spz"), here("ours_by_peer.ply"))
    run.convert(here("ours.spz"), here("ours_by_us.ply"))
    compare(f"{label} our SPZ 4, opened by the peer", ply("source.ply"), ply("ours_by_peer.ply"),
            PACKED)
    compare(f"{label} our SPZ 4, opened by both", ply("ours_by_peer.ply"), ply("ours_by_us.ply"),
            SAME)
    for version in ("3", "4"):
        spz = here(f"theirs{version}.spz")
        run.transform(here("source.ply"), spz, "--spz-version", version)
        run.transform(spz, here("theirs_by_peer.ply"))
        run.convert(spz, here("theirs_by_us.ply"))
        compare(f"{label} the peer's SPZ {version}, opened by both", ply("theirs_by_peer.ply"),
                ply("theirs_by_us.ply"), SAME)
    # Packed PLY, which the peer puts in an order of its own.
    run.transform(here("source.ply"), here("packed.compressed.ply"))
    run.transform(here("packed.compressed.ply"), here("packed_by_peer.ply"))
    run.convert(here("packed.compressed.ply"), here("packed_by_us.ply"))
    compare(f"{label} the peer's packed PLY, opened by both", ply("packed_by_peer.ply"),
            ply("packed_by_us.ply"), SAME)
    # glTF, which the peer writes and does not read.
    run.convert(here("source.ply"), here("ours.glb"))
    run.transform(here("source.ply"), here("theirs.glb"))
    compare_glb(f"{label} our glTF beside the peer's", read_glb(run.path(here("ours.glb"))),
                read_glb(run.path(here("theirs.glb"))))
    # SOG, which the peer puts in an order of its own too.
    run.transform(here("source.ply"), here("theirs.sog"))
    if run.reads_sog(here("theirs.sog")):
        run.transform(here("theirs.sog"), here("sog_by_peer.ply"))
        run.convert(here("theirs.sog"), here("sog_by_us.ply"))
        compare(f"{label} the peer's SOG, opened by both", ply("sog_by_peer.ply"),
                ply("sog_by_us.ply"), SAME)
    else:
        print(f"{label} SOG is not read by this build")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--stgs", required=True)
    args = parser.parse_args()
    named = os.environ.get("STGS_SPLAT_TRANSFORM")
    peer = shlex.split(named) if named else [shutil.which("splat-transform")]
    if not peer or peer[0] is None or shutil.which(peer[0]) is None:
        print("skipped: splat-transform is not installed (STGS_SPLAT_TRANSFORM=COMMAND names it)")
        sys.exit(SKIPPED)
    with tempfile.TemporaryDirectory(prefix="stgs-peer-") as folder:
        run = Programs(os.path.abspath(args.stgs), peer, folder)
        version = subprocess.run([*peer, "--version"], capture_output=True, text=True, check=True)
        print((version.stdout + version.stderr).strip())
        for degree in range(4):
            check_degree(run, degree)


if __name__ == "__main__":
    main()
