#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A scene among the objects of three.js. See package_case.py for the usage."""
from engine_case import EngineCase
from package_case import run


class Three(EngineCase):
    PAGE = "three_page.html"
    FILES = EngineCase.FILES + ["three_page.js"]
    MODULES = {"three.module.js": "three/build/three.module.js",
               "three.core.js": "three/build/three.core.js",
               "iwer.js": "iwer/build/iwer.module.js"}

    def test_it_shows_the_image_of_the_player(self):
        for parameters in ({}, {"antialias": True}):
            value = self.check("compareAlone", parameters)
            print(f"{parameters}: {value:.1f} dB", flush=True)
            self.assertGreater(value, 40, parameters)

    def test_objects_hide_splats_and_are_covered(self):
        for parameters in ({}, {"logarithmicDepthBuffer": True}, {"reversedDepthBuffer": True}):
            self.check_boxes(parameters)
            self.capture("three_box")

    def test_it_follows_its_transform(self):
        self.check_transform()

    def test_other_objects_are_not_affected(self):
        self.check_state()

    def test_linear_targets(self):
        alone, linear, differ = self.check("compareLinear()")
        print(f"mean of 255: {alone:.1f} in sRGB, {linear:.1f} by a linear target", flush=True)
        self.assertLess(abs(alone - linear), 12)  # it blends linear values
        self.assertTrue(differ)

    def test_dispose_frees_everything(self):
        before, during, after = self.check("countDisposed()")
        self.assertGreater(during["Texture"], before["Texture"])
        for kind in ("Texture", "Buffer", "VertexArray"):
            self.assertLessEqual(after[kind], before[kind] + (kind != "Texture"), (kind, after))

    def test_a_restored_context_shows_the_scene(self):
        self.assertGreater(self.check("compareRestored()"), 40)
        self.browser.problems.clear()  # three.js logs that the context was lost

    def test_it_plays_and_reports_changes(self):
        values = self.check("playSome()")
        self.assertGreater(values["changes"], 3)
        self.assertEqual(values["idle"], 0)
        self.assertGreater(values["time"], 0.2)
        report = values["report"]
        self.assertEqual([report[name] for name in ("quality", "device", "maxPrimitives", "resolutionScale")],
                         ["medium", "headset", 1_000_000, 1])

    def test_both_eyes_of_a_headset(self):
        values = self.check("compareEyes()")
        print("eyes:", [f"{value:.1f} dB" for value in values], flush=True)
        self.assertGreater(min(values), 40)

    def test_errors(self):
        renderer, camera = self.check("messages()")
        self.assertIn("needs a WebGLRenderer or a WebGPURenderer", renderer)
        self.assertIn("perspective camera", camera)


if __name__ == "__main__":
    run(Three)
