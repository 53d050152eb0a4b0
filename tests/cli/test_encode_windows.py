# SPDX-License-Identifier: Apache-2.0
"""Long captures: `stgs encode --window`, interrupted and resumed."""
import json
import os
import shutil
import signal
import subprocess
import unittest

import harness
from harness import CliTest, built_in
from repeated_video import repeated_video

USAGE, INVALID, RUNTIME = 1, 3, 4


@unittest.skipUnless(built_in("encode"), "encode is not built in")
class Windows(CliTest):
    """16 frames of the sample capture, in windows of eight."""

    def encode(self, *more, capture=None, output="out.stgs"):
        return ["encode", capture or harness.sample(), "-o", output, "--scale", "0.1", "--frames", "0:16",
                "--window", "8", "--preset", "fast", "--iterations", "20", "--max-primitives", "3000", *more]

    def killed(self, number, stage, occurrence):
        """Sends a signal to an encode at the given first progress line of a stage, counted from 1; returns the exit
        code and standard error."""
        args = [harness.STGS, *self.encode("--progress", "json")]
        lines, seen, last = [], 0, False
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            for line in process.stderr:
                lines.append(line)
                here = f'"stage":"{stage}"'.encode() in line
                seen += 1 if here and not last else 0
                if line.startswith(b"{"):
                    last = here
                if here and seen == occurrence:
                    process.send_signal(number)
                    break
            lines.append(process.stderr.read())
        return process.returncode, b"".join(lines).decode()

    def test_an_interrupted_run_continues_to_the_same_file(self):
        report = self.json_of(*self.encode(output="once.stgs"))
        self.assertEqual([(row["first_frame"], row["frames"]) for row in report["windows"]], [(0, 8), (8, 8)])
        self.assertEqual([row["iterations"] for row in report["windows"]], [20, 10])
        self.assertGreater(report["windows"][0]["persistent"], 0)
        self.assertEqual(os.listdir(self.work), ["once.stgs"])
        info = self.json_of("info", "once.stgs")
        self.assertEqual(info["frames"], 16)
        self.assertEqual(info["primitives"], sum(row["primitives"] for row in report["windows"]))
        self.json_of("validate", "once.stgs")
        for number, stage, occurrence in ((signal.SIGKILL, "motion", 1), (signal.SIGINT, "train", 2),
                                          (signal.SIGKILL, "train", 1)):
            with self.subTest(stage=stage, number=number):
                code, error = self.killed(number, stage, occurrence)
                self.assertEqual(code, RUNTIME if number == signal.SIGINT else -number, error)
                if number == signal.SIGINT:
                    self.assertIn("out.stgs: incomplete; run the same command again to continue after frame 8", error)
                self.assertIn("out.stgs.work", os.listdir(self.work))
                self.assertNotIn("out.stgs", os.listdir(self.work))
        # A run with other settings does not continue it.
        self.fails(USAGE, "out.stgs.work: holds an incomplete encoding of another capture or with other settings",
                   *self.encode("--seed", "7"))
        result = self.succeeds(*self.encode("--log-level", "info", "--threads", "1", "--format", "json"))
        self.assertNotIn(b"analysing the first window again", result.stderr)
        self.assertEqual(len(json.loads(result.stdout)["windows"]), 1)
        self.assertEqual(sorted(os.listdir(self.work)), ["once.stgs", "out.stgs"])
        self.assertEqual(self.read("out.stgs"), self.read("once.stgs"))

    def test_options_of_one_scene_are_rejected(self):
        for option in (["--keep-work", "w", "--checkpoint", "run.ckpt"], ["--log", "log.jsonl"], ["--report", "page"],
                       ["--target-size", "100000"], ["--target-kbps", "1000"], ["--max-seconds", "10"]):
            with self.subTest(option=option):
                self.fails(USAGE, "need all frames at once", *self.encode(*option))
        self.fails(USAGE, "windows need dynamic points, which --no-split disables", *self.encode("--no-split"))
        self.fails(USAGE, "--window and --resume exclude each other",
                   *self.encode("--keep-work", "w", "--resume", "run.ckpt"))
        self.fails(USAGE, "the static primitives of the method sharptimegs", *self.encode("--method", "4dgs"))
        self.fails(USAGE, "cannot be written in the profile near-lossless",
                   *self.encode("--profile", "near-lossless"))
        self.fails(USAGE, "--window", "encode", harness.sample(), "-o", "x.stgs", "--window", "2")

    def test_a_long_capture_has_windows_by_default(self):
        os.mkdir(self.path("videos"))
        frames = [{"file_path": name, "transform_matrix": [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]}
                  for x, name in enumerate(("a.mp4", "b.mp4"))]
        self.write("videos/transforms.json", json.dumps({"w": 480, "h": 360, "fl_x": 400, "fps": 30, "frames": frames}))
        with open(os.path.join(harness.sample(), "cam03.mp4"), "rb") as file:
            source = file.read()
        for name in ("a.mp4", "b.mp4"):
            self.write("videos/" + name, repeated_video(source, 301))
        encode = ["encode", "videos", "-o", "out.stgs", "--scale", "0.1", "--iterations", "20"]
        self.fails(USAGE, "add --window 0 to encode 301 frames at once", *encode, "--target-size", "100000")
        self.fails(USAGE, "encode all 301 frames at once with --window 0", *encode, "--no-split")
        # All frames at once: the error is that of the videos.
        for more in (["--window", "0"], ["--frames", "0:300"]):
            self.fails(INVALID, "states the same stored frames many times", *encode, "--target-size", "100000", *more)
        self.assertEqual(os.listdir(self.work), ["videos"])

    def test_a_kept_folder_belongs_to_one_run(self):
        os.mkdir(self.path("full"))
        self.write("full/letter.txt", b"keep me")
        self.fails(USAGE, "full: contains other files", *self.encode("--keep-work", "full"))
        shutil.copytree(harness.sample(), self.path("capture"))
        encode = self.encode("--keep-work", "work", capture="capture")
        report = self.json_of(*encode)
        self.assertEqual(report["work"], "work")
        self.assertIn("recording.stgs", os.listdir(self.path("work")))
        # All windows are complete, so that only the file is written again.
        again = self.json_of(*encode)
        self.assertEqual(again["windows"], [])
        self.assertEqual(again["bytes"], report["bytes"])
        video = next(name for name in sorted(os.listdir(self.path("capture"))) if name.endswith(".mp4"))
        os.utime(self.path("capture", video), (1, 1))
        self.fails(USAGE, "work: holds an incomplete encoding of another capture", *encode)
