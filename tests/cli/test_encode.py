# SPDX-License-Identifier: Apache-2.0
"""`stgs train` and `stgs encode`: arguments they reject, files they write, and interruptions."""
import fcntl
import json
import os
import re
import signal
import subprocess
import unittest
import urllib.parse
import xml.etree.ElementTree

import harness
from harness import CliTest

USAGE, IO, INVALID, RUNTIME = 1, 2, 3, 4


class ReportTest(CliTest):
    def page(self, folder):
        """Reads index.html after checking that it is self-contained: no scripts, no links, and
        every image present."""
        text = self.read(os.path.join(folder, "index.html")).decode()
        self.assertNotRegex(text, r"<script|https?:|<link|@import")
        for name in re.findall(r'src="([^"]+)"', text):
            self.assertTrue(os.path.exists(self.path(folder, urllib.parse.unquote(name))), name)
        for svg in re.findall(r"<svg.*?</svg>", text, re.DOTALL):
            xml.etree.ElementTree.fromstring(svg)
        return text


class Training(ReportTest):
    def train(self, *more):
        return ["train", self.fixture("prepared"), "-o", "out.stgs", "--preset", "fast", *more]

    def test_train_writes_a_lossless_scene(self):
        report = self.json_of(*self.train("--iterations", "20", "--max-primitives", "300"))
        self.assertEqual(report["iterations"], 20)
        self.assertRegex(report["backend"], r"^(cpu|cuda) \(.+\)$")
        self.assertEqual(report["bytes"], os.path.getsize(self.path("out.stgs")))
        info = self.json_of("info", "out.stgs")
        self.assertEqual(info["profile"], "lossless")
        self.assertEqual(info["primitives"], report["primitives"])
        self.json_of("validate", "out.stgs")
        first = self.read("out.stgs")
        self.succeeds(*self.train("--iterations", "20", "--max-primitives", "300", "--threads",
                                  "1"))
        self.assertEqual(self.read("out.stgs"), first, "threads changed the scene")

    def test_parameters_are_listed(self):
        report = self.json_of("train", "--list-parameters", "--method", "freetimegs")
        self.assertEqual(report["method"], "freetimegs")
        self.assertEqual(report["parameters"]["weight_scale"], "0")
        report = self.json_of("train", "--list-parameters", "--preset", "fast")
        self.assertGreater(len(report["parameters"]), 5)

    def test_train_rejects_bad_arguments(self):
        os.mkdir(self.path("empty"))
        self.write("rubbish", b"rubbish" * 100)
        prepared = self.fixture("prepared")
        cases = [
            (USAGE, "DIR, the prepared capture, is required", ["train", "-o", "o.stgs"]),
            (USAGE, "--output is required", ["train", prepared]),
            (USAGE, "--preset: 'slow' is not one of", self.train("--preset", "slow")),
            (USAGE, "--ablate: 'colour' is not one of", self.train("--ablate", "colour")),
            (USAGE, "--iterations: 0 is out of range", self.train("--iterations", "0")),
            (USAGE, "expected KEY=VALUE", self.train("--set", "lambda")),
            (USAGE, "conflicts with --iterations",
             self.train("--set", "iterations=5", "--iterations", "2")),
            (USAGE, "--set lr_radius=1 has no effect with --ablate lifespan",
             self.train("--set", "lr_radius=1", "--ablate", "lifespan")),
            (USAGE, "--set plain_reset=.2 has no effect unless --ablate densification",
             self.train("--set", "plain_reset=.2")),
            (USAGE, "--set perceptual_patch=64 has no effect without --perceptual-weights",
             self.train("--set", "perceptual_patch=64")),
            (USAGE, "unknown hyper-parameter", self.train("--set", "zzz=1")),
            (USAGE, r"hyper-parameter iterations is out of range \(expected 1 to",
             self.train("--set", "iterations=0")),
            (USAGE, "--checkpoint-interval requires --checkpoint",
             self.train("--checkpoint-interval", "5")),
            (INVALID, "not a prepared capture", ["train", "empty", "-o", "o.stgs"]),
            (IO, "cannot create", ["train", prepared, "-o", "/proc/o.stgs"]),
            (IO, "none.ckpt", self.train("--resume", "none.ckpt")),
            (INVALID, "rubbish", self.train("--resume", "rubbish")),
        ]
        for code, message, args in cases:
            with self.subTest(args=args):
                self.fails(code, message, *args)
        self.assertEqual(sorted(os.listdir(self.work)), ["empty", "rubbish"])

    def test_outputs_must_be_different_files(self):
        self.write("scene.stgs", b"old")
        os.mkdir(self.path("sub"))
        os.symlink(self.work, self.path("sub/up"))
        os.symlink("scene.stgs", self.path("link.ckpt"))
        train = ["train", self.fixture("prepared"), "-o", "scene.stgs", "--preset", "fast"]
        for first, second, args in [
                ("--output", "--checkpoint", [*train, "--checkpoint", "scene.stgs"]),
                ("--output", "--checkpoint", [*train, "--checkpoint", "link.ckpt"]),
                ("--output", "--checkpoint", [*train, "--checkpoint", "sub/up/scene.stgs"]),
                ("--output", "--log", [*train, "--log", "sub/../scene.stgs"]),
                ("--output", "--resume", [*train, "--resume", "link.ckpt"]),
                ("--output", "--report", ["train", self.fixture("prepared"), "-o", "new",
                                          "--report", "new"]),
                ("--checkpoint", "--log", [*train, "--checkpoint", "a", "--log", "./a"]),
                ("--output", "--checkpoint", ["encode", harness.sample(), "-o", "scene.stgs",
                                              "--checkpoint", "link.ckpt"]),
                ("--keep-work", "--checkpoint", ["encode", harness.sample(), "-o", "b.stgs",
                                                 "--keep-work", "w", "--checkpoint",
                                                 "w/../w/trained.stgs"])]:
            with self.subTest(args=args):
                if "w" in args:
                    os.mkdir(self.path("w"))
                self.fails(USAGE, f"used by both {first} and {second}", *args)
        self.assertEqual(self.read("scene.stgs"), b"old")
        self.assertEqual(sorted(os.listdir(self.work)), ["link.ckpt", "scene.stgs", "sub", "w"])

    def test_a_killed_train_resumes_to_the_same_bytes(self):
        """After two SIGKILLs, the log and the scene equal those of an uninterrupted run."""
        options = ["--iterations", "800", "--max-primitives", "300", "--set",
                   "densify_interval=20"]
        self.succeeds(*self.train(*options, "--log", "uninterrupted.jsonl"))
        os.rename(self.path("out.stgs"), self.path("uninterrupted.stgs"))
        options += ["--log", "log.jsonl", "--checkpoint", "run.ckpt", "--checkpoint-interval",
                    "20"]
        iteration = 0
        for share in (0.3, 0.6):
            resume = ["--resume", "run.ckpt"] if iteration else []
            args = [harness.STGS, *self.train(*options, *resume, "--progress", "json")]
            with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
                for line in process.stderr:
                    progress = json.loads(line) if line.startswith(b"{") else {}
                    if progress.get("stage") == "train" and progress["done"] >= share:
                        break
                process.kill()
            self.assertEqual(process.returncode, -signal.SIGKILL)
            self.assertFalse(os.path.exists(self.path("out.stgs")))
            before, iteration = iteration, int.from_bytes(self.iteration("run.ckpt"), "little")
            self.assertGreater(iteration, before)
            self.assertLess(iteration, 800)
        # The next run removes a partial checkpoint that a killed process left.
        self.write(".run.abcdefghijkl.tmp.ckpt", b"half a checkpoint")
        self.succeeds(*self.train(*options, "--resume", "run.ckpt"))
        self.assertEqual(self.read("out.stgs"), self.read("uninterrupted.stgs"))
        self.assertEqual(self.log("log.jsonl"), self.log("uninterrupted.jsonl"))

    def iteration(self, checkpoint):
        """Returns the 8 bytes of the iteration, which follow the magic and the fingerprint."""
        data = self.read(checkpoint)
        offset = 16 + int.from_bytes(data[8:16], "little")
        return data[offset:offset + 8]

    def log(self, name):
        """Returns the lines of a log, checked against the schema, without their wall-clock times."""
        lines = [json.loads(line) for line in self.read(name).splitlines()]
        for line in lines:
            self.check_schema("training_log", line)
            del line["seconds"]
        return lines

    def test_evaluating_held_out_views_does_not_change_the_scene(self):
        args = self.train("--iterations", "20", "--max-primitives", "300")
        evaluated = self.json_of(*args, "--log", "log.jsonl", "--num-evals", "2")
        scene = self.read("out.stgs")
        evaluations = [line for line in self.log("log.jsonl") if "held_out" in line]
        self.assertEqual([line["iteration"] for line in evaluations], [10, 20])
        self.assertEqual(evaluations[-1]["held_out"], evaluated["held_out"])
        # Training samples the six frames of the only test camera, which evaluate also measures.
        report = self.json_of("evaluate", "out.stgs", "--against", self.fixture("prepared"))
        self.assertAlmostEqual(report["psnr"], evaluated["held_out"]["psnr"], 3)
        self.assertAlmostEqual(report["psnr_cc"], evaluated["held_out"]["psnr_cc"], 3)
        progress = self.succeeds(*args, "--num-evals", "2", "--progress", "json").stderr.decode()
        last = [line for line in progress.splitlines() if '"stage":"train"' in line][-1]
        self.assertRegex(last, r"held-out psnr \d+\.\d\d dB")
        without = self.json_of(*args, "--num-evals", "0")
        self.assertIsNone(without["held_out"])
        self.assertEqual(self.read("out.stgs"), scene)

    def test_weight_normal_trains_and_logs_normals(self):
        args = self.train("--iterations", "60", "--max-primitives", "300", "--log", "log.jsonl")
        self.succeeds(*args)
        self.assertEqual(self.normals(), [0, 0, 0])
        without = self.read("out.stgs")
        self.succeeds(*args, "--set", "weight_normal=0.01", "--set", "normal_from=0.5")
        first, *later = self.normals()
        self.assertEqual(first, 0)
        self.assertTrue(later and all(value > 0 for value in later))
        self.assertNotEqual(self.read("out.stgs"), without)
        # The coupled representation has no axes of its own.
        self.fails(USAGE, "weight_normal=0.01 has no effect with --ablate representation",
                   *args, "--set", "weight_normal=0.01", "--ablate", "representation")

    def normals(self):
        return [line["normal"] for line in self.log("log.jsonl") if "normal" in line]

    def test_streaming_frames_from_disk_gives_the_same_scene(self):
        args = self.train("--iterations", "20", "--max-primitives", "300")
        frames = self.json_of(*args)["frames"]
        self.assertTrue(frames["resident"])
        self.assertLess(frames["peak"], frames["budget"])
        scene = self.read("out.stgs")
        frames = self.json_of(*args, "--frame-memory", "40K")["frames"]
        self.assertFalse(frames["resident"])
        self.assertEqual(frames["budget"], 40 << 10)
        self.assertGreater(frames["peak"], 0)
        self.assertEqual(self.read("out.stgs"), scene)
        for size in ("0", "much", "-1G", "8Q", "G"):
            self.fails(USAGE, "expected for example 512M or 8G", *args, f"--frame-memory={size}")

    def test_the_report_contains_the_run_and_the_final_scene(self):
        args = self.train("--iterations", "120", "--max-primitives", "300", "--seed", "3", "--set",
                          "prune_opacity=0.004", "--threads", "1", "--report", "a <b>/page")
        os.mkdir(self.path("a <b>"))
        report = self.json_of(*args)
        self.assertEqual(report["report"], "a <b>/page")
        text = self.page("a <b>/page")
        self.assertIn("<td>threads</td><td>1</td>", text)
        for title in ("Loss, running mean", "Held-out PSNR, dB", "Primitives"):
            self.assertEqual(text.count(f"<title>{title}</title>"), 2, title)  # steps, seconds
        self.assertIn("<td>prune_opacity</td><td>0.004</td>", text)
        self.assertIn("--report 'a &lt;b&gt;/page'", text)
        self.assertIn("120", text)
        motion = self.json_of("info", "out.stgs", "--lifespans")["motion"]
        self.assertIn(f"{100 * motion['static']['share']:.1f} %: visible in every frame", text)
        self.assertIn("whole clip", text)
        if harness.built_in("prepare"):
            self.assertIn('<video src="turntable.mp4"', text)
            with open(self.path("a <b>/page/turntable.mp4"), "rb") as file:
                self.assertEqual(file.read(8)[4:], b"ftyp")
        else:
            self.assertIn("No video: this build has no mp4", text)
            self.assertNotIn("<video", text)
        self.assertEqual(len(self.log("a <b>/page/training.jsonl")), 4 + 5)
        for frame in (0, 5):
            ground_truth = self.fixture(f"prepared/frames/c/{frame:06}.png")
            difference = self.json_of("compare", f"a <b>/page/ground_truth_c_{frame:06}.png",
                                      ground_truth)
            self.assertEqual(difference["max_difference"], 0)
            self.succeeds("render", "out.stgs", "--frames", f"{frame}:{frame + 1}", "--cameras",
                          self.fixture("prepared"), "--which", "c", "-o", "final.png")
            self.assertEqual(self.read(f"a <b>/page/render_c_{frame:06}.png"),
                             self.read("final.png"))
            self.assertIn(f'src="error_c_{frame:06}.png"', text)

    def test_a_report_without_held_out_cameras_shows_training_cameras(self):
        folder = self.copy_capture("all")
        with open(os.path.join(folder, "capture.json"), encoding="utf-8") as file:
            capture = json.load(file)
        for camera in capture["cameras"]:
            camera["test"] = False
        self.write("all/capture.json", json.dumps(capture))
        self.succeeds("train", "all", "-o", "out.stgs", "--preset", "fast", "--iterations", "5",
                      "--report", "page", "--log", "mine.jsonl")
        self.assertIn("Training cameras (none was held out)", self.page("page"))
        self.assertNotIn("training.jsonl", os.listdir(self.path("page")))
        self.fails(IO, "page/index.html", "train", "all", "-o", "out.stgs", "--iterations", "1",
                   "--report", "page/index.html")

    def test_ablations_may_be_combined(self):
        args = self.train("--iterations", "20", "--max-primitives", "300")
        scenes = []
        for names in ("lifespan", "densification,lifespan", "lifespan,densification",
                      "lifespan,modulation,densification"):
            # The fixture is static: with damping, scenes with and without modulation would be equal.
            self.succeeds(*args, "--ablate", names, "--set", "densify_interval=2",
                          "--set", "velocity_shrink=0")
            scenes.append(self.read("out.stgs"))
        self.assertEqual(scenes[1], scenes[2])
        self.assertEqual(len(set(scenes)), 3)
        self.fails(USAGE, "'lifespan' is given twice", *args, "--ablate", "lifespan,lifespan")
        self.fails(USAGE, "--ablate: modulation has no effect together with representation",
                   *args, "--ablate", "representation,modulation")
        self.fails(USAGE, "--ablate: 'magic' is not one of", *args, "--ablate", "lifespan,magic")
        self.fails(USAGE, "has no dynamic points", *args, "--ablate", "lifespan,initialisation")

    def test_published_methods_train_and_take_no_ablation(self):
        args = self.train("--iterations", "20", "--max-primitives", "300")
        scenes = []
        for method in ("sharptimegs", "freetimegs", "4dgs"):
            self.succeeds(*args, "--method", method)
            scenes.append(self.read("out.stgs"))
        self.assertEqual(len(set(scenes)), 3)
        self.fails(USAGE, "--method: '3dgs' is not one of", *args, "--method", "3dgs")
        self.fails(USAGE, "--ablate disables parts of sharptimegs; remove it or --method 4dgs",
                   *args, "--method", "4dgs", "--ablate", "lifespan")
        self.fails(USAGE, "--set plain_until=0.4 has no effect unless --ablate densification",
                   *args, "--set", "plain_until=0.4")

    def test_an_interrupted_train_writes_only_its_checkpoint(self):
        args = [harness.STGS, *self.train("--iterations", "100000", "--checkpoint", "run.ckpt",
                                          "--progress", "json")]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            for line in process.stderr:
                if b'"train"' in line:
                    break
            process.send_signal(signal.SIGINT)
            error = process.stderr.read().decode()
        self.assertEqual(process.returncode, RUNTIME, error)
        self.assertIn("stgs: error: interrupted", error)
        self.assertEqual(os.listdir(self.work), ["run.ckpt"])


