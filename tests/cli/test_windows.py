# SPDX-License-Identifier: Apache-2.0
"""Long captures: `stgs train` on training windows and `stgs pack` merging them."""
import os
import signal
import subprocess

import harness
from harness import CliTest

USAGE, IO, INVALID, RUNTIME = 1, 2, 3, 4


class Windows(CliTest):
    """The fixture's capture has six frames."""

    def train(self, *more):
        return ["train", self.fixture("prepared"), "--preset", "fast", "--iterations", "20",
                "--max-primitives", "300", *more]

    def test_windows_are_trained_as_independent_jobs(self):
        windows = ["--window", "3", "--overlap", "1"]
        report = self.json_of(*self.train("-o", "parts", *windows, "--report", "pages"))
        names = ["000000-000003", "000002-000005", "000003-000006"]
        self.assertEqual([row["output"] for row in report["windows"]],
                         [f"parts/{name}.stgs" for name in names])
        self.assertEqual([(row["first_frame"], row["frames"]) for row in report["windows"]],
                         [(0, 3), (2, 3), (3, 3)])
        self.assertEqual(sorted(os.listdir(self.path("parts"))),
                         [f"{name}.stgs" for name in names])
        for name in names:
            self.assertIn("index.html", os.listdir(self.path(f"pages/{name}")))
            self.assertIn("training.jsonl", os.listdir(self.path(f"pages/{name}")))
        info = self.json_of("info", "parts/000002-000005.stgs")
        self.assertEqual(info["window"], {"first_frame": 2, "capture_frames": 6})
        self.assertEqual(info["frames"], 3)
        # An array job and an explicit frame range give the same bytes.
        self.json_of(*self.train("-o", "array", *windows, "--window-index", "1"))
        self.assertEqual(os.listdir(self.path("array")), ["000002-000005.stgs"])
        self.succeeds(*self.train("-o", "explicit.stgs", "--frames", "2:5"))
        for other in ("array/000002-000005.stgs", "explicit.stgs"):
            self.assertEqual(self.read(other), self.read("parts/000002-000005.stgs"))
        # Finished windows are not trained again; a missing one is trained to the same bytes.
        before = self.read("parts/000003-000006.stgs")
        os.remove(self.path("parts/000003-000006.stgs"))
        again = self.json_of(*self.train("-o", "parts", *windows))
        self.assertEqual([row["training"] is None for row in again["windows"]],
                         [True, True, False])
        self.assertEqual(self.read("parts/000003-000006.stgs"), before)
        self.fails(USAGE, "000000-000003.stgs: belongs to another capture or was trained with other",
                   *self.train("-o", "parts", *windows, "--set", "lr_time=0.02"))
        # Equivalent settings match, however they are written.
        for same in (["--set", "lr_time=.010"], ["--seed", "9"]):
            again = self.json_of(*self.train("-o", "parts", *windows, *same))
            self.assertEqual([row["training"] for row in again["windows"]], [None] * 3)

    def test_a_folder_contains_the_windows_of_one_plan(self):
        self.succeeds(*self.train("-o", "parts", "--window", "3"))
        os.remove(self.path("parts/000000-000003.stgs"))
        self.fails(USAGE, r"parts/000003-000006.stgs: is a window \(frames 3:6\) of another plan than "
                   "--window 4 --overlap 2; remove it or use another folder",
                   *self.train("-o", "parts", "--window", "4", "--overlap", "2"))
        self.assertEqual(os.listdir(self.path("parts")), ["000003-000006.stgs"])
        # This applies to windows trained by --frames as well, and to a single --window-index.
        self.succeeds(*self.train("-o", "parts/first.stgs", "--frames", "0:4"))
        for index in ([], ["--window-index", "1"]):
            self.fails(USAGE, r"first.stgs: is a window \(frames 0:4\) of another plan",
                       *self.train("-o", "parts", "--window", "3", *index))
        os.remove(self.path("parts/first.stgs"))
        # Other settings are rejected before any window is trained.
        self.fails(USAGE, "000003-000006.stgs: belongs to another capture or was trained with other",
                   *self.train("-o", "parts", "--window", "3", "--set", "lr_time=0.02"))
        self.assertEqual(os.listdir(self.path("parts")), ["000003-000006.stgs"])
        self.succeeds(*self.train("-o", "parts", "--window", "3", "--window-index", "0"))
        self.assertEqual(len(os.listdir(self.path("parts"))), 2)

    def test_reports_may_be_in_the_folder_of_the_windows(self):
        windows = ["--window", "3"]
        report = self.json_of(*self.train("-o", "new/", *windows, "--report", "./new/pages"))
        self.assertEqual(report["windows"][0]["output"], "new/000000-000003.stgs")
        self.assertIn("index.html", os.listdir(self.path("new/pages/000003-000006")))
        self.fails(IO, "folder 'none' does not exist",
                   *self.train("-o", "none/x.stgs", "--report", "none/pages"))
        self.fails(IO, "folder 'none/deep' does not exist",
                   *self.train("-o", "none", *windows, "--report", "none/deep/pages"))
        self.assertFalse(os.path.exists(self.path("none")))

    def test_a_window_is_evaluated_and_rendered_at_its_own_frames(self):
        self.succeeds(*self.train("-o", "part.stgs", "--frames", "4:6"))
        prepared = self.fixture("prepared")
        report = self.json_of("evaluate", "part.stgs", "--against", prepared)
        self.assertEqual(report["views"][0]["frames"], 2)
        self.succeeds("render", "part.stgs", "--cameras", prepared, "--frames", "0:1", "--side-by-side",
                      "-o", "side-by-side.png")
        self.fails(USAGE, "between|missing|out of range",
                   *self.train("-o", "x.stgs", "--frames", "4:9"))

    def test_windows_are_merged_in_any_order(self):
        self.json_of(*self.train("-o", "parts", "--window", "4", "--overlap", "2"))
        first, second = "parts/000000-000004.stgs", "parts/000002-000006.stgs"
        report = self.json_of("pack", second, first, "-o", "whole.stgs")
        self.assertEqual([(part["input"], part["begin_frame"], part["end_frame"])
                          for part in report["parts"]], [(first, 0, 2.5), (second, 2.5, 6)])
        self.assertEqual(report["inputs"], [second, first])
        info = self.json_of("info", "whole.stgs", "--lifespans")
        self.assertEqual(info["frames"], 6)
        self.assertIsNone(info["window"])
        self.assertEqual(len(info["parts"]), 2)
        self.assertEqual(sum(part["primitives"] for part in info["parts"]), report["primitives"])
        self.assertGreater(info["motion"]["static"]["primitives"], 0)
        self.assertIn("part             0.000 s", self.succeeds("info", "whole.stgs").stdout.decode())
        self.json_of("validate", "whole.stgs")
        prepared = self.fixture("prepared")
        scores = self.json_of("evaluate", "whole.stgs", "--against", prepared)
        self.assertEqual(scores["views"][0]["frames"], 6)
        halves = [self.json_of("evaluate", part, "--against", prepared) for part in (first, second)]
        self.assertGreater(scores["psnr"], min(half["psnr"] for half in halves) - 0.5)

    def test_windows_with_different_seeds_are_merged(self):
        for name, frames, seed in (("a.stgs", "0:3", "1"), ("b.stgs", "3:6", "2")):
            # With so few primitives, each seed selects different points of the capture.
            self.succeeds("train", self.fixture("prepared"), "--preset", "fast", "--iterations",
                          "20", "--max-primitives", "100", "--frames", frames, "--seed", seed,
                          "-o", name)
        backgrounds = [self.json_of("info", name)["background"] for name in ("a.stgs", "b.stgs")]
        self.assertEqual(*backgrounds)
        self.assertEqual(len(self.json_of("pack", "a.stgs", "b.stgs", "-o", "x.stgs")["parts"]), 2)

    def test_unsuitable_windows_are_rejected(self):
        self.json_of(*self.train("-o", "parts", "--window", "2"))
        parts = [f"parts/{name}.stgs" for name in ("000000-000002", "000002-000004",
                                                   "000004-000006")]
        self.succeeds(*self.train("-o", "other.stgs", "--frames", "2:4", "--set", "lr_time=0.02"))
        self.succeeds(*self.train("-o", "whole.stgs"))
        cases = [
            (USAGE, "frames 2:4 are missing between", [parts[0], parts[2]]),
            (USAGE, "frames 4:6 are missing after", [parts[0], parts[1]]),
            (USAGE, "frames 0:2 are missing before", [parts[2], parts[1]]),
            (USAGE, "one window contains the other", [parts[0], parts[0], parts[1]]),
            (USAGE, "trained with different settings", [parts[0], "other.stgs", parts[2]]),
            (USAGE, "whole.stgs: not a window of a capture", [parts[0], "whole.stgs"]),
            (USAGE, "this is the input scene itself", [*parts, "-o", parts[1]]),
        ]
        for code, message, inputs in cases:
            with self.subTest(message=message):
                output = [] if "-o" in inputs else ["-o", "merged.stgs"]
                self.fails(code, message, "pack", *inputs, *output)
        for message, options in [
                ("expected 0 <= overlap < window", ["--window", "2", "--overlap", "2"]),
                ("--window-index 3 is out of range; expected 0 to 2", ["--window", "2", "--window-index", "3"]),
                ("--overlap requires --window", ["--overlap", "1"]),
                ("excludes", ["--window", "2", "--frames", "0:2"]),
                ("cannot be used with --window", ["--window", "2", "--checkpoint", "c.ckpt"]),
                ("cannot be used with --window", ["--window", "2", "--log", "l.jsonl"])]:
            with self.subTest(message=message):
                self.fails(USAGE, message, *self.train("-o", "refused", *options))
        os.mkdir(self.path("folder"))
        self.write("folder/000000-000002.stgs", b"rubbish" * 100)
        self.fails(INVALID, "not an .stgs file", *self.train("-o", "folder", "--window", "2"))

    def test_a_stopped_window_resumes_from_its_checkpoint(self):
        command = ["train", self.fixture("prepared"), "--preset", "fast", "--max-primitives", "300",
                   "--iterations", "1500", "--window", "3"]
        names = ("000000-000003.stgs", "000003-000006.stgs")
        self.succeeds(*command, "-o", "uninterrupted")
        for number in (signal.SIGINT, signal.SIGKILL):
            with self.subTest(signal=number):
                folder = f"stopped{number}"
                checkpoint = self.path(f"{folder}/{names[1]}.ckpt")
                with subprocess.Popen([harness.STGS, *command, "-o", folder, "--progress", "json"],
                                      cwd=self.work, stderr=subprocess.PIPE) as process:
                    for line in process.stderr:
                        first_done = os.path.exists(self.path(f"{folder}/{names[0]}"))
                        if number == signal.SIGKILL:
                            if os.path.exists(checkpoint):
                                break
                        elif first_done and b'"train"' in line and b'"done":0.' in line:
                            break
                    process.send_signal(number)
                    error = process.stderr.read().decode()
                if number == signal.SIGINT:
                    self.assertEqual(process.returncode, RUNTIME, error)
                    self.assertIn(f"{names[1]}: incomplete; run the same command again to resume", error)
                else:
                    self.assertEqual(process.returncode, -number, error)
                lock = [f".{names[1]}.lock"] if number == signal.SIGKILL else []
                self.assertEqual(sorted(os.listdir(self.path(folder))),
                                 [*lock, names[0], f"{names[1]}.ckpt"])
                log = self.succeeds(*command, "-o", folder).stderr.decode()
                self.assertRegex(log, r"resumed at iteration \d+ from .*000003-000006")
                for name in names:
                    self.assertEqual(self.read(f"{folder}/{name}"), self.read(f"uninterrupted/{name}"))
                # A checkpoint remains if the process is killed after it wrote the scene.
                self.write(f"{folder}/{names[1]}.ckpt", b"")
                self.succeeds(*command, "-o", folder)
                self.assertEqual(sorted(os.listdir(self.path(folder))), list(names))
