#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains and evaluates a list of variants, several at a time, and prints one line per variant.
Variants whose names differ only in a last number, the seed, also get a line with mean and deviation.

usage: train_table.py LIST --capture NAME=PREPARED... [--stgs PROGRAM] [--backend cuda]
                      [--only PREFIX] [--at-once 4] [--work FOLDER] [--keep]

LIST has one line per variant: `name | capture | every | options of stgs train`. Lines that begin
with # are comments. A capture is NAME, evaluated on its test cameras, or NAME:3,14,25: a fold, in
which these training cameras are held out and the test cameras are dropped. Settings are chosen on
folds. `every` is the option of stgs evaluate. --only selects the variants whose names begin with
PREFIX. Exit code 1 if a variant failed.
"""
import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import shlex
import statistics
import subprocess
import sys

LINKED = ("frames", "masks", "points_static.ply", "points_dynamic.ply")


def fold(prepared, held_out, folder):
    """Makes a fold of a prepared capture in `folder`, with links to its files."""
    capture = json.loads((prepared / "capture.json").read_text())
    capture["cameras"] = [camera for camera in capture["cameras"] if not camera["test"]]
    for camera in capture["cameras"]:
        camera["test"] = camera["name"] in held_out
    found = [camera["name"] for camera in capture["cameras"] if camera["test"]]
    if sorted(found) != sorted(held_out):
        raise SystemExit(f"{prepared}: not all held-out cameras are training cameras "
                         f"(expected {', '.join(held_out)}, found {', '.join(found)})")
    folder.mkdir(parents=True, exist_ok=True)
    for name in LINKED:
        source, link = (prepared / name).resolve(), folder / name
        if source.exists() and not link.is_symlink():
            link.symlink_to(source)
    (folder / "capture.json").write_text(json.dumps(capture))
    return folder


def run(command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{shlex.join(command)}: exit code {done.returncode}: {done.stderr[-500:]}")
    return json.loads(done.stdout)


def line_of(name, trained, measured):
    drift = (measured["static_drift"] or {}).get("mean_px")
    cameras = {}
    for view in measured["views"]:
        cameras.setdefault(view["camera"], []).append(view["psnr"])
    views = " ".join(f"{camera} {sum(psnr) / len(psnr):.2f}" for camera, psnr in cameras.items())
    moving = measured["psnr_moving"]
    return (f"{name} | {measured['psnr']:.3f} / {measured['psnr_cc']:.3f} / "
            f"{'-' if moving is None else format(moving, '.3f')} | ssim {measured['ssim']:.4f} | "
            f"drift {'-' if drift is None else format(drift, '.4f')} px | "
            f"{trained['seconds']:.1f} s, {trained['primitives']} primitives | {views}")


def of_seeds(measured):
    """Returns a line for each group of variants, from their names and measurements."""
    groups = {}
    for name, values in measured:
        match = re.fullmatch(r"(.*)-\d+", name)
        if match:
            groups.setdefault(match[1], []).append(values)
    lines = []
    for name, members in groups.items():
        if len(members) < 2:
            continue
        parts = []
        for metric in ("psnr", "psnr_cc", "psnr_moving", "ssim"):
            values = [member[metric] for member in members]
            if None not in values:
                parts.append(f"{metric} {statistics.mean(values):.4f} +- {statistics.stdev(values):.4f}")
        lines.append(f"{name}, {len(members)} seeds | {' | '.join(parts)}")
    return lines


def variant(line, captures, args):
    name, capture, every, options = [part.strip() for part in line.split("|")]
    scene = args.work / f"{name}.stgs"
    # The folds link to the frames of the capture.
    common = ["--backend", args.backend, "--format", "json", "--progress", "none", "--allow-outside"]
    trained = run([args.stgs, "train", str(captures[capture]), "-o", str(scene), "--num-evals", "0",
                   *common, *shlex.split(options)])
    measured = run([args.stgs, "evaluate", str(scene), "--against", str(captures[capture]),
                    "--every", every, *common])
    if not args.keep:
        scene.unlink()
    return name, measured, line_of(name, trained, measured)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("list", type=pathlib.Path)
    parser.add_argument("--capture", action="append", required=True, metavar="NAME=PREPARED")
    parser.add_argument("--stgs", default="build/release/bin/stgs")
    parser.add_argument("--backend", default="cuda")
    parser.add_argument("--only", default="", metavar="PREFIX")
    parser.add_argument("--at-once", type=int, default=4)
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("build/train_table"))
    parser.add_argument("--keep", action="store_true", help="keep the trained scenes in --work")
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    folders = {name: pathlib.Path(path) for name, path in
               (entry.split("=", maxsplit=1) for entry in args.capture)}
    lines = [line for line in args.list.read_text().splitlines()
             if line.strip() and not line.startswith("#") and line.startswith(args.only)]
    if not lines:
        raise SystemExit(f"{args.list}: no variant's name begins with '{args.only}'")
    captures = {}
    for capture in {line.split("|")[1].strip() for line in lines}:
        name, _, held_out = capture.partition(":")
        if name not in folders:
            raise SystemExit(f"{args.list}: no --capture {name}=PREPARED given")
        folder = args.work / capture.replace(":", "-without-").replace(",", "-")
        captures[capture] = (fold(folders[name], held_out.split(","), folder) if held_out
                            else folders[name])
    failed, done = 0, []
    with concurrent.futures.ThreadPoolExecutor(args.at_once) as pool:
        jobs = [pool.submit(variant, line, captures, args) for line in lines]
        for job in concurrent.futures.as_completed(jobs):
            try:
                name, measured, text = job.result()
                done.append((name, measured))
                print(text, flush=True)
            except RuntimeError as error:
                failed += 1
                print(error, file=sys.stderr, flush=True)
    for text in of_seeds(sorted(done, key=lambda entry: entry[0])):
        print(text)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
