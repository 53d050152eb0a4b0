# SPDX-License-Identifier: Apache-2.0
"""The common part of the tests of the renderers: random scenes, cameras, images of `stgs render --backend cpu`,
and a page that posts its own."""
import array
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

from browser import require
from exr_image import read_exr
from page_server import PageServer

HERE = os.path.dirname(os.path.abspath(__file__))
TIMES = [20.0, 47.5]  # ticks of 1/30 s


def camera(width, height, focal, angle, position):
    """A camera at `position`, turned around the y axis."""
    c, s = math.cos(angle), math.sin(angle)
    rotation = [c, 0, -s, 0, 1, 0, s, 0, c]
    x, y, z = position
    translation = [-(c * x - s * z), -y, -(s * x + c * z)]
    return {"rotation": rotation, "translation": translation, "fx": focal, "fy": focal * 1.02,
            "cx": width / 2 + 3.5, "cy": height / 2 - 2, "width": width, "height": height}


CAMERAS = {"front": camera(320, 240, 280, 0, (0, 0, 0)),
           "inside": camera(301, 199, 170, 0.6, (-1.2, 0.3, 3.4)),
           "small": camera(97, 70, 84, 0, (0, 0, 0))}


def psnr(a, b):
    square = sum((x - y) ** 2 for x, y in zip(a, b)) / len(a)
    return 200.0 if square == 0 else -10 * math.log10(square)


class RendererCase(unittest.TestCase):
    """The base of a test of a renderer. set_tools() comes first."""
    stgs = pack = make = sources = folder = ""
    every_degree = False  # or degree 3 alone

    @classmethod
    def set_tools(cls, usage):
        """Reads the command line of a test."""
        if "--every-degree" in sys.argv:
            sys.argv.remove("--every-degree")
            cls.every_degree = True
        if len(sys.argv) not in (5, 6):
            sys.exit(usage)
        cls.stgs, cls.pack, cls.make, cls.sources = map(os.path.abspath, sys.argv[1:5])
        cls.folder = os.path.abspath(sys.argv[5]) if len(sys.argv) == 6 else ""
        require("esbuild")

    @classmethod
    def make_folder(cls):
        cls.work = cls.folder or tempfile.mkdtemp(prefix="stgs-renderer-")
        os.makedirs(cls.work, exist_ok=True)
        if not cls.folder:
            cls.addClassCleanup(shutil.rmtree, cls.work, True)
        cls.cases = {}  # name: (scene, camera, ticks, target)
        cls.references = {}

    @classmethod
    def bundle(cls, entry, out, form="esm"):
        subprocess.run(["esbuild", os.path.join(cls.sources, f"{entry}.ts"), "--bundle",
                        f"--format={form}", "--target=es2020", "--log-level=warning",
                        f"--outfile={cls.work}/{out}.js"], check=True)

    @classmethod
    def copy_pages(cls, *names):
        for name in names:
            shutil.copy(os.path.join(HERE, name), cls.work)

    @classmethod
    def make_scene(cls, scene, primitives, degree, near=0.1, options=()):
        path = os.path.join(cls.work, scene)
        subprocess.run([cls.make, *options, f"{path}.stgs", str(primitives), str(degree), str(near)], check=True)
        subprocess.run([cls.pack, f"{path}.stgs", path], check=True)

    @classmethod
    def scene_job(cls, scene, target, cameras=("front", "inside")):
        with open(os.path.join(cls.work, f"{scene}.json"), encoding="ascii") as file:
            near = json.load(file)["near"]
        cases = []
        for name in cameras:
            for ticks in TIMES:
                case = f"{scene}.{name}.{ticks}.{target}"
                cls.cases[case] = (scene, name, ticks, target)
                cases.append({"name": case, "camera": {**CAMERAS[name], "near": near}, "ticks": ticks})
        return {"scene": scene, "target": target, "cases": cases}

    @classmethod
    def run_page(cls, page, job, flags=()):
        """Runs a page with its job. Its posts are kept in the folder of the test, if one is named."""
        with open(os.path.join(cls.work, "job.json"), "w", encoding="ascii") as file:
            json.dump(job, file)
        server = PageServer(cls.work)
        cls.addClassCleanup(server.close)
        cls.posts = server.run(page, 500, flags)
        for name, data in cls.posts.items() if cls.folder else ():
            with open(os.path.join(cls.work, name), "wb") as file:
                file.write(data)

    def reference(self, scene, name, ticks):
        """Returns the planes R, G, B, A and Z of `stgs render`."""
        key = f"{scene}.{name}.{ticks}"
        if key not in self.references:
            path = os.path.join(self.work, key)
            with open(f"{path}.camera.json", "w", encoding="ascii") as file:
                json.dump(CAMERAS[name], file)
            subprocess.run([self.stgs, "render", os.path.join(self.work, f"{scene}.stgs"), "--camera",
                            f"{path}.camera.json", "--time", repr(ticks / 30), "--background",
                            "0,0,0", "--backend", "cpu", "--log-level", "error", "-o",
                            f"{path}.exr"], check=True)
            width, height, planes = read_exr(f"{path}.exr")
            self.assertEqual((width, height), (CAMERAS[name]["width"], CAMERAS[name]["height"]))
            self.references[key] = [planes[c] for c in "RGBAZ"]
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

    def check_images(self, targets):
        """All cases have the PSNR that `targets` states for their target, dB."""
        for name, (scene, camera_name, ticks, target) in self.cases.items():
            with self.subTest(name):
                colour, alpha = self.compare(name, scene, camera_name, ticks)
                print(f"{name}: {colour:.1f} dB, alpha {alpha:.1f} dB, "
                      f"{self.posts[name + '.json'].decode()}", flush=True)
                self.assertGreater(max(self.image(name)[3]), 0.5)
                self.assertGreaterEqual(colour, targets[target])
                self.assertGreaterEqual(alpha, targets[target])

    def check_variant(self, variant, targets, index=0):
        """The image of a case after something else happened is as good."""
        name = list(self.cases)[index]
        scene, camera_name, ticks, target = self.cases[name]
        colour, _ = self.compare(f"{name}.{variant}", scene, camera_name, ticks)
        print(f"{name}.{variant}: {colour:.1f} dB", flush=True)
        self.assertGreaterEqual(colour, targets[target])

    def check_empty(self, variant, index=0):
        """Nothing is drawn."""
        name = f"{list(self.cases)[index]}.{variant}"
        self.assertEqual(max(max(plane) for plane in self.image(name)), 0)

    def check_depth(self, name, suffix, median, most):
        """The depth of a case that the page posted as NAME.SUFFIX has these relative errors: the median of
        its pixels, and that of 99.9 % of them."""
        scene, camera_name, ticks, _ = self.cases[name]
        *_, alpha, z = self.reference(scene, camera_name, ticks)
        depth = array.array("f", self.posts[f"{name}.{suffix}"])
        # A splat whose alpha is at its threshold in a pixel may count there or not.
        errors = sorted(abs(d / r - 1) for d, r, a in zip(depth, z, alpha) if a > 0.05)
        figures = errors[len(errors) // 2], errors[int(0.999 * len(errors))], errors[-1]
        print(f"{name}.{suffix}: {figures}")
        self.assertGreater(len(errors), len(z) / 4)
        self.assertLess(figures[0], median)
        self.assertLess(figures[1], most)
        self.assertTrue(all(d == 0 for d, a in zip(depth, alpha) if a == 0))