class Encoding(ReportTest):
    def setUp(self):
        super().setUp()
        if not harness.built_in("encode"):
            self.skipTest("encode is not built in")

    def signalled(self, number, stage):
        """Sends a signal to an encode at its first progress line of `stage`; returns the exit code
        and standard error."""
        args = [harness.STGS, "encode", harness.sample(), "-o", "out.stgs", "--progress", "json",
                "--scale", "0.125", "--frames", "0:2", "--iterations", "10"]
        lines = []
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            for line in process.stderr:
                lines.append(line)
                if f'"stage":"{stage}'.encode() in line:
                    process.send_signal(number)
                    break
            lines.append(process.stderr.read())
        return process.returncode, b"".join(lines).decode()

    def test_an_aborted_encode_leaves_the_old_file(self):
        """The encode is killed in prepare, and interrupted in train and in pack."""
        self.write("out.stgs", b"old")
        code, error = self.signalled(signal.SIGKILL, "")
        self.assertEqual(code, -signal.SIGKILL, error)
        self.assertEqual(self.read("out.stgs"), b"old")
        left = [name for name in os.listdir(self.work)
                if name not in ("out.stgs", ".out.stgs.lock")]
        self.assertEqual(len(left), 1)
        self.assertRegex(left[0], r"^\.out\.stgs\.[a-z2-7]{12}\.tmp\.work$")
        # Similar names that stay: in use, of another output, of another form.
        unrelated = [".out.stgs.abcdefghijkl.tmp.work", left[0].replace("out", "in"),
                     ".out.stgs.x1.tmp.work"]
        for name in unrelated:
            os.mkdir(self.path(name))
        lock = open(self.path(unrelated[0], "lock"), "wb")
        self.addCleanup(lock.close)
        fcntl.flock(lock, fcntl.LOCK_EX)
        for stage in ("train", "pack"):
            with self.subTest(stage=stage):
                code, error = self.signalled(signal.SIGINT, stage)
                self.assertEqual(code, RUNTIME, error)
                self.assertRegex(error, r"(?m)^stgs: error: interrupted by SIG(INT|TERM): ")
                self.assertEqual(f"{left[0]}: removed" in error, stage == "train", error)
                self.assertEqual(self.read("out.stgs"), b"old")
                self.assertEqual(sorted(os.listdir(self.work)), sorted(["out.stgs", *unrelated]))

    def test_encode_writes_only_its_output_and_its_report(self):
        report = self.json_of("encode", harness.sample(), "-o", "out.stgs", "--scale", "0.125",
                              "--frames", "0:2", "--preset", "fast", "--iterations", "10",
                              "--report", "page")
        self.assertEqual(report["train"]["held_out"]["images"], 2)
        self.assertEqual(report["report"], "page")
        self.assertIn("Test cameras: render, ground truth and error", self.page("page"))
        self.assertEqual(sorted(os.listdir(self.work)), ["out.stgs", "page"])

    def test_encode_rejects_bad_arguments_before_preparing(self):
        self.fails(IO, "cannot create", "encode", harness.sample(), "-o", "/proc/out.stgs")
        self.write("rubbish", b"rubbish" * 100)
        encode = ["encode", harness.sample(), "-o", "o.stgs", "--progress", "json"]
        for code, message, more in [
                (USAGE, "--quality: 500 is out of range", ["--quality", "500"]),
                (USAGE, "--set lr_time=soon: invalid value", ["--set", "lr_time=soon"]),
                (USAGE, "hyper-parameter iterations is out of range", ["--set", "iterations=0"]),
                (IO, "none.ckpt", ["--keep-work", "w", "--resume", "none.ckpt"]),
                (INVALID, "rubbish: not an STGS checkpoint",
                 ["--keep-work", "w", "--resume", "rubbish"])]:
            with self.subTest(more=more):
                result = self.fails(code, message, *encode, *more)
                self.assertNotIn(b'"stage"', result.stderr, "preparing had started")
        self.assertEqual(os.listdir(self.work), ["rubbish"])

    def test_encode_ablates_the_initialisation_as_prepare_and_train_do(self):
        prepare = ["--scale", "0.125", "--frames", "0:2"]
        train = ["--preset", "fast", "--iterations", "10", "--ablate", "initialisation"]
        self.succeeds("encode", harness.sample(), "-o", "out.stgs", *prepare, *train,
                      "--keep-work", "work")
        self.succeeds("train", "work/prepared", "-o", "trained.stgs", *train)
        self.assertEqual(self.read("trained.stgs"), self.read("work/trained.stgs"))


if __name__ == "__main__":
    unittest.main()
