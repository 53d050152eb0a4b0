# SPDX-License-Identifier: Apache-2.0
"""Arguments that `stgs train`, `encode`, `evaluate` and `bench` reject before they write a file."""
import json
import os
import pathlib
import shutil
import signal
import struct
import subprocess
import unittest

import harness
from harness import CliTest, built_in, png

USAGE, INVALID, RUNTIME = 1, 3, 4


class Capture(CliTest):
    """Training never modifies its capture."""

    def test_outputs_may_not_replace_the_capture(self):
        folder = self.copy_capture("capture")
        before = self.contents(folder)
        for option, name in [("--log", "points_static.ply"), ("--checkpoint", "capture.json"),
                             ("--report", "frames"), ("--report", "")]:
            args = ["train", folder, "--iterations", "2", option, os.path.join(folder, name)]
            with self.subTest(args=args):
                args += ["-o", "scene.stgs"]
                self.fails(USAGE, f"used by both .*{option}", *args)
                self.assertRegex(self.stgs(*args).stderr, b"DIR")
        self.fails(USAGE, "capture.json: train writes a .stgs file", "train", folder, "--iterations", "2",
                   "-o", os.path.join(folder, "capture.json"))
        self.assertEqual(self.contents(folder), before)
        self.assertEqual(os.listdir(self.work), ["capture"])

    def contents(self, folder):
        files = {}
        for parent, _, names in os.walk(folder):
            for name in names:
                with open(os.path.join(parent, name), "rb") as file:
                    files[os.path.join(parent, name)] = file.read()
        return files

    def test_a_camera_may_be_named_only_once(self):
        self.fails(USAGE, "camera 'a' is named twice", "evaluate", self.fixture("tiny.stgs"),
                   "--against", self.fixture("prepared"), "--cameras", "a,a")


class Foreground(CliTest):
    def test_a_scene_of_what_the_masks_show(self):
        folder = self.copy_capture("capture")
        capture = json.loads(pathlib.Path(folder, "capture.json").read_text(encoding="utf-8"))
        train = ("train", folder, "-o", "a.stgs", "--iterations", "40", "--foreground")
        shutil.rmtree(os.path.join(folder, "masks"), ignore_errors=True)
        self.fails(INVALID, "frame 0 of camera '.*' has no mask, which the foreground needs", *train)
        for camera in capture["cameras"]:
            masks = pathlib.Path(folder, "masks", camera["name"])
            masks.mkdir(parents=True)
            width, height = camera["width"], camera["height"]
            row = b"\0" + bytes(255 if x > width / 4 else 0 for x in range(width))
            for frame in range(capture["frames"]):
                (masks / f"{frame:06}.png").write_bytes(png(width, height, height * row, colours=0))
        self.assertGreater(self.json_of(*train, "--report", "page")["held_out"]["images"], 0)
        evaluate = ("evaluate", "a.stgs", "--against", folder)
        alone = self.json_of(*evaluate, "--foreground", "--masks", os.path.join(folder, "masks"))
        self.assertNotEqual(alone["psnr"], self.json_of(*evaluate)["psnr"])
        self.assertGreater(alone["masked_pixels"], 0)
        self.assertTrue(alone["foreground"])
        pack = ("pack", "a.stgs", "-o", "b.stgs")
        self.json_of(*pack, "--against", folder, "--foreground")
        self.fails(USAGE, "--foreground requires --against", *pack, "--foreground")
        self.fails(USAGE, "seen_background=0 has no effect with --foreground", *train,
                   "--set", "seen_background=0")


class Refinement(CliTest):
    def test_the_output_lists_the_cameras(self):
        folder = self.copy_capture("capture")
        path = os.path.join(folder, "capture.json")
        with open(path, encoding="utf-8") as file:
            capture = json.load(file)
        train = ("train", folder, "-o", "a.stgs", "--iterations", "4")
        self.assertEqual(self.json_of(*train)["cameras"], [])
        self.fails(USAGE, "--refine-cameras needs at least 3 training cameras", *train,
                   "--refine-cameras")
        for camera in capture["cameras"]:
            camera["test"] = False
        with open(path, "w", encoding="utf-8") as file:
            json.dump(capture, file)
        cameras = self.json_of(*train, "--refine-cameras", "--report", "page")["cameras"]
        self.assertEqual([c["name"] for c in cameras], [c["name"] for c in capture["cameras"]])
        with open(self.path("page/index.html"), encoding="utf-8") as file:
            self.assertIn("Refined cameras", file.read())
        # The scene starts at a camera as calibrated, so that it is known to be of this capture.
        cameras = self.json_of("train", folder, "-o", "c.stgs", "--iterations", "100",
                               "--refine-cameras", "--set", "lr_camera=0.1", "--set",
                               "camera_pull=0")["cameras"]
        self.assertTrue(all(c["pixels"] > 0.02 for c in cameras), cameras)
        self.assertTrue(any(c["distortion"] != 0 and c["corner_brightness"] != 1
                            for c in cameras), cameras)
        cameras = self.json_of("train", folder, "-o", "d.stgs", "--iterations", "100",
                               "--refine-timing")["cameras"]
        self.assertTrue(all(c["pixels"] == 0 for c in cameras), cameras)
        self.assertTrue(any(c["time_shift"] != 0 for c in cameras), cameras)
        result = self.succeeds("evaluate", "c.stgs", "--against", folder, "--cameras", "train")
        self.assertNotIn(b"start camera", result.stderr)
        self.fails(USAGE, "lr_camera=1e-3 has no effect without --refine-cameras", "train",
                   self.fixture("prepared"), "-o", "b.stgs", "--set", "lr_camera=1e-3")


