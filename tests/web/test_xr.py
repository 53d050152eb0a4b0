#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A scene in the emulated headset of iwer. See package_case.py for the usage."""
import unittest

from package_case import PackageCase, run

IPD, FOVY = 0.063, 1.5708  # metres, radians
BUTTON = "player.shadowRoot.querySelector('.button.xr')"
CAMERA = {"rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [0, 0, 0], "fx": 220, "fy": 220,
          "cx": 120, "cy": 90, "width": 240, "height": 180, "near": 0.01}


class Xr(PackageCase):
    PAGE = "xr_page.html"
    FILES = PackageCase.FILES + ["xr_page.js"]
    MODULES = {"iwer.js": "iwer/build/iwer.module.js"}

    def show(self):
        self.check("show", {"src": "scene.stgs", "controls": "", "quality": "high"})
        self.wait("player.readyState >= 3")
        self.check(f"device.stereoEnabled = true, device.ipd = {IPD}, device.fovy = {FOVY}")

    def enter(self, mode="immersive-vr"):
        self.check("player.enterXR", mode, {"metresPerUnit": 0.5})
        self.check("frames(10)")

    def test_the_button_is_there_with_a_headset_only(self):
        self.show()
        self.wait(f"!{BUTTON}.hidden")
        self.capture("xr_button")
        self.check(f"{BUTTON}.click()")
        self.wait("player.isInXR")
        self.assertEqual(self.check(f"{BUTTON}.getAttribute('aria-label')"), "Exit VR")
        self.check("player.exitXR()")
        self.wait(f"{BUTTON}.getAttribute('aria-label') === 'Enter VR'")
        self.assertEqual(self.check("events"), ["enterxr", "leavexr"])
        self.open(self.PAGE + "?plain")
        self.check("show", {"src": "scene.stgs", "controls": ""})
        self.wait("player.readyState >= 3")
        self.check("new Promise((resolve) => setTimeout(resolve, 200))")
        self.assertTrue(self.check(f"{BUTTON}.hidden"))
        name = self.check("player.enterXR().catch((error) => error.name)")
        self.assertEqual(name, "NotSupportedError")

    def test_both_eyes_show_the_image_of_their_cameras(self):
        self.show()
        self.check("player.currentTime = 1")
        self.wait("!player.seeking")
        self.check("device.position.set(0.2, 1.75, -0.3)")
        self.enter()
        values = self.check("compareEyes", 0.5, 1.6, IPD, FOVY)
        print("eyes:", [f"{value:.1f} dB" for value in values], flush=True)
        self.capture("xr_eyes")
        self.assertGreater(min(values), 50)
        self.assertEqual(self.check("alphas()"), [255, 255])

    def test_surroundings_show_behind_the_splats(self):
        self.show()
        self.enter("immersive-ar")
        least, most = self.check("alphas()")
        self.assertEqual(least, 0)
        self.assertGreater(most, 200)

    def test_each_eye_of_canted_displays_has_its_order(self):
        for degrees in (0.02, 10):
            values = self.check("compareCanted", CAMERA, degrees * 3.14159 / 180)
            print(f"{degrees} degrees:", [f"{value:.1f} dB" for value in values], flush=True)
            self.assertGreater(min(values), 50)

    def test_it_plays_and_the_controller_pauses(self):
        self.show()
        self.check("player.loop = true")
        self.enter()
        self.check("player.play()")
        self.wait("player.currentTime > 0.2")
        self.check("frames(5)")
        self.assertGreater(self.check("player.stats.framesPerSecond"), 0)
        self.check("device.controllers.right.updateButtonValue('trigger', 1)")
        self.check("frames(3)")
        self.check("device.controllers.right.updateButtonValue('trigger', 0)")
        self.wait("player.paused")

    def test_hidden_sessions_and_second_sessions(self):
        self.show()
        self.enter()
        name = self.check("player.enterXR().catch((error) => error.name)")
        self.assertEqual(name, "InvalidStateError")
        self.check("device.updateVisibilityState('hidden')")
        self.check("new Promise((resolve) => setTimeout(resolve, 200))")
        self.check("device.updateVisibilityState('visible')")
        self.check("frames(3)")
        self.check("player.exitXR()")
        self.assertFalse(self.check("player.isInXR"))
        self.enter()
        self.assertTrue(self.check("player.isInXR"))

    def test_a_lost_context_ends_the_session(self):
        self.show()
        self.enter()
        self.check("window.lost = canvas.getContext('webgl2').getExtension('WEBGL_lose_context')")
        self.check("lost.loseContext()")
        self.wait("!player.isInXR")
        self.check("lost.restoreContext()")
        self.wait("!canvas.getContext('webgl2').isContextLost()")
        self.check("player.screenshot().then(() => true)")
        self.assertEqual(self.check("events"), ["enterxr", "leavexr"])
        self.browser.problems.clear()  # iwer reads the state of the context that is lost

    def test_it_can_be_destroyed_at_any_time(self):
        for wait in (-1, 0, 5, 50):
            self.show()
            if wait < 0:  # before the session begins
                result = self.check("Promise.all([player.enterXR().catch((error) => error.name),"
                                    " player.remove()]).then(([name]) => name)")
                self.assertEqual(result, "AbortError")
            else:
                self.check("player.enterXR()")
                self.check(f"new Promise((resolve) => setTimeout(resolve, {wait}))")
                self.check("player.remove()")
            self.wait("navigator.xr && !player.isInXR")
            self.check("new Promise((resolve) => setTimeout(resolve, 100))")

    def test_the_session_needs_a_scene(self):
        self.check("show", {})
        name = self.check("player.enterXR().catch((error) => error.name)")
        self.assertEqual(name, "NotSupportedError")  # there is no player
        name = self.check("player.load('scene.stgs'), player.enterXR().catch((error) => error.name)")
        self.assertEqual(name, "InvalidStateError")  # it is not loaded yet


if __name__ == "__main__":
    run(Xr)
