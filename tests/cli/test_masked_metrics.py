# SPDX-License-Identifier: Apache-2.0
"""Metrics of evaluate within masks, and its flicker."""
import json
import pathlib
import shutil

from harness import CliTest, png

IO, INVALID = 2, 3


class MaskedMetrics(CliTest):
    def setUp(self):
        super().setUp()
        self.scene, self.prepared = self.fixture("tiny.stgs"), self.fixture("prepared")
        capture = json.loads(pathlib.Path(self.prepared, "capture.json").read_text())
        self.frames = capture["frames"]
        self.camera = next(c for c in capture["cameras"] if c["test"])

    def write_masks(self, value_of, width=None):
        folder = pathlib.Path(self.path("masks"), self.camera["name"])
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        width, height = width or self.camera["width"], self.camera["height"]
        rows = b"".join(b"\0" + bytes(value_of(x, y) for x in range(width)) for y in range(height))
        image = png(width, height, rows, colours=0)
        for frame in range(self.frames):
            (folder / f"{frame:06}.png").write_bytes(image)
        return folder

    def evaluate(self, *options):
        return self.json_of("evaluate", self.scene, "--against", self.prepared, *options)

    def test_masks_select_pixels(self):
        pixels = self.camera["width"] * self.camera["height"] * self.frames
        self.write_masks(lambda x, y: 255)
        all_pixels = self.evaluate("--masks", "masks")
        self.assertEqual(all_pixels["masked_pixels"], pixels)
        self.assertAlmostEqual(all_pixels["psnr_masked"], all_pixels["psnr_pooled"], 4)
        self.assertEqual(all_pixels["views"][0]["masked_pixels"], pixels)
        self.write_masks(lambda x, y: 128 if x < 10 else 127)
        part = self.evaluate("--masks", "masks")
        self.assertEqual(part["masked_pixels"], 10 * self.camera["height"] * self.frames)
        self.assertNotAlmostEqual(part["psnr_masked"], all_pixels["psnr_masked"], 3)
        self.write_masks(lambda x, y: 0)
        self.assertIsNone(self.evaluate("--masks", "masks")["psnr_masked"])
        self.assertNotIn("psnr_masked", self.evaluate())

    def test_bad_masks(self):
        folder = self.write_masks(lambda x, y: 255, width=7)
        evaluate = ("evaluate", self.scene, "--against", self.prepared, "--masks", "masks")
        self.fails(INVALID, "the mask has another size than the frame", *evaluate)
        (folder / "000000.png").unlink()
        self.fails(IO, "000000.png", *evaluate)

    def test_flicker_needs_five_frames(self):
        self.assertGreaterEqual(self.frames, 5)
        flicker = self.evaluate()["flicker"]
        self.assertGreaterEqual(flicker["render"], 0)
        self.assertGreaterEqual(flicker["ground_truth"], 0)
        self.assertIsNone(self.evaluate("--every", str(self.frames - 1))["flicker"])
