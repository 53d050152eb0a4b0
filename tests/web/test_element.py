#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""<stgs-player>: attributes, lifetime, errors and size."""
from element_case import ElementCase, run

POSTER = ("data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' width='16' height='9'>"
          "<rect width='16' height='9' fill='%23345'/></svg>")

# The GPU of the newest renderer is lost.
LOSE = """parts.renderers[parts.renderers.length - 1].onError(
    Object.assign(new Error('the GPU device was lost'), { name: 'DeviceLostError' })), 0"""


class ElementTest(ElementCase):
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

    def test_another_renderer_recreates_the_player(self):
        self.show(src="scene.stgs", renderer="webgpu")
        self.wait("player.readyState === 4")
        self.assertEqual(self.check("[player.renderer, player.activeRenderer]"), ["webgpu", "webgl2"])
        self.check("player.renderer = 'webgl2'")
        self.wait("player.readyState === 4 && parts.renderers[0].destroyed")
        self.check("player.setAttribute('renderer', 'other')")
        self.wait("player.readyState === 4 && parts.renderers[1].destroyed")
        self.assertEqual(self.check("player.renderer"), "auto")
        self.assertEqual(self.check("parts.choices.slice(-3)"), ["webgpu", "webgl2", "auto"])

    def test_webgl2_takes_over_when_webgpu_is_lost_twice(self):
        self.show_ready(controls="", autoplay="")
        self.check("notices = [], player.addEventListener('notice', ({ detail }) => notices.push(detail.kind)), 0")
        self.wait("!player.paused && player.currentTime > 0.2")
        self.check("player.currentTime = 3, player.playbackRate = 0.5, 0")
        self.wait("!player.seeking")
        self.browser.drag((300, 300), (500, 260))
        camera = "JSON.stringify(parts.renderers[parts.renderers.length - 1].last.camera)"
        self.wait(f"(window.still = window.before === {camera}, window.before = {camera}, still)")
        for renderers in (1, 2):
            self.check("events.length = 0")
            self.check(LOSE)
            self.wait("events.includes('playing') && player.readyState === 4")
            self.assertNotIn("error", self.check("events"))
            self.assertEqual(self.check("parts.renderers.length"), renderers)
            self.assertGreaterEqual(self.check("player.currentTime"), 3)
            self.assertEqual(self.check("player.playbackRate"), 0.5)
            self.wait("parts.renderers[parts.renderers.length - 1].last")
            self.assertEqual(self.check(camera), self.check("before"))
        self.assertEqual(self.check("notices"), ["renderer", "renderer"])
        self.assertEqual(self.check("parts.choices"), ["auto", "webgl2"])
        self.assertEqual(self.check("player.renderer"), "auto")
        self.check(LOSE)
        self.wait("events.includes('playing') && player.error === null")

    def test_a_chosen_renderer_that_is_lost_twice_is_an_error(self):
        self.show_ready(controls="", renderer="webgpu")
        self.check(LOSE)
        self.wait("player.readyState === 4")
        self.check(LOSE)
        self.wait("!part('.error').hidden && events.includes('error')")
        self.assertEqual(self.check("player.error.message"), "rendering failed: the GPU device was lost")
        self.assertEqual(self.check("parts.choices"), ["webgpu"])
        self.check("player.load()")
        self.wait("player.readyState === 4 && player.error === null")

    def test_screenshots_are_png(self):
        self.show_ready()
        self.assertEqual(self.check("player.screenshot().then((blob) => blob.type)"), "image/png")

    def test_a_button_leads_to_the_live_edge_of_a_recording(self):
        self.show_ready(controls="")
        self.assertTrue(self.check("part('.live').hidden && player.live === null"))
        self.show_ready(controls="", src="live.stgs")
        self.check("player.play()")
        self.wait("part('.live').getAttribute('aria-pressed') === 'true'")
        self.capture("live")
        self.check("player.currentTime = 2")
        self.wait("part('.live').getAttribute('aria-pressed') === 'false'")
        self.assertEqual(self.check("part('.live').title"), "Go to the live edge")
        self.browser.mouse("mouseMoved", 400, 300)
        self.wait("!part('.root').classList.contains('idle')")
        self.capture("behind_live")
        self.browser.click(*self.centre(".live"))
        self.wait("part('.live').getAttribute('aria-pressed') === 'true' && player.live.following")
        self.assertEqual(self.posted("seek")[-1]["seconds"], 12)

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
            self.show_ready(controls="", src="live.stgs")
            self.wait(f"innerWidth === {width} && player.clientWidth === {width}")
            fits = self.check(
                "[...part('.row').children].filter((child) => child.offsetWidth > 0)"
                ".every((child) =>"
                f"child.getBoundingClientRect().right <= {width} - 2 &&"
                "child.getBoundingClientRect().left >= 2) && part('.row').scrollWidth <="
                "part('.row').clientWidth + 9")
            self.assertTrue(fits, f"at {width}")


if __name__ == "__main__":
    run()