class Parameters(CliTest):
    def test_invalid_values_are_rejected(self):
        cases = [
            (r"--set sh_degree=1.5: invalid value \(expected an integer", ["sh_degree=1.5"]),
            (r"--set drop_share=nan: invalid value \(expected a number", ["drop_share=nan"]),
            (r"hyper-parameter seen_background is out of range \(expected 0 to 1, got 7\)",
             ["seen_background=7"]),
            ("sh_degree is set twice", ["sh_degree=1", "sh_degree=2"]),
        ]
        for message, values in cases:
            with self.subTest(values=values):
                options = [word for value in values for word in ("--set", value)]
                self.fails(USAGE, message, "train", self.fixture("prepared"), "-o", "a.stgs", *options)

    def test_training_that_prunes_everything_writes_no_scene(self):
        values = ["prune_opacity=0.999", "initial_opacity=0.01", "initial_opacity_dynamic=0.01",
                  "densify_interval=5"]
        self.fails(RUNTIME, "training left no primitives: all were pruned as too faint",
                   "train", self.fixture("prepared"), "-o", "a.stgs", "--backend", "cpu",
                   "--iterations", "60", *[word for value in values for word in ("--set", value)])
        self.assertFalse(os.path.exists(self.path("a.stgs")))

    @unittest.skipUnless(built_in("encode"), "encode is not built in")
    def test_encode_rejects_an_invalid_orientation_before_preparing(self):
        sample = os.path.join(harness.SOURCE, "tests", "data", "workshop")
        for message, options in [("has no direction", ["--up", "0,0,0"]),
                                 ("requires an up vector", ["--floor", "0,0,0"])]:
            with self.subTest(options=options):
                self.fails(USAGE, message, "encode", sample, "-o", "a.stgs", *options, "--keep-work",
                           "work")
                self.assertEqual(os.listdir(self.work), [])


class SyntheticScene(CliTest):
    """`stgs bench` synthesises a dynamic scene from a model of 200,001 primitives."""

    def setUp(self):
        super().setUp()
        names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
                 "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
        header = "ply\nformat binary_little_endian 1.0\nelement vertex 200001\n"
        header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
        points = b"".join(struct.pack("<14f", k % 97 / 97, k % 89 / 89, k % 83 / 83, 0, 0, 0, -3,
                                      -5, -5, -5, 1, 0, 0, 0) for k in range(200001))
        self.write("model.ply", header.encode() + points)
        self.write("camera.json", json.dumps(
            {"width": 32, "height": 32, "fx": 32, "fy": 32, "cx": 16, "cy": 16,
             "rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [-0.5, -0.5, 3]}))
        self.succeeds("convert", "model.ply", "model.stgs")
        self.bench = ["bench", "model.stgs", "--camera", "camera.json", "--backend", "cpu"]

    def test_too_many_primitives_are_rejected(self):
        self.fails(USAGE, "makes 200001000 primitives of 200001; a file holds at most",
                   *self.bench, "--stored-ratio", "1000")

    def test_frames_that_exceed_the_memory_budget_are_reported(self):
        play = [*self.bench, "--stored-ratio", "1", "--quality", "80", "--play", "player", "--frames", "3"]
        warning = b"frames are incomplete because --memory is too small"
        self.assertNotIn(warning, self.succeeds(*play).stderr)
        self.assertIn(warning, self.succeeds(*play, "--memory", "6M").stderr)

    def test_bench_is_interruptible_while_it_synthesises(self):
        args = [harness.STGS, *self.bench, "--stored-ratio", "200"]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            try:
                process.wait(1)
            except subprocess.TimeoutExpired:
                pass
            process.send_signal(signal.SIGINT)
            error = process.communicate(timeout=300)[1].decode()
        self.assertEqual(process.returncode, RUNTIME, error)
        self.assertIn("interrupted by SIGINT: ", error)
