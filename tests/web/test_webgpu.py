#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The WebGPU renderer draws the images of `stgs render --backend cpu`, in headless Chromium.

usage: test_webgpu.py STGS PACK_SCENE MAKE_WEB_SCENE SOURCES [FOLDER] [--every-degree]
SOURCES: the TypeScript, with the generated shaders
FOLDER: where the images are kept. --every-degree: with the scenes of degrees 0 to 2. Exit code 77: a required program or a WebGPU adapter is missing
"""
import array
import json
import os
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from page_server import WEBGPU_FLAGS  # noqa: E402
from renderer_case import RendererCase  # noqa: E402

TARGETS = {"rgba16f": 60.0}  # least PSNR, dB
BOTH = ("front", "inside")
# Name: primitives, SH degree, near plane, cameras.
SCENES = {"degree3": (3000, 3, 0.1, BOTH), "near": (1500, 0, 4.0, ("front",)),
          "thin": (20000, 0, 0.1, ("inside",)),
          # More keys than 16 bits can count, and several buffers.
          "large": (110000, 3, 0.1, ("small",))}
LOWER_DEGREES = {"degree0": (1500, 0, 0.1, BOTH), "degree1": (1500, 1, 0.1, BOTH),
                 "degree2": (1500, 2, 0.1, BOTH)}


class WebGpuTest(RendererCase):
    @classmethod
    def setUpClass(cls):
        cls.make_folder()
        cls.bundle("webgpu/index", "renderer")
        cls.bundle("webgpu/radix_sort", "radix_sort")
        cls.copy_pages("webgpu_page.html", "webgpu_page.mjs", "webgpu_sort.mjs",
                       "webgpu_views.mjs", "scene_page.mjs")
        job = {"scenes": []}
        scenes = {**SCENES, **LOWER_DEGREES} if cls.every_degree else SCENES
        for scene, (primitives, degree, near, cameras) in scenes.items():
            cls.make_scene(scene, primitives, degree, near, ["--thin"] if scene == "thin" else [])
            job["scenes"].append(cls.scene_job(scene, "rgba16f", cameras))
        cls.run_page("webgpu_page.html", job, WEBGPU_FLAGS)
        if cls.posts["done"] == b"no adapter":
            print("skipped: this Chromium has no WebGPU adapter")
            cls.doClassCleanups()
            sys.exit(77)

    def test_page_reports_no_error(self):
        self.assertEqual(self.posts["done"], b"ok")
        self.assertNotIn("error", self.posts)

    def test_the_sort_equals_one_on_the_cpu(self):
        results = json.loads(self.posts["sort.json"])
        print(f"sort: {results}")
        for kind in {"portable", results["chosen"]}:
            self.assertEqual(results[kind]["wrong"], [])
            self.assertGreater(results[kind]["cases"], 50)
        self.assertEqual(results["chosen"], "subgroups" if results["hasOneSize"] else "portable")

    def test_a_sort_that_the_device_cannot_run(self):
        results = json.loads(self.posts["sort.json"])
        self.assertEqual(results["varying"], "portable")
        self.assertRegex(results["refused"], 'or choose the sort "portable"$')

    def test_images_equal_those_of_the_native_renderer(self):
        self.check_images(TARGETS)

    def test_the_canvas_shows_the_image_over_the_background(self):
        self.assertLess(json.loads(self.posts["background.json"]), 1.1)

    def test_segments_that_come_and_go(self):
        self.check_variant("churn", TARGETS)
        self.check_empty("empty")

    def test_views_without_splats(self):
        self.check_empty("behind")
        self.check_empty("late")

    def test_other_sizes_of_the_image(self):
        self.check_variant("resized", TARGETS)

    def test_late_times_are_exact(self):
        self.check_variant("shifted", TARGETS)

    def test_a_near_plane_of_zero(self):
        self.check_variant("near0", TARGETS)  # the scene has nothing between 0 and its near plane

    def test_small_buffers(self):
        self.check_variant("pages", TARGETS)
        self.check_variant("again", TARGETS)  # after a frame that was too large
        limits = json.loads(self.posts["limits.json"])
        self.assertGreater(limits["pages"], 1)
        self.assertRegex(limits["segment"], r"^a segment of 20480000 bytes is larger than a buffer")
        self.assertRegex(limits["frame"], r"^the splats of a frame need \d+ bytes, but buffers of this")

    def test_depth_equals_that_of_the_native_renderer(self):
        for index in (0, 2):
            name = list(self.cases)[index]
            for suffix, median, most in (("depth32", 1e-5, 5e-3), ("depth16", 2e-3, 1e-2)):
                self.check_depth(name, suffix, median, most)
            if index == 0:
                self.check_variant("withdepth", TARGETS)

    def test_objects_hide_the_splats_behind_them(self):
        differences = json.loads(self.posts["views.json"])["occlusion"]
        print(f"occlusion: {differences}")
        self.assertGreater(differences.pop("none"), 0.1)
        self.assertEqual(max(differences.values()), 0)

    def test_an_image_is_blended_over_that_of_an_application(self):
        self.assertEqual(json.loads(self.posts["views.json"])["overlay"], 0)

    def test_several_views_equal_single_ones(self):
        self.assertEqual(set(json.loads(self.posts["views.json"])["views"].values()), {0})

    def test_outputs(self):
        outputs = json.loads(self.posts["views.json"])["outputs"]
        print(f"outputs: {outputs}")
        self.assertEqual(outputs["linear"], 0)
        self.assertEqual(outputs["content"], 0)
        self.assertEqual(outputs["within"], 0)
        self.assertLess(outputs["samples"], 4 * 320 * 240 / 1000)  # at the edges of splats

    def test_errors_of_views(self):
        errors = json.loads(self.posts["views.json"])["errors"]
        self.assertEqual(errors["creation"], "5 views (expected 1 to 4)")
        self.assertEqual(errors["views"], "2 views, but the renderer was created for 1")
        self.assertRegex(errors["depth"], "created without the option depth$")
        self.assertRegex(errors["occluders"], "^either all views or none have occluders")
        self.assertEqual(errors["size"], "an image of 320.5x0 pixels (expected whole numbers above 0)")
        self.assertEqual(errors["samples"], "the option depth needs textures with 1 sample per pixel")
        self.assertRegex(errors["content"], "^views have a content if colours are linear")
        self.assertEqual(errors["limits"], 1)

    def test_depths_beyond_the_range_of_half_floats(self):
        far = json.loads(self.posts["views.json"])["far"]
        print(f"far: {far}")
        self.assertGreater(far["pixels"], 1000)
        for depth in (far["least"], far["greatest"]):
            self.assertLess(abs(float(depth) / 65504 - 1), 1e-2)

    def test_errors(self):
        errors = json.loads(self.posts["errors.json"])
        self.assertRegex(errors["words"], r"^segment 0: \d+ bytes of words \(expected \d+ for")
        self.assertRegex(errors["near"], "^the near plane is at -1 scene units")
        self.assertRegex(errors["size"], "^an image of 1000000x240 pixels is larger")
        self.assertEqual(errors["destroyed"], "the renderer was destroyed")
        self.assertEqual(errors["rendered"], errors["destroyed"])
        self.assertRegex(errors["memory"], "^the GPU has no memory for the scene")
        self.assertEqual(errors["afterMemory"], errors["memory"])
        self.assertRegex(errors["lost"], "^the GPU device was lost")
        self.assertEqual(errors["afterLost"], errors["lost"])
        self.assertEqual(errors["draw"], errors["lost"])
        self.assertEqual(errors["aborted"], "the creation of the renderer was aborted")
        self.assertRegex(errors["canvas"], "^the canvas has a context of another kind")

    def test_statistics(self):
        statistics = json.loads(self.posts["statistics.json"])
        self.assertGreater(statistics["primitives"], statistics["visible"])
        self.assertGreater(statistics["visible"], 300)
        self.assertGreaterEqual(statistics["computeMs"], statistics["sortMs"])
        self.assertGreater(statistics["rasterMs"], 0)


if __name__ == "__main__":
    RendererCase.set_tools(__doc__)
    unittest.main(argv=sys.argv[:1])
