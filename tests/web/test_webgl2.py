#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The WebGL2 renderer draws what `stgs render --backend cpu` renders, in headless Chromium.

usage: test_webgl2.py STGS PACK_SCENE MAKE_WEB_SCENE SOURCES [FOLDER] [--every-degree]
SOURCES: the TypeScript, with the generated shaders
FOLDER: where the images are kept. --every-degree: with the scenes of degrees 0 to 2. Exit code 77: a required program is missing
"""
import json
import os
import shutil
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from renderer_case import RendererCase  # noqa: E402

TARGETS = {"rgba16f": 55.0, "rgba8": 45.0}  # least PSNR, dB
# Name: primitives, SH degree.
SCENES = {"degree3": (3000, 3), "thin": (20000, 0),
          # More than a layer of the atlas.
          "large": (48000, 3)}
# Files, and constants in place of others: parts of 512 primitives in two rows.
PARTS = [("records.ts", "kRecordRow = 4096", "kRecordRow = 256"), ("records.ts", "kMaxRows = 256", "kMaxRows = 2"),
         ("shaders.ts", "kRecordRow = 4096u", "kRecordRow = 256u")]
LOWER_DEGREES = {"degree0": (1500, 0), "degree1": (1500, 1), "degree2": (1500, 2)}


class WebGl2Test(RendererCase):
    @classmethod
    def setUpClass(cls):
        cls.make_folder()
        cls.bundle("webgl2/index", "renderer")
        cls.bundle_parts()
        cls.bundle("webgl2/sorter_worker", "stgs-sorter", "iife")
        cls.copy_pages("webgl2_page.html", "webgl2_page.mjs", "scene_page.mjs")
        job = {"scenes": []}
        scenes = {**SCENES, **LOWER_DEGREES} if cls.every_degree else SCENES
        for scene, (primitives, degree) in scenes.items():
            cls.make_scene(scene, primitives, degree, options=["--thin"] if scene == "thin" else [])
            # The target makes no difference to the other scenes.
            for target in TARGETS if scene == "degree3" or cls.every_degree else ["rgba16f"]:
                job["scenes"].append(cls.scene_job(scene, target))
        cls.run_page("webgl2_page.html", job)

    @classmethod
    def bundle_parts(cls):
        """Bundles a renderer with short rows and parts, which in a scene of this size are many."""
        sources, cls.sources = cls.sources, os.path.join(cls.work, "parts")
        shutil.copytree(sources, cls.sources)
        for name, old, new in PARTS:
            path = os.path.join(cls.sources, "webgl2", name)
            with open(path, encoding="utf-8") as file:
                text = file.read()
            assert old in text, f"{path} has no {old}"
            with open(path, "w", encoding="utf-8") as file:
                file.write(text.replace(old, new))
        cls.bundle("webgl2/index", "renderer_parts")
        cls.sources = sources

    def test_page_reports_no_error(self):
        self.assertEqual(self.posts["done"], b"ok")
        self.assertNotIn("error", self.posts)

    def test_images_equal_those_of_the_native_renderer(self):
        self.check_images(TARGETS)

    def test_the_canvas_shows_the_image_over_the_background(self):
        self.assertLess(json.loads(self.posts["background.json"]), 1.1)

    def test_replaced_and_removed_segments(self):
        self.check_variant("replaced", TARGETS)
        self.check_empty("empty")

    def test_a_caller_that_pauses_gets_the_right_order(self):
        self.check_variant("rendered", TARGETS)

    def test_an_order_is_drawn_in_parts(self):
        name = next(iter(self.cases))
        self.assertEqual(self.posts[f"{name}.parts.f32"], self.posts[f"{name}.f32"])

    def test_depth_equals_that_of_the_native_renderer(self):
        name = list(self.cases)[2]
        for suffix, median, most in (("depth32", 2e-5, 5e-3), ("depth16", 2e-3, 1e-2)):
            self.check_depth(name, suffix, median, most)
            self.assertEqual(self.posts[f"{name}.{suffix}.f32"], self.posts[f"{name}.f32"])

    def test_late_times_are_exact(self):
        self.check_variant("shifted", TARGETS)

    def test_errors(self):
        errors = json.loads(self.posts["errors.json"])
        self.assertRegex(errors["segment"], r"^segment 0: \d+ bytes of words \(expected \d+ for")
        self.assertRegex(errors["worker"], "^the sorter missing.js failed")
        self.assertEqual(errors["reported"], errors["worker"])
        self.assertEqual(errors["destroyed"], "the renderer was destroyed")
        self.assertRegex(errors["memory"], "^the GPU has no memory for the splats of a frame; lower")
        self.assertEqual(errors["reportedMemory"], errors["memory"])
        self.assertRegex(errors["depth"], "created without the option depth$")
        self.assertRegex(errors["texture"], "^the depth texture of a view cannot be drawn to")
        self.assertRegex(errors["extension"], "^depth needs EXT_color_buffer_float")
        self.assertIn("framebuffer", errors["restored"])
        self.assertEqual(errors["format"], "rgba8")

    def test_a_restored_context_shows_all_segments(self):
        self.check_variant("restored", TARGETS)


if __name__ == "__main__":
    RendererCase.set_tools(__doc__)
    unittest.main(argv=sys.argv[:1])
