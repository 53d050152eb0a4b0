#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs `stgs bench` over the cases that RESULTS.md tells of the player, and prints a line for each.

usage: player_table.py SCENE [--stgs PROGRAM] [--backend cuda] [--cases frame,steps,stereo,lives,play]
                       [--foveae 250,300,500] [--repeat 1] [--scale 1] [--num-frames 80] [--frames 300]
                       [--work FOLDER]

The eight cameras stand on an ellipse around the scene's origin and look at it, 60 degrees wide. The
cases: a frame at 3840x2160 and 1920x1080, its steps, two eyes of 2064x2208 with and without foveae,
ten times as many stored as alive, and playing 300 frames from a packed file against a display of 100
pictures a second; each moving (--animate) and still where both are asked for. Lines go out as they
are measured: case | what was measured. Exit code 1 where a run failed.
"""
import argparse
import json
import math
import pathlib
import shlex
import subprocess
import sys

CAMERAS = 8
WIDTH, HEIGHT = 3840, 2160
PLAYED_FROM = (0, 3, 6)  # cameras
EYES_APART = 0.063


def unit(v):
    length = math.sqrt(sum(x * x for x in v))
    return [x / length for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def camera_at(angle):
    """From (10 cos, -1.3, 7 sin) to (0, -0.4, 0), y down: that of the figures of other renderers."""
    eye = [10 * math.cos(angle), -1.3, 7 * math.sin(angle)]
    forward = unit([-eye[0], -0.4 - eye[1], -eye[2]])
    right = unit(cross(forward, [0, -1, 0]))
    rows = [right, cross(forward, right), forward]
    focal = WIDTH / 2 / math.tan(math.radians(30))
    return {"width": WIDTH, "height": HEIGHT, "fx": focal, "fy": focal,
            "cx": WIDTH / 2, "cy": HEIGHT / 2, "rotation": sum(rows, []),
            "translation": [-sum(a * b for a, b in zip(row, eye)) for row in rows]}


def write_cameras(folder):
    paths = []
    for i in range(CAMERAS):
        paths.append(folder / f"camera{i}.json")
        paths[-1].write_text(json.dumps(camera_at(2 * math.pi * i / CAMERAS)))
    return paths


def times(drawn, what="frame_ms"):
    return f"{drawn[what]['p50']:.3f} ({drawn[what]['p99']:.3f})"


def of_frame(found):
    again = found["warm"]
    return (f"frame {times(again)}, device {times(again, 'device_ms')} ms | "
            f"{found['stored']} stored, {found['active']:.0f} alive, {found['rendered']:.0f} drawn")


def of_steps(found):
    return ", ".join(f"{step['step']} {step['ms']:.3f} (floor {step['floor_ms']:.3f})"
                     for step in found["steps"]["steps"]) + " ms"


def of_stereo(found):
    stereo = found["stereo"]
    line = (f"two eyes {times(found['warm'])}, one {times(stereo['one_eye'])} ms, "
            f"{stereo['ratio_to_one_eye']:.3f} times")
    if "ratio_to_one_eye_foveated" in stereo:
        line += (f"; one alike {times(stereo['one_eye_foveated'])} ms, "
                 f"{stereo['ratio_to_one_eye_foveated']:.3f} times")
    return line


def of_play(found):
    play = found["play"]
    missing = "".join(f", {play[what]} {what}" for what in ("incomplete", "failed_reads") if what in play)
    return (f"{play['missed']} of {play['refreshes']} missed{missing}, longest "
            f"{play['max_ms']:.1f} ms, first after {play['start_ms']:.0f}; drawn in "
            f"{times(play['rendering'])} ms, device {times(play['rendering'], 'device_ms')}, "
            f"fetching {100 * play['fetch_share']:.1f} % of the time")


def frame_cases(size, all_cameras, args):
    for name, width, height in (("2160p", WIDTH, HEIGHT), ("1080p", WIDTH // 2, HEIGHT // 2)):
        for moves in (["--animate"], []):
            yield (f"{name} {'moving' if moves else 'still'}",
                   ["--full-sh", *moves, *size(width, height), *all_cameras,
                    "--num-frames", str(args.num_frames)], of_frame)


def steps_cases(size, all_cameras, _):
    for name, width, height in (("2160p", WIDTH, HEIGHT), ("an eye", 2064, 2208)):
        for moves in (["--animate"], []):
            yield (f"steps of {name} {'moving' if moves else 'still'}",
                   ["--full-sh", *moves, *size(width, height), *all_cameras, "--steps",
                    "--num-frames", "16"], of_steps)


def stereo_cases(size, all_cameras, args):
    for fovea in ["", *args.foveae.split(",")]:
        pixels = ["--fovea", str(float(fovea) * args.scale)] if fovea else []
        for moves in (["--animate"], []):
            yield (f"stereo {'moving' if moves else 'still'}{' fovea ' if fovea else ''}{fovea}",
                   ["--full-sh", *moves, *size(2064, 2208), *all_cameras, "--stereo",
                    str(EYES_APART), *pixels, "--num-frames", str(args.num_frames)], of_stereo)


def lives_cases(size, all_cameras, args):
    for lives in ("1", "10"):
        yield (f"stored {lives} times",
               ["--stored-ratio", lives, "--memory", "40000", *size(WIDTH, HEIGHT), *all_cameras,
                "--num-frames", str(args.num_frames)], of_frame)


def play_cases(size, all_cameras, args):
    for through in ("timeline", "player"):
        for camera in PLAYED_FROM:
            yield (f"play {through} camera {camera}",
                   ["--animate", "--full-sh", "--quality", "87", *size(WIDTH, HEIGHT),
                    "--camera", all_cameras[camera + 1], "--memory", "8000", "--play", through,
                    "--frames", str(args.frames)], of_play)


CASES = {"frame": frame_cases, "steps": steps_cases, "stereo": stereo_cases, "lives": lives_cases,
         "play": play_cases}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("scene")
    parser.add_argument("--stgs", default="build/release/bin/stgs")
    parser.add_argument("--backend", default="cuda")
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--foveae", default="250,300,500", help="pixels, with commas")
    parser.add_argument("--repeat", type=int, default=1, help="times that each case is measured")
    parser.add_argument("--scale", type=float, default=1, help="of the pictures, an axis")
    parser.add_argument("--num-frames", type=int, default=80)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("build/player_table"))
    args = parser.parse_args()
    unknown = sorted(set(args.cases.split(",")) - set(CASES))
    if unknown:
        raise SystemExit(f"no case {', '.join(unknown)}; there are {', '.join(CASES)}")
    args.work.mkdir(parents=True, exist_ok=True)
    all_cameras = ["--camera", *map(str, write_cameras(args.work))]

    def size(width, height):
        return ["--size", f"{round(width * args.scale)}x{round(height * args.scale)}"]

    failed = 0
    for case in args.cases.split(","):
        for name, options, told in CASES[case](size, all_cameras, args):
            command = [args.stgs, "bench", args.scene, "--backend", args.backend, "--format",
                       "json", "--progress", "none", *options]
            for _ in range(args.repeat):
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                if done.returncode == 0:
                    print(f"{args.backend} {name} | {told(json.loads(done.stdout))}", flush=True)
                    continue
                failed += 1
                print(f"{shlex.join(command)}: exit code {done.returncode}: {done.stderr[-500:]}",
                      file=sys.stderr, flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
