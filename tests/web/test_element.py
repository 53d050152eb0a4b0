#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""<stgs-player>: attributes, lifetime, errors and size."""
import json
import os
from urllib.parse import quote

from browser import Server
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

    def test_a_content_security_policy_without_inline_styles(self):
        with open(os.path.join(self.folder.name, "policy.html"), "w", encoding="utf-8") as file:
            file.write("""<!doctype html><html lang="en"><head>
                <meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'self'"></head>
                <body><script src="element_page.js"></script></body></html>""")
        self.browser.open(self.server.url + "policy.html")
        self.check("violations = [], addEventListener('securitypolicyviolation', (event) =>"
                   " violations.push(event.violatedDirective)), 0")
        self.show_ready(controls="", src="live.stgs")
        self.check("player.play()")
        self.browser.move(*self.centre(".seek"))
        self.browser.click(*self.centre(".speed"))
        self.wait("player.currentTime > 0.2")
        self.assertEqual(self.check("getComputedStyle(player).display"), "block")
        self.assertEqual(self.check("getComputedStyle(part('canvas')).position"), "absolute")
        self.assertEqual(self.check("violations"), [])

    def test_the_style_follows_the_element_to_another_document(self):
        self.show_ready()
        self.check("document.body.append(document.createElement('iframe'))")
        self.check("frames[0].document.body.append(player)")
        self.wait("player.readyState === 4")
        self.assertEqual(self.check("frames[0].getComputedStyle(player).display"), "block")

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
        self.show_ready(controls="", autoplay="", quality="high")  # so that all images have one size
        self.check("notices = [], player.addEventListener('notice', ({ detail }) => notices.push(detail.kind)), 0")
        self.wait("!player.paused && player.currentTime > 0.2")
        self.check("player.currentTime = 3, player.playbackRate = 0.5, 0")
        self.wait("!player.seeking")
        self.browser.drag((300, 300), (500, 260))
        last = "parts.renderers[parts.renderers.length - 1].last"
        camera = f"JSON.stringify({last}.camera)"
        # The camera is still if two images in a row have the same.
        self.wait(f"(({{ seen, before }}) => (window.seen = {last}, window.before = {camera}, "
                  "window.seen !== seen && window.before === before))(window)")
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
    def test_the_quality_and_the_device_are_chosen_by_attributes(self):
        self.show_ready(controls="", quality="low", device="headset")
        options = self.posted("open")[0]["options"]
        self.assertEqual(options, {"memoryBudget": 2 ** 28, "maxPrimitives": 500000, "lookAhead": 10, "latency": 1})
        self.check("player.play()")
        self.wait("player.videoWidth === 640 && player.stats.quality.tiers === 1")
        self.assertEqual(self.check("player.clientWidth"), 1280)
        self.focus_view()
        self.browser.press("i")
        self.wait("part('.figures').textContent.includes('low, headset')")
        self.assertIn("Tiers1 of 3", self.check("part('.figures').textContent"))
        self.capture("statistics_quality")
        self.check("player.pause()")
        self.wait("player.videoWidth === 1280")  # still images have all pixels
        self.check("player.addEventListener('qualitychange', ({ detail }) => (window.report = detail));"
                   "player.quality = 'high'")
        self.wait("'report' in window && report.maxPrimitives === Infinity")
        self.assertEqual(self.check("report.reason"), "quality is high")
        self.check("player.setAttribute('quality', 'best'); player.removeAttribute('device')")
        self.wait("parts.workers.length === 2 && player.readyState === 4")
        self.assertEqual(self.check("[player.quality, player.device, player.stats.quality.device]"),
                         ["auto", None, "desktop"])

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
        self.browser.move(400, 300)
        self.wait("!part('.root').classList.contains('idle')")
        self.capture("behind_live")
        self.browser.click(*self.centre(".live"))
        self.wait("part('.live').getAttribute('aria-pressed') === 'true' && player.live.following")
        self.assertEqual(self.posted("seek")[-1]["seconds"], 12)

    def test_the_latency_of_a_recording_is_an_attribute(self):
        self.show_ready(src="live.stgs", latency="2.5")
        self.assertEqual(self.posted("open")[-1]["options"]["latency"], 2.5)
        self.check("player.latency = 4")
        self.assertEqual(self.check("player.getAttribute('latency')"), "4")
        self.assertEqual(self.posted("latency")[-1]["seconds"], 4)
        for text in ("-1", "soon", "", " ", "3601", "Infinity", "1s"):
            self.check(f"player.setAttribute('latency', {text!r})")
            self.assertEqual(self.check("player.latency"), 1, text)
        self.assertEqual(self.posted("latency")[-1]["seconds"], 1)
        self.assertEqual(self.check("(() => { try { player.latency = -1; } catch ({ name }) { return name; } })()"), "IndexSizeError")

    def test_a_volume_is_checked_before_there_is_a_player(self):
        self.assertEqual(self.check("""(() => {
            const element = document.createElement("stgs-player");
            element.volume = 0.5;
            try { element.volume = 2; } catch ({ name }) { return [name, element.volume]; }
        })()"""), ["IndexSizeError", 0.5])

    # The bridge to an embedding page, which is of another origin

    def embed(self, origins, **options):
        """Opens a page of another server, which embeds a player that these origins may control."""
        server = Server(self.folder.name)
        self.addCleanup(server.close)
        self.browser.open(server.url + "bridge_page.html")
        attributes = {"src": "scene.stgs", "bridge": origins or server.url.rstrip("/")}
        page = f"{self.server.url}element_page.html#{quote(json.dumps(attributes))}"
        return self.check(f"failure(open({json.dumps(page)}, {json.dumps(options)}))")

    def test_an_embedding_page_controls_the_player(self):
        self.assertEqual(self.embed(""), "none")
        self.wait("remote.state.readyState === 4")
        self.assertEqual(self.check("[remote.state.duration, remote.state.paused, remote.state.error]"), [12, True, None])
        self.check("remote.play()")
        self.wait("names.includes('playing') && names.includes('timeupdate') && remote.state.currentTime > 0")
        self.capture("bridge")
        self.check("remote.pause()")
        self.check("remote.seek(7)")
        self.wait("names.includes('seeked') && remote.state.currentTime === 7 && remote.state.paused")
        self.check("remote.set('muted', true)")
        self.wait("remote.state.muted && names.includes('volumechange')")
        self.assertEqual(self.check("failure(remote.set('volume', 2))"),
                         "IndexSizeError: volume 2 is out of range (expected 0 to 1)")
        view = self.check("remote.camera().then((view) => remote.setCamera({ ...view, azimuth: 0.1, distance: 1e9 }))"
                          ".then(() => remote.camera())")
        self.assertAlmostEqual(view["azimuth"], 0.1)
        self.assertLess(view["distance"], 1e3)  # within the limits
        self.check("remote.goLive()")
        self.assertEqual(self.check("[remote.state.live, remote.state.error]"), [None, None])
        self.check("remote.resetCamera()")
        self.assertEqual(self.check("remote.camera().then(({ azimuth }) => azimuth)"), 0)
        self.check("document.querySelector('iframe').src = document.querySelector('iframe').src.replace('#', '?2#')")
        self.wait("names.includes('connect') && remote.state.currentTime === 0")
        self.assertEqual(self.check("remote.pause().then(() => remote.close(), String)"), None)
        self.assertIn("InvalidStateError", self.check("failure(remote.play())"))

    def test_pages_that_are_not_permitted_are_not_answered(self):
        self.assertIn("TimeoutError: no player on", self.embed("https://page.example", timeout=700))
        # A page of a permitted origin that does not embed the player, but is next to it.
        self.assertEqual(self.embed(""), "none")
        self.assertFalse(self.check("""new Promise((resolve) => {
            const other = document.createElement("iframe");
            document.body.append(other); // of the origin of this page
            const { port1, port2 } = new MessageChannel();
            port1.onmessage = () => resolve(true);
            other.contentWindow.eval("(to, ...more) => to.postMessage(...more)")(
              frames[0], { stgs: "connect", version: 1 }, "*", [port2]);
            setTimeout(() => resolve(false), 500);
        })"""))
        self.assertEqual(self.check("failure(remote.pause())"), "none")

    def test_hostile_messages_are_ignored_and_bounded(self):
        self.assertEqual(self.embed(""), "none")
        replies = self.check("""(async () => {
            const frame = document.querySelector("iframe"), { origin } = new URL(frame.src);
            for (const junk of [null, 1, "x".repeat(1e6), [], {}, { stgs: "connect" }, { stgs: "connect", version: 1 }, { stgs: {} }])
              frame.contentWindow.postMessage(junk, origin);
            const port = await rawPort(frame);
            const junk = [null, 1, "play", [], {}, { id: -1, method: "pause", args: [] }, { id: 1, method: "destroy", args: [] },
              { id: 1, method: "constructor", args: [] }, { id: 1, method: "pause" }, { id: 1, method: "seek", args: [1, 2, 3] },
              { id: NaN, method: "pause", args: [] }, { id: 1, method: { toString: "play" }, args: [] }];
            const bad = [["seek", ["1"]], ["seek", [NaN]], ["set", ["src", "https://x.example"]], ["set", ["innerHTML", "x"]],
              ["set", ["quality", "best"]], ["set", ["muted", 1]], ["setCamera", [{ azimuth: 1 }]],
              ["setCamera", [{ azimuth: 0, elevation: 0, distance: 1, point: [0, 0, Infinity] }]]];
            const requests = bad.map(([method, args], k) => ({ id: 100 + k, method, args }));
            const plays = Array.from({ length: 200 }, (_, k) => ({ id: 1000 + k, method: "play", args: [] }));
            return exchange(port, [...junk, ...requests, ...plays, { id: 5000, method: "pause", args: [] }], 1199);
        })()""")
        self.assertTrue(all(reply["id"] >= 100 for reply in replies))
        bad = [reply for reply in replies if reply["id"] < 1000]
        self.assertEqual(len(bad), 8)
        self.assertTrue(all(reply["error"]["name"] == "TypeError" for reply in bad), bad)
        refused = [reply for reply in replies if reply.get("error", {}).get("name") == "QuotaExceededError"]
        self.assertGreaterEqual(len(refused), 200 - 32)

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
            self.check("part('.mute').hidden = false")  # as of a scene with sound
            if width == 320:
                self.capture("narrow_sound")
            fits = self.check(
                "[...part('.row').children].filter((child) => child.offsetWidth > 0)"
                ".every((child) =>"
                f"child.getBoundingClientRect().right <= {width} - 2 &&"
                "child.getBoundingClientRect().left >= 2) && part('.row').scrollWidth <="
                "part('.row').clientWidth + 9")
            self.assertTrue(fits, f"at {width}")


if __name__ == "__main__":
    run()
