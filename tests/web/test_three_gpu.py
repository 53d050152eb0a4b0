#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A scene among the objects of three.js, drawn by WebGPURenderer. See package_case.py for the usage."""
import sys

from engine_case import EngineCase
from package_case import run
from page_server import WEBGPU_FLAGS


class ThreeGpu(EngineCase):
    PAGE = "three_gpu_page.html"
    FLAGS = WEBGPU_FLAGS
    FILES = EngineCase.FILES + ["three_gpu_page.js"]
    MODULES = {"three.webgpu.js": "three/build/three.webgpu.js",
               "three.tsl.js": "three/build/three.tsl.js",
               "three.core.js": "three/build/three.core.js"}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.browser.open(cls.url + cls.PAGE)
        cls.browser.wait_for("'ready' in window", 30)
        if not cls.browser.evaluate("hasAdapter()"):
            print("skipped: this Chromium has no WebGPU adapter")
            cls.doClassCleanups()
            sys.exit(77)

    def test_it_shows_the_image_of_the_player(self):
        for parameters in ({}, {"logarithmicDepthBuffer": True}, {"reversedDepthBuffer": True},
                           {"antialias": True}, {"stencil": True}, {"depth": False}):
            self.open(self.PAGE)  # three.js keeps reversed depths for other renderers of a page
            value = self.check("compareAlone", parameters)
            print(f"{parameters}: {value:.1f} dB", flush=True)
            self.assertGreater(value, 45, parameters)

    def test_objects_hide_splats_and_are_covered(self):
        for parameters in ({}, {"logarithmicDepthBuffer": True}, {"reversedDepthBuffer": True},
                           {"antialias": True, "stencil": True}):
            self.open(self.PAGE)
            self.check_boxes(parameters)
            self.capture("three_gpu_box")

    def test_it_follows_its_transform(self):
        self.check_transform()

    def test_other_objects_are_not_affected(self):
        is_same, draws = self.check("compareState()")
        self.assertTrue(is_same)
        self.assertEqual(draws, 0)

    def test_transparent_objects_in_front_are_blended_over_splats(self):
        values = self.check("compareTransparent()")
        print("transparent:", values, flush=True)
        self.assertGreater(values["before"][0], values["alone"][0] + 20)
        self.assertLess(values["before"][2], values["alone"][2])

    def test_viewports(self):
        for parameters in ({}, {"antialias": True}):
            values = self.check("compareViewports", parameters)
            self.capture("three_gpu_viewports")
            print("viewports:", [f"{value:.1f} dB" for value in values], flush=True)
            self.assertGreater(min(values), 40)

    def test_render_targets(self):
        values = self.check("compareTargets()")
        print("targets:", values, flush=True)
        self.assertGreater(values["pass"], 40)
        self.assertGreater(values["bytes"], 40)  # 8 bits of linear colours, encoded here
        self.assertGreater(values["canvas"], 45)

    def test_a_canvas_with_linear_colours(self):
        for parameters in ({}, {"antialias": True}):
            value = self.check("compareDirect", parameters)
            print(f"linear canvas, {parameters}: {value:.1f} dB", flush=True)
            self.assertGreater(value, 40)

    def test_a_transparent_canvas(self):
        self.assertGreater(self.check("compareClear()"), 40)

    def test_dispose_frees_everything(self):
        before, during, after = self.check("countDisposed()")
        print("objects:", before, during, after, flush=True)
        self.assertGreater(during["Texture"], before["Texture"])
        self.assertGreater(during["Buffer"], before["Buffer"])
        for kind in ("Texture", "Buffer", "QuerySet"):
            self.assertLessEqual(after[kind], before[kind], kind)

    def test_it_plays_and_reports_changes(self):
        values = self.check("playSome()")
        self.assertGreater(values["changes"], 3)
        self.assertEqual(values["idle"], 0)
        self.assertGreater(values["time"], 0.2)

    def test_without_webgpu(self):
        values = self.check("compareFallback()")
        print("WebGL 2:", values, flush=True)
        self.assertLess(values["difference"], 12)  # it blends linear values
        self.assertEqual(values["middle"], [255, 0, 0])

    def test_errors(self):
        messages = self.check("messages()")
        self.browser.problems.clear()  # three.js logs that frames were not finished
        self.assertIn("await renderer.init()", messages["uninitialized"])
        self.assertIn("logarithmicDepthBuffer", messages["logarithmic"])
        self.assertIn("perspective camera", messages["orthographic"])
        self.assertIn("BundleGroup", messages["bundle"])


if __name__ == "__main__":
    run(ThreeGpu)
