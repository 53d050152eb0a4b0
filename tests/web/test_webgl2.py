#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The WebGL2 renderer draws what `stgs render --backend cpu` renders, in headless Chromium.

usage: test_webgl2.py STGS PACK_SCENE MAKE_WEB_SCENE SOURCES [FOLDER]
SOURCES: the TypeScript, with the generated shaders
FOLDER: where the images are kept. Exit code 77: a required program is missing
"""
import array
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, HERE)
from exr_image import read_exr  # noqa: E402
from page_server import PageServer  # noqa: E402

TARGETS = {"rgba16f": 55.0, "rgba8": 45.0}  # least PSNR, dB
SCENES = {"degree0": (1500, 0), "degree1": (1500, 1), "degree2": (1500, 2), "degree3": (3000, 3),
          # More than a layer of the atlas.
          "large": (48000, 3)}
TIMES = [20.0, 47.5]  # ticks of 1/30 s
STGS = PACK = MAKE = SOURCES = CHROMIUM = FOLDER = ""


def camera(width, height, focal, angle, position):
    """A camera at `position`, turned around the y axis."""
    c, s = math.cos(angle), math.sin(angle)
    rotation = [c, 0, -s, 0, 1, 0, s, 0, c]
    x, y, z = position
    translation = [-(c * x - s * z), -y, -(s * x + c * z)]
    return {"rotation": rotation, "translation": translation, "fx": focal, "fy": focal * 1.02,
            "cx": width / 2 + 3.5, "cy": height / 2 - 2, "width": width, "height": height}


CAMERAS = {"front": camera(320, 240, 280, 0, (0, 0, 0)),
           "inside": camera(301, 199, 170, 0.6, (-1.2, 0.3, 3.4))}


def psnr(a, b):
    square = sum((x - y) ** 2 for x, y in zip(a, b)) / len(a)
    return 200.0 if square == 0 else -10 * math.log10(square)


class WebGl2Test(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.work = FOLDER or tempfile.mkdtemp(prefix="stgs-webgl2-")
        os.makedirs(cls.work, exist_ok=True)
        if not FOLDER:
            cls.addClassCleanup(shutil.rmtree, cls.work, True)
        cls.build()
        job = {"scenes": []}
        cls.cases = {}  # name: (scene, camera, ticks, target)
        for scene, (primitives, degree) in SCENES.items():
            cls.make_scene(scene, primitives, degree)
            for target in TARGETS:
                job["scenes"].append(cls.scene_job(scene, target))
        with open(os.path.join(cls.work, "job.json"), "w", encoding="ascii") as file:
            json.dump(job, file)
        server = PageServer(cls.work)
        cls.addClassCleanup(server.close)
        cls.posts = server.run(CHROMIUM, "webgl2_page.html", 400)
        cls.references = {}
        for name, data in cls.posts.items() if FOLDER else ():
            with open(os.path.join(cls.work, name), "wb") as file:
                file.write(data)

    @classmethod
    def build(cls):
        for entry, out, form in (("index", "renderer", "esm"),
                                 ("sorter_worker", "sorter_worker", "iife")):
            subprocess.run(["esbuild", os.path.join(SOURCES, "webgl2", f"{entry}.ts"),
                            "--bundle", f"--format={form}", "--target=es2020",
                            "--log-level=warning", f"--outfile={cls.work}/{out}.js"], check=True)
        for page in ("webgl2_page.html", "webgl2_page.mjs"):
            shutil.copy(os.path.join(HERE, page), cls.work)

    @classmethod
    def make_scene(cls, scene, primitives, degree):
        path = os.path.join(cls.work, scene)
        subprocess.run([MAKE, f"{path}.stgs", str(primitives), str(degree)], check=True)
        subprocess.run([PACK, f"{path}.stgs", path], check=True)

    @classmethod
    def scene_job(cls, scene, target):
        with open(os.path.join(cls.work, f"{scene}.json"), encoding="ascii") as file:
            near = json.load(file)["near"]
        cases = []
        for name, one in CAMERAS.items():
            for ticks in TIMES:
                case = f"{scene}.{name}.{ticks}.{target}"
                cls.cases[case] = (scene, name, ticks, target)
                cases.append({"name": case, "camera": {**one, "near": near}, "ticks": ticks})
        return {"scene": scene, "target": target, "cases": cases}

    def reference(self, scene, name, ticks):
        """Returns the planes R, G, B and A of `stgs render`."""
        key = f"{scene}.{name}.{ticks}"
        if key not in self.references:
            path = os.path.join(self.work, key)
            with open(f"{path}.camera.json", "w", encoding="ascii") as file:
                json.dump(CAMERAS[name], file)
            subprocess.run([STGS, "render", os.path.join(self.work, f"{scene}.stgs"), "--camera",
                            f"{path}.camera.json", "--time", repr(ticks / 30), "--background",
                            "0,0,0", "--backend", "cpu", "--log-level", "error", "-o",
                            f"{path}.exr"], check=True)
            width, height, planes = read_exr(f"{path}.exr")
            self.assertEqual((width, height), (CAMERAS[name]["width"], CAMERAS[name]["height"]))
            self.references[key] = [planes[c] for c in "RGBA"]
        return self.references[key]

    def image(self, name):
        """Returns the planes of an image that the page posted."""
        pixels = array.array("f", self.posts[f"{name}.f32"])
        return [pixels[c::4] for c in range(4)]

    def compare(self, name, scene, camera_name, ticks):
        """Returns the PSNR of the colours and of alpha."""
        image = self.image(name)
        reference = self.reference(scene, camera_name, ticks)
        colour = [psnr(image[c], reference[c]) for c in range(3)]
        mean = -10 * math.log10(sum(10 ** (-p / 10) for p in colour) / 3)
        return mean, psnr(image[3], reference[3])

    def test_page_reports_no_error(self):
        self.assertEqual(self.posts["done"], b"ok")
        self.assertNotIn("error", self.posts)

    def test_images_equal_those_of_the_native_renderer(self):
        for name, (scene, camera_name, ticks, target) in self.cases.items():
            with self.subTest(name):
                colour, alpha = self.compare(name, scene, camera_name, ticks)
                print(f"{name}: {colour:.1f} dB, alpha {alpha:.1f} dB, "
                      f"{self.posts[name + '.json'].decode()}", flush=True)
                self.assertGreater(max(self.image(name)[3]), 0.5)
                self.assertGreaterEqual(colour, TARGETS[target])
                self.assertGreaterEqual(alpha, TARGETS[target])

    def test_the_canvas_shows_the_image_over_the_background(self):
        self.assertLess(json.loads(self.posts["background.json"]), 1.1)

    def check_variant(self, variant):
        name = next(iter(self.cases))
        scene, camera_name, ticks, target = self.cases[name]
        colour, _ = self.compare(f"{name}.{variant}", scene, camera_name, ticks)
        print(f"{name}.{variant}: {colour:.1f} dB", flush=True)
        self.assertGreaterEqual(colour, TARGETS[target])

    def test_replaced_and_removed_segments(self):
        self.check_variant("replaced")
        name = f"{next(iter(self.cases))}.empty"
        self.assertEqual(max(max(plane) for plane in self.image(name)), 0)

    def test_a_caller_that_pauses_gets_the_right_order(self):
        self.check_variant("rendered")

    def test_late_times_are_exact(self):
        self.check_variant("shifted")

    def test_errors(self):
        errors = json.loads(self.posts["errors.json"])
        self.assertRegex(errors["segment"], r"^segment 0: \d+ bytes of words \(expected \d+ for")
        self.assertRegex(errors["worker"], "^the sorter missing.js failed")
        self.assertEqual(errors["reported"], errors["worker"])
        self.assertEqual(errors["destroyed"], "the renderer was destroyed")

    def test_a_restored_context_shows_all_segments(self):
        self.check_variant("restored")


def main():
    global STGS, PACK, MAKE, SOURCES, CHROMIUM, FOLDER
    if len(sys.argv) not in (5, 6):
        sys.exit(__doc__)
    STGS, PACK, MAKE, SOURCES = map(os.path.abspath, sys.argv[1:5])
    FOLDER = os.path.abspath(sys.argv[5]) if len(sys.argv) == 6 else ""
    CHROMIUM = shutil.which("chromium")
    if CHROMIUM is None or shutil.which("esbuild") is None:
        print("chromium or esbuild is missing", file=sys.stderr)
        sys.exit(77)
    unittest.main(argv=sys.argv[:1])


if __name__ == "__main__":
    main()
