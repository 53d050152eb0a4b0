#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The package plays files from nginx in headless Chromium.

usage: test_page.py STGS MAKE_WEB_SCENE PACKAGE
PACKAGE: the folder of stgs.js. Exit code 77: Chromium, playwright-core or nginx is missing
"""
import array
import base64
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
import wave

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, "..", "fetch")]
from browser import Server, require  # noqa: E402
from exr_image import read_exr  # noqa: E402
from package_case import serve  # noqa: E402
from page_server import WEBGPU_FLAGS  # noqa: E402

CAMERA = {"rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [0, 0, 0], "fx": 220, "fy": 220,
          "cx": 120, "cy": 90, "width": 240, "height": 180}
TARGETS = {"rgba16f": 55.0, "rgba8": 45.0, "webgpu": 60.0, "device": 60.0}  # least PSNR, dB
STGS = MAKE = PACKAGE = ""


def psnr(a, b):
    square = sum((x - y) ** 2 for x, y in zip(a, b)) / len(a)
    return 200.0 if square == 0 else -10 * math.log10(square)


class PageCase(unittest.TestCase):
    flags = ()  # of Chromium

    @classmethod
    def setUpClass(cls):
        cls.work = tempfile.mkdtemp(prefix="stgs-page-")
        cls.addClassCleanup(shutil.rmtree, cls.work, True)
        for name in os.listdir(PACKAGE):
            if name.startswith("stgs"):
                shutil.copy(os.path.join(PACKAGE, name), cls.work)
        for name in ("player_page.html", "decode_scene.js"):
            shutil.copy(os.path.join(HERE, name), cls.work)
        cls.scene = os.path.join(cls.work, "scene.stgs")
        subprocess.run([MAKE, cls.scene, "3000", "3"], check=True)
        with open(cls.scene, "rb") as file:
            data = file.read()
        cls.write("cut.stgs", data[:len(data) // 2])
        cls.write("head.stgs", data[:60])
        cls.write("text.stgs", b"no scene\n" * 100)
        cls.write("video.mp4", bytes(4 << 20))
        cls.url, cls.browser = serve(cls, cls.work, cls.flags)

    @classmethod
    def write(cls, name, data):
        with open(os.path.join(cls.work, name), "wb") as file:
            file.write(data)

    def setUp(self):
        self.browser.problems.clear()
        self.browser.resize(480, 270)
        self.browser.open(self.url + "player_page.html")
        self.check = self.browser.evaluate
        self.wait = self.browser.wait_for
        self.wait("'show' in window")

    def show(self, **attributes):
        self.check(f"show({json.dumps(attributes)})")

    def error(self, source):
        """Returns the code and the message of the error of a source."""
        self.show(src=source)
        self.wait("player.error")
        return self.check("[player.error.code, player.error.message]")

    def reference(self, seconds):
        path = os.path.join(self.work, "camera.json")
        with open(path, "w", encoding="ascii") as file:
            json.dump(CAMERA, file)
        image = os.path.join(self.work, f"{seconds}.exr")
        subprocess.run([STGS, "render", self.scene, "--camera", path, "--time", repr(seconds), "--background",
                        "0,0,0", "--backend", "cpu", "--log-level", "error", "-o", image], check=True)
        return read_exr(image)[2]

    def check_pixels(self, *targets):
        """The decoded scene is drawn as the native renderer draws it."""
        for seconds, target in zip((0.5, 1.5), targets):
            with self.subTest(seconds=seconds, target=target):
                planes = self.reference(seconds)
                text = self.check(f"pixels('scene.stgs', {json.dumps(CAMERA)}, {seconds}, '{target}')")
                pixels = array.array("f", base64.b64decode(text))
                square = sum(10 ** (-psnr(pixels[c::4], planes["RGB"[c]]) / 10) for c in range(3)) / 3
                self.assertGreater(-10 * math.log10(max(square, 1e-20)), TARGETS[target])
        self.assertEqual(self.browser.problems, [])

    def check_screenshot(self):
        """A screenshot shows the scene."""
        values = self.check("""player.screenshot().then((blob) => createImageBitmap(blob)).then((image) => {
            const canvas = new OffscreenCanvas(image.width, image.height), context = canvas.getContext("2d");
            context.drawImage(image, 0, 0);
            return new Set(context.getImageData(0, 0, image.width, image.height).data).size; })""")
        self.assertGreater(values, 50)

    def check_removal(self, *times):
        """An element can be removed at any time, milliseconds after its creation."""
        for milliseconds in times:
            self.show(src="scene.stgs", autoplay="")
            self.check(f"new Promise((resolve) => setTimeout(resolve, {milliseconds}))")
            self.check("player.remove()")
        self.show(src="scene.stgs")
        self.wait("player.readyState >= 3")
        self.assertEqual(self.browser.problems, [])


class Page(PageCase):
    def test_decoded_segments_are_drawn_as_the_native_renderer_does(self):
        self.check_pixels("rgba16f", "rgba8")

    def test_without_an_adapter_for_webgpu(self):
        self.show(src="scene.stgs")
        self.wait("player.readyState >= 3 && player.activeRenderer !== null")
        self.assertEqual(self.check("player.activeRenderer"), "webgl2")
        self.show(src="scene.stgs", renderer="webgpu")
        self.wait("player.error")
        self.assertEqual(self.check("player.error.message"),
                         "rendering failed: WebGPU is not available: this browser has no adapter for it")
        message = self.check("""(() => { try {
            stgs.createPlayer(document.createElement("canvas"), { renderer: "canvas" });
        } catch (error) { return error.message; } })()""")
        self.assertEqual(message, 'there is no renderer "canvas" (expected auto, webgpu or webgl2)')

    def test_an_element_plays_seeks_and_loops(self):
        self.show(src="scene.stgs", controls="", loop="")
        self.wait("player.readyState >= 3 || player.error")
        self.assertIsNone(self.check("player.error"))
        self.assertAlmostEqual(self.check("player.duration"), 2.0)
        self.assertTrue(self.check("player.paused && player.currentTime === 0"))
        self.check("player.play()")
        self.wait("player.currentTime > 0.3")
        self.check("player.currentTime = 1.8")
        self.wait("player.currentTime < 1.5 && player.currentTime > 0.2")  # after the end
        self.check("player.pause()")
        self.check("player.currentTime = 1")
        self.wait("!player.seeking")
        self.assertEqual(self.check("player.currentTime"), 1)
        events = self.check("events")
        self.assertEqual(events[:2], ["loadedmetadata", "canplay"])
        self.assertNotIn("error", events)
        self.assertEqual(self.browser.problems, [])

    def test_a_screenshot_shows_the_scene(self):
        self.show(src="scene.stgs")
        self.wait("player.readyState >= 3")
        self.check_screenshot()

    def test_a_chosen_file_plays(self):
        self.show()
        self.check("""fetch("scene.stgs").then((r) => r.blob()).then((blob) => player.load(new File([blob], "a.stgs")))""")
        self.wait("player.readyState >= 3")
        self.assertAlmostEqual(self.check("player.duration"), 2.0)

    def test_sound_plays_with_the_scene(self):
        with wave.open(os.path.join(self.work, "sound.wav"), "wb") as file:
            file.setparams((1, 1, 8000, 0, "NONE", ""))
            file.writeframes(bytes(128 + round(40 * math.sin(k / 3)) for k in range(8000 * 3)))
        scene = os.path.join(self.work, "sound.stgs")
        subprocess.run([MAKE, scene, "3000", "3", "0.1", "sound.wav"], check=True)
        self.check("{ const Original = Audio; window.Audio = function () { return window.sound = new Original(); } }")
        self.show(src="sound.stgs", controls="", muted="", loop="")
        self.wait("player.hasAudio")
        self.assertEqual(self.check("[sound.src, sound.muted, player.muted]"), [self.url + "sound.wav", True, True])
        self.check("player.play()")
        together = "Math.abs(sound.currentTime - player.currentTime) < 0.2"
        self.wait(f"player.currentTime > 0.2 && {together}")
        self.check("player.currentTime = 1.7")
        self.wait(f"player.currentTime > 0.2 && player.currentTime < 1.5 && {together}")  # it has looped
        self.check("player.shadowRoot.querySelector('.mute').click()")
        self.assertEqual(self.check("[sound.muted, player.muted]"), [False, False])
        self.check("player.pause()")
        self.wait("sound.paused")
        self.check("player.audio = 'none'")
        self.wait("!player.hasAudio && player.shadowRoot.querySelector('.mute').hidden")
        self.assertEqual(self.browser.problems, [])

    def test_errors_state_the_cause(self):
        code, message = self.error("missing.stgs")
        self.assertEqual(code, 2)  # MEDIA_ERR_NETWORK
        self.assertIn("missing.stgs: the server has no such file (status 404)", message)
        for name, text in (("text.stgs", "not an .stgs file; this is a text file"), ("head.stgs", "")):
            code, message = self.error(name)
            self.assertEqual(code, 4, message)  # MEDIA_ERR_SRC_NOT_SUPPORTED
            self.assertIn(name, message)
            self.assertIn(text, message)

    def test_a_large_file_of_another_kind_is_not_read_completely(self):
        code, message = self.error("video.mp4")
        self.assertEqual(code, 4)
        self.assertIn("video.mp4: not an .stgs file; choose another one", message)

    def test_options_are_checked(self):
        for options in ("{memoryBudget: Infinity}", "{memoryBudget: 1000}", "{maxPrimitives: -1}", "{lookAhead: NaN}", "{lookAhead: -1}"):
            message = self.check(f"""(() => {{
                const player = stgs.createPlayer(document.createElement("canvas"), {options});
                return player.load("scene.stgs").then(() => "", (error) => error.message).finally(() => player.destroy());
            }})()""")
            self.assertIn("is out of range", message, options)

    def test_a_player_loads_one_file_after_another(self):
        durations = self.check("""(async () => {
            const player = stgs.createPlayer(document.createElement("canvas")), out = [];
            for (const name of ["scene.stgs", "text.stgs", "scene.stgs"]) {
              await player.load(name).catch(() => undefined);
              out.push(player.error ? player.error.code : player.duration);
            }
            player.destroy();
            return out;
        })()""")
        self.assertEqual(durations, [2, 4, 2])

    def test_a_cut_file_plays_as_far_as_it_is_there(self):
        self.show(src="cut.stgs")
        self.wait("player.readyState >= 1 || player.error")
        self.assertIsNone(self.check("player.error"))

    def test_a_server_without_ranges_is_named(self):
        server = Server(self.work)  # ignores them
        self.addCleanup(server.close)
        self.browser.open(server.url + "player_page.html")
        self.wait("'show' in window")
        code, message = self.error("scene.stgs")
        self.assertIn("does not support range requests", message)

    def test_an_element_can_be_removed_at_any_time(self):
        self.check_removal(0, 5, 60, 400)


class WebGpuPage(PageCase):
    flags = WEBGPU_FLAGS

    def setUp(self):
        super().setUp()
        if not self.check("navigator.gpu?.requestAdapter().then((adapter) => adapter !== null) ?? false"):
            self.skipTest("this Chromium has no WebGPU adapter")
        # Compiling the shaders for a CPU takes seconds on a busy machine.
        self.wait = lambda condition: self.browser.wait_for(condition, 60)

    def test_decoded_segments_are_drawn_as_the_native_renderer_does(self):
        self.check_pixels("webgpu", "device")

    def test_the_renderer_is_chosen(self):
        for choice, used in (("auto", "webgpu"), ("webgl2", "webgl2")):
            self.show(src="scene.stgs", renderer=choice)
            self.wait("player.readyState >= 3 && player.activeRenderer !== null")
            self.assertEqual(self.check("player.activeRenderer"), used)
            self.check_screenshot()

    def test_an_element_plays(self):
        self.show(src="scene.stgs", controls="", loop="", autoplay="", renderer="webgpu")
        self.wait("player.currentTime > 0.3 && player.stats.visible > 0")
        self.assertEqual(self.browser.problems, [])

    def test_an_element_can_be_removed_at_any_time(self):
        self.check_removal(0, 150, 1000)
        self.wait("player.activeRenderer === 'webgpu'")  # after its shaders are compiled

    def test_a_lost_device_is_replaced_by_another_and_then_by_webgl2(self):
        self.check("""{ const { requestDevice } = GPUAdapter.prototype;
            GPUAdapter.prototype.requestDevice = async function (...options) {
              return window.device = await requestDevice.apply(this, options);
            }; }""")
        self.show(src="scene.stgs", controls="")
        ready = "player.readyState >= 3 && player.activeRenderer !== null"
        self.wait(ready)
        self.check("player.currentTime = 1, 0")
        self.wait("!player.seeking")
        for renderer in ("webgpu", "webgl2"):
            self.check("events.length = 0, device.destroy()")
            self.wait(f"events.includes('canplay') && {ready} && !player.seeking")
            self.assertEqual(self.check("[player.activeRenderer, player.currentTime, player.error, player.paused]"),
                             [renderer, 1, None, True])
            self.check_screenshot()


def main():
    global STGS, MAKE, PACKAGE
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    STGS, MAKE, PACKAGE = map(os.path.abspath, sys.argv[1:])
    require("nginx")
    unittest.main(argv=sys.argv[:1])


if __name__ == "__main__":
    main()
