#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""<stgs-player> in Chromium: attributes, keys, pointers, touch, resizing and errors.

usage: test_element.py     with SCREENSHOTS=FOLDER in the environment, writes images of its states
"""
import os
import shutil
import subprocess
import tempfile
import time
import unittest

from browser import CHROMIUM, Browser, Server

TESTS = os.path.dirname(os.path.abspath(__file__))
SHIFT = 8
POSTER = ("data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' width='16' height='9'>"
          "<rect width='16' height='9' fill='%23345'/></svg>")


def bundle(folder):
    subprocess.run(["esbuild", os.path.join(TESTS, "element_page.mjs"), "--bundle",
                    "--format=iife", "--target=es2020", "--log-level=warning",
                    f"--outfile={folder}/element_page.js"], check=True)
    shutil.copy(os.path.join(TESTS, "element_page.html"), folder)


class ElementTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="stgs-element-")
        cls.addClassCleanup(cls.folder.cleanup)
        bundle(cls.folder.name)
        cls.server = Server(cls.folder.name)
        cls.addClassCleanup(cls.server.close)
        cls.browser = Browser()
        cls.addClassCleanup(cls.browser.close)

    def setUp(self):
        self.browser.problems.clear()
        self.browser.resize(1280, 720)
        self.browser.open(self.server.url + "element_page.html")
        self.check = self.browser.evaluate
        self.wait = self.browser.wait_for

    def tearDown(self):
        self.assertEqual(self.browser.problems, [])

    def show(self, **attributes):
        attributes.setdefault("src", "scene.stgs")
        self.check(f"show({attributes!r})")

    def show_ready(self, **attributes):
        self.show(**attributes)
        self.wait("player.readyState === 4 && parts.renderers[parts.renderers.length - 1].last")

    def capture(self, name):
        if folder := os.environ.get("SCREENSHOTS"):
            self.browser.screenshot(os.path.join(folder, name + ".png"))

    def centre(self, selector):
        return self.check(f"(() => {{ const r = part('{selector}').getBoundingClientRect();"
                          " return [r.x + r.width / 2, r.y + r.height / 2]; })()")

    def focus_view(self):
        self.check("part('.view').focus()")

    def posted(self, kind):
        return self.check("parts.workers[parts.workers.length - 1].posted"
                          f".filter((message) => message.type === '{kind}')")

    def camera(self):
        return self.check("parts.renderers[parts.renderers.length - 1].last.camera")

    # Attributes and lifetime

    def test_attributes_reflect_as_properties(self):
        self.show_ready(controls="", camera="fly", poster=POSTER, loop="")
        self.assertEqual(self.check("[player.controls, player.loop, player.autoplay, player.free]"),
                         [True, True, False, False])
        self.assertEqual(self.check("[player.camera, player.src, player.poster.slice(0, 9)]"),
                         ["fly", "scene.stgs", "data:imag"])
        self.check("player.loop = false; player.controls = false; player.camera = 'orbit';"
                   "player.free = true")
        names = self.check("player.getAttributeNames().sort().join()")
        self.assertEqual(names, "camera,free,poster,src")
        self.wait("parts.workers[0].loop === false")
        self.assertTrue(self.check("part('.bar').hidden"))
        self.check("player.setAttribute('camera', 'upside-down')")
        self.assertEqual(self.check("player.camera"), "orbit")

    def test_the_source_is_absolute_and_events_are_dispatched(self):
        self.show_ready()
        self.assertEqual(self.posted("open")[0]["source"], self.server.url + "scene.stgs")
        self.wait("events.includes('canplay')")
        self.assertEqual(self.check("events.join()"), "loadedmetadata,loadeddata,canplay")
        self.assertEqual(self.check("player.duration"), 12)

    def test_autoplay_and_loop(self):
        self.show(autoplay="", loop="")
        self.wait("player.currentTime > 0.3")
        self.assertEqual(self.posted("loop"), [{"type": "loop", "loop": True}])
        self.assertFalse(self.check("player.paused"))

    def test_poster_until_the_first_frame(self):
        self.show(controls="", poster=POSTER, src="slow.stgs")
        self.wait("part('.poster').complete && !part('.spinner').hidden")
        self.assertEqual(self.check("getComputedStyle(part('.poster')).visibility"), "visible")
        self.capture("poster")
        self.check("player.src = 'scene.stgs'")
        self.wait("getComputedStyle(part('.poster')).visibility === 'hidden'")
        self.assertTrue(self.check("part('.spinner').hidden"))

    def test_removal_destroys_the_player_and_a_move_does_not(self):
        self.show_ready()
        self.check("{ const box = document.createElement('div'); box.style.height = '100%';"
                   "document.body.append(box); box.append(player); }")
        self.assertFalse(self.check("new Promise((resolve) => setTimeout(() =>"
                                    "resolve(parts.renderers[0].destroyed === true), 50))"))
        self.check("player.remove()")
        self.wait("parts.renderers[0].destroyed && parts.workers[0].listener === null")
        self.check("document.body.append(player)")
        self.wait("player.readyState === 4")
        self.assertEqual(self.check("parts.renderers.length"), 2)

    def test_a_blob_can_be_played(self):
        self.show(src="")
        self.check("player.srcObject = new Blob(['x'])")
        self.wait("player.readyState === 4")
        self.assertTrue(self.check("parts.workers[0].posted[0].source instanceof Blob"))

    def test_errors_are_displayed_and_loading_can_be_repeated(self):
        self.show(controls="", src="missing.stgs")
        self.wait("!part('.error').hidden")
        message = self.check("part('.error p').textContent")
        self.assertIn("missing.stgs: the server reports 404", message)
        self.assertEqual(self.check("player.error.code"), 2)
        self.capture("error")
        self.browser.click(*self.centre(".retry"))
        self.wait("parts.workers.length === 2")
        self.check("player.src = 'scene.stgs'")
        self.wait("player.readyState === 4 && part('.error').hidden")

    def test_a_browser_without_webgl_is_an_error(self):
        self.check("parts.fails = true")
        self.show(controls="")
        self.wait("!part('.error').hidden && events.includes('error')")
        self.assertIn("WebGL 2", self.check("part('.error p').textContent"))
        name = self.check("player.play().catch((error) => error.name)")
        self.assertEqual(name, "NotSupportedError")

    def test_screenshots_are_png(self):
        self.show_ready()
        self.assertEqual(self.check("player.screenshot().then((blob) => blob.type)"), "image/png")

    # Size

    def test_the_canvas_follows_the_size_and_the_pixel_ratio(self):
        self.show_ready()
        self.wait("player.videoWidth === 1280 && player.videoHeight === 720")
        self.browser.resize(640, 360, ratio=2)
        self.wait("player.videoWidth === 1280 && player.videoHeight === 720 && innerWidth === 640")
        self.browser.resize(360, 640, ratio=3)
        self.wait("player.videoWidth === 720 && player.videoHeight === 1280")
        self.wait("parts.renderers[0].last.camera.height === 1280")
        self.assertAlmostEqual(self.camera()["fx"], 1100)  # the larger side keeps its field of view

    def test_the_bar_fits_narrow_players(self):
        for width in (320, 360, 480, 1280):
            self.browser.resize(width, 480)
            self.show_ready(controls="")
            self.wait(f"innerWidth === {width} && player.clientWidth === {width}")
            fits = self.check(
                "[...part('.row').children].filter((child) => child.offsetWidth > 0)"
                ".every((child) =>"
                f"child.getBoundingClientRect().right <= {width} - 2 &&"
                "child.getBoundingClientRect().left >= 2) && part('.row').scrollWidth <="
                "part('.row').clientWidth + 9")
            self.assertTrue(fits, f"at {width}")

    # Keys

    def test_keys_control_playback(self):
        self.show_ready(controls="")
        self.focus_view()
        self.browser.press(" ", "Space")
        self.wait("!player.paused")
        self.browser.press("k", "KeyK")
        self.wait("player.paused")
        self.browser.press("Home")
        self.wait("player.currentTime === 0 && !player.seeking")
        self.wait("player.buffered.end(0) >= 3")
        self.browser.press("ArrowRight")
        self.wait("Math.abs(player.currentTime - 1.2) < 0.01 && !player.seeking")
        self.browser.press("ArrowLeft")
        self.wait("player.currentTime < 0.01 && !player.seeking")
        self.browser.press(".", "Period")
        self.wait("Math.abs(player.currentTime - 1 / 30) < 1e-6")
        self.browser.press("ArrowUp")
        self.assertEqual(self.check("player.playbackRate"), 1.5)
        self.assertEqual(self.check("part('.speed').textContent"), "1.5×")
        self.browser.press("ArrowDown")
        self.browser.press("l", "KeyL")
        self.assertTrue(self.check("player.loop"))
        self.browser.press("i", "KeyI")
        self.assertFalse(self.check("part('.figures').hidden"))
        self.browser.press("End")
        self.wait("player.currentTime === 12")

    def test_keys_do_nothing_without_controls(self):
        self.show_ready()
        self.focus_view()
        self.browser.press(" ", "Space")
        self.browser.press("ArrowRight")
        self.assertEqual(self.check("[player.paused, player.currentTime]"), [True, 0])

    def test_space_presses_the_focused_button(self):
        self.show_ready(controls="")
        self.check("part('.loop').focus()")
        self.browser.press(" ", "Space")
        self.wait("player.loop")
        self.assertTrue(self.check("player.paused"))

    def test_the_tab_key_reaches_every_control(self):
        self.show_ready(controls="")
        names = []
        for _ in range(8):
            self.browser.press("Tab")
            names.append(self.check("player.shadowRoot.activeElement?.className.split(' ').pop()"))
            if len(names) == 3:
                self.capture("focus")
        self.assertEqual(names, ["view", "start", "seek", "play", "speed", "loop",
                                 "statistics", "fullscreen"])

    def test_the_speed_menu_by_keys(self):
        self.show_ready(controls="")
        self.check("part('.speed').focus()")
        self.browser.press("Enter")
        self.wait("!part('.menu').hidden")
        self.capture("menu")
        self.browser.press("ArrowDown")
        self.browser.press("Enter")
        self.wait("player.playbackRate === 1.5 && part('.menu').hidden")
        self.assertEqual(self.check("player.shadowRoot.activeElement === part('.speed')"), True)
        self.browser.press("Enter")
        self.browser.press("Escape")
        self.assertTrue(self.check("part('.menu').hidden"))

    # Pointers

    def test_the_slider_seeks(self):
        self.show_ready(controls="")
        self.wait("player.buffered.end(0) === 12")
        left, y = self.check("(() => { const r = part('.seek').getBoundingClientRect();"
                             "return [r.x, r.y + 10]; })()")
        width = self.check("part('.seek').clientWidth")
        self.browser.drag((left + 0.1 * width, y), (left + 0.5 * width, y), steps=10)
        self.wait("!player.seeking && Math.abs(player.currentTime - 6) < 0.05")
        self.assertEqual(self.check("part('.seek').getAttribute('aria-valuetext')"),
                         "6 seconds of 12 seconds")
        self.assertEqual(self.check("part('.seek').getAttribute('aria-valuemax')"), "12.00")
        self.assertIn("seeked", self.check("events"))

    def test_the_image_plays_by_click_and_orbits_by_drag(self):
        self.show_ready(controls="")
        self.browser.click(300, 300)
        self.wait("!player.paused")
        self.browser.click(300, 300)
        self.wait("player.paused")
        before = self.camera()["rotation"]
        self.browser.drag((300, 300), (500, 260))
        self.wait(f"parts.renderers[0].last.camera.rotation[0] !== {before[0]}")
        self.assertTrue(self.check("player.paused"))
        self.check("player.resetCamera()")
        self.wait(f"Math.abs(parts.renderers[0].last.camera.rotation[2] - {before[2]}) < 1e-9")

    def test_a_paused_player_renders_nothing(self):
        self.show_ready(controls="")
        self.wait("player.buffered.end(0) === 12")
        frames = self.check("new Promise((resolve) => { const [r] = parts.renderers;"
                            "const { frames } = r;"
                            "setTimeout(() => resolve(r.frames - frames), 500); })")
        self.assertEqual(frames, 0)

    def test_the_wheel_zooms_a_player_that_is_used(self):
        self.show_ready(controls="")
        distance = "parts.renderers[0].last.camera.translation[2]"
        start = self.check(distance)
        self.browser.mouse("mouseMoved", 300, 300)
        self.browser.mouse("mouseMoved", 310, 300)
        self.browser.mouse("mouseWheel", 310, 300, delta=-200)
        self.wait(f"{distance} < {start} - 0.5")

    def test_a_page_scrolls_over_a_player_that_is_not_used(self):
        self.check("document.body.style.height = '3000px'")
        self.show_ready(style="height: 400px; margin-top: 500px")
        distance = "parts.renderers[0].last.camera.translation[2]"
        start = self.check(distance)
        self.browser.mouse("mouseWheel", 300, 600, delta=100)
        self.wait("scrollY === 100")
        self.assertEqual(self.check(distance), start)

    def test_reduced_motion_ends_rotations_with_the_drag(self):
        self.browser.set_reduced_motion(True)
        self.addCleanup(self.browser.set_reduced_motion, False)
        self.show_ready(controls="")
        self.browser.drag((300, 300), (500, 300))
        rotation = "parts.renderers[0].last.camera.rotation[2]"
        self.wait(f"{rotation} !== 0")
        time.sleep(0.2)
        end = self.check(rotation)
        time.sleep(0.3)
        self.assertEqual(self.check(rotation), end)

    def test_fullscreen_by_key(self):
        self.show_ready(controls="")
        self.focus_view()
        self.browser.press("f", "KeyF")
        self.wait("document.fullscreenElement === player")
        self.wait("part('.fullscreen').getAttribute('aria-label') === 'Exit fullscreen'")
        self.browser.press("f", "KeyF")
        self.wait("document.fullscreenElement === null")

    def test_an_aborted_load_shows_nothing(self):
        self.show(controls="", src="")
        name = self.check("{ const c = new AbortController();"
                          "const done = player.load('slow.stgs', { signal: c.signal });"
                          "c.abort(); done.catch((error) => error.name); }")
        self.assertEqual(name, "AbortError")
        self.wait("part('.spinner').hidden && part('.start').hidden && part('.error').hidden")
        self.assertEqual(self.check("player.src"), "slow.stgs")

    def test_fly_keys_move_the_camera(self):
        self.show_ready(camera="fly", controls="")
        self.focus_view()
        start = self.camera()["translation"][2]
        send = self.browser.send
        send("Input.dispatchKeyEvent", type="keyDown", key="w", code="KeyW")
        self.wait(f"parts.renderers[0].last.camera.translation[2] < {start} - 0.2")
        send("Input.dispatchKeyEvent", type="keyUp", key="w", code="KeyW")

    def test_shift_and_arrows_rotate(self):
        self.show_ready(controls="")
        self.focus_view()
        self.browser.press("ArrowRight", modifiers=SHIFT)
        self.wait("parts.renderers[0].last.camera.rotation[2] !== 0")
        self.assertEqual(self.check("player.currentTime"), 0)
        self.browser.press("r", "KeyR")
        self.wait("Math.abs(parts.renderers[0].last.camera.rotation[2]) < 1e-9")

    def test_two_fingers_pinch(self):
        self.browser.resize(360, 640, ratio=2, mobile=True)
        self.show_ready(controls="")
        distance = "parts.renderers[0].last.camera.translation[2]"
        start = self.check(distance)
        self.browser.touch("touchStart", (150, 300), (210, 300))
        for step in range(1, 6):
            self.browser.touch("touchMove", (150 - 10 * step, 300), (210 + 10 * step, 300))
        self.browser.touch("touchEnd")
        self.wait(f"{distance} < {start} - 1")

    def test_the_controls_hide_while_playing(self):
        self.show_ready(controls="")
        self.wait("player.buffered.end(0) === 12")
        self.capture("start")
        self.browser.click(300, 300)
        self.wait("part('.root').classList.contains('idle')")
        self.capture("idle")
        self.browser.mouse("mouseMoved", 400, 300)
        self.wait("!part('.root').classList.contains('idle')")
        self.browser.click(*self.centre(".statistics"))
        self.capture("playing")
        self.browser.click(300, 300)
        self.wait("player.paused")
        self.assertFalse(self.check("part('.root').classList.contains('idle')"))

    def test_playback_ends_and_is_repeated(self):
        self.show_ready(controls="")
        self.wait("player.buffered.end(0) === 12")
        self.check("player.currentTime = 11.8")
        self.check("player.play()")
        self.wait("player.ended")
        self.assertEqual(self.check("part('.start').getAttribute('aria-label')"), "Replay")
        self.capture("ended")
        self.browser.click(*self.centre(".start"))
        self.wait("!player.ended && !player.paused && player.currentTime < 3")

    def test_the_player_on_a_phone(self):
        self.browser.resize(360, 640, ratio=2, mobile=True)
        self.show_ready(controls="")
        self.capture("phone")
        self.check("part('.statistics').click()")
        self.check("part('.speed').click()")
        self.capture("phone-menu")
        self.assertFalse(self.check("part('.menu').hidden"))


if __name__ == "__main__":
    if not os.path.exists(CHROMIUM) or shutil.which("esbuild") is None:
        print("skipped: needs chromium and esbuild")
        raise SystemExit(77)
    unittest.main()
